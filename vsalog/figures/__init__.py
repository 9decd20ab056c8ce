"""Figures: charts as data, from arrays, thinned to a screen's resolution; and their files for papers."""
