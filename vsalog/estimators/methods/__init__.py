"""Published methods, one per file, named as `--estimator` names them."""
