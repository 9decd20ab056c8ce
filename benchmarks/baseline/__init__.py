"""What must not get worse: a record of what one version of the product does, and the comparison of two records."""
