"""The contents of a log: the data of `inspect`."""
