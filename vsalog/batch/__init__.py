"""Many logs: planned, done side by side, resumed after anything, and left as one data set."""
