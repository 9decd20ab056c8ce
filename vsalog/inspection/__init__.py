"""What is in a log: the data of `inspect`."""
