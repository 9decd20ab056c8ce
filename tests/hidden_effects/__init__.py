"""Hides an effect in the log of a simulated joint, and scores what a diagnosis makes of it.

Written apart from vsalog: its own equations, its own sensors. Only the scoring knows the truth.

A battery has kinds (one effect, two, none, fewer roles, effects outside the catalogue), each effect as visible as is asked for,
and families (`families`), whose effects are as strong as in real machines, several at once. Families of elastic and rigid joints
can be simulated with MuJoCo too.
"""
