"""Running an estimator on a log."""
