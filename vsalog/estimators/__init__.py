"""Estimators: their parts, one file for each, and one published method per file in `methods`."""
