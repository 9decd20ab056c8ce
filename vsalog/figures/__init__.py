"""What figures show: charts as data, out of arrays, thinned to what a screen shows; and their files for papers."""
