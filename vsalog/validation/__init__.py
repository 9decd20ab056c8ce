"""A frozen model on a second experiment: does the fit to the first hold in the second? (Flacco 2012 §8.)"""
