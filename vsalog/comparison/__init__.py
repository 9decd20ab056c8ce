"""Several estimators on one log."""
