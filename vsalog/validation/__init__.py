"""A frozen model against a second experiment: does what was learnt in the first hold in the second? (Flacco 2012 §8.)"""
