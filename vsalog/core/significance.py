"""Required significance: stated probabilities, and the normal deviates, draws and repeats that follow from them."""

from __future__ import annotations

import math
from statistics import NormalDist

SIGNIFICANCE = 0.05
"""Probability with which an interval or a band does not cover the true value [1]: the convention, 95 % intervals."""

FALSE_ALARM = 1e-3
"""False-alarm probability of one test of a log [1]: one of a thousand logs."""

FALSE_ALARM_OF_MANY = 1e-6
"""The same of each of many tests [1], as of every channel, transmission and stretch of thousands of logs."""


def two_sided(tail: float) -> float:
    """Return how many standard deviations a normal variable exceeds, to either side, with a probability."""
    return NormalDist().inv_cdf(1.0 - 0.5 * tail)


def one_sided(tail: float) -> float:
    """Return how many standard deviations a normal variable exceeds, to one side, with a probability."""
    return NormalDist().inv_cdf(1.0 - tail)


def variance_ratio(tail: float, degrees: int) -> float:
    """Return the upper quantile of χ²/ν: the ratio of a sample variance of ν degrees of freedom to the true variance that is
    exceeded with the probability `tail`.
    """
    # Imported here, since a command that only prints its help does not need scipy.
    from scipy import special

    return float(special.chdtri(degrees, tail)) / degrees


def draws_for(tail: float) -> int:
    """Return the number of draws, the data's own included, with which a permutation test can give so small a p-value."""
    return round(1.0 / tail)


def repeats_for(tail: float) -> int:
    """Return the number of equal outcomes in a row, of probability 1/2 each, that has at most a probability by chance."""
    return math.ceil(-math.log2(tail))


INTERVAL = two_sided(SIGNIFICANCE)
INTERVAL_BELOW = one_sided(SIGNIFICANCE)
DETECTED = two_sided(FALSE_ALARM)
DETECTED_OF_MANY = two_sided(FALSE_ALARM_OF_MANY)
DRAWS = draws_for(FALSE_ALARM)
REPEATS = repeats_for(FALSE_ALARM)
