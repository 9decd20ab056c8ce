"""Many logs: planned, processed in parallel, resumable, and written as one data set."""
