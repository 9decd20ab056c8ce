"""Hides an effect in the log of a simulated joint, and scores what a diagnosis makes of it.

Written apart from vsalog: its own equations, its own sensors. Only the scoring knows the truth.
"""
