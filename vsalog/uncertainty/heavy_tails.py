"""Weights of rows whose noise has heavier tails than the normal distribution: outliers count little, normal noise is not changed.

Student's t as a scale mixture of normal distributions (Lange, Little, Taylor, J. Am. Stat. Assoc. 84(408), 1989): a row that is
off by u standard deviations has the weight (ν + 1)/(ν + u²). How heavy tails are, ν, is that of the largest likelihood, and
infinite where a normal distribution has the least Bayesian information criterion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Tails(NamedTuple):
    """What is tried.

    Attributes
    ----------
    degrees : of freedom [1], from Cauchy's tails to such as are hardly other than normal
    steps : of the scale's expectation-maximisation, which converges by a factor of 2 or more each [1]
    """

    degrees: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
    steps: int = 20


TAILS = Tails()


class Weights(NamedTuple):
    """Weights of rows.

    Attributes
    ----------
    each : shape (M,), over a row's variance
    logarithm : of the residuals' density, over that of normal ones of variance 1 of the weighted residuals
    """

    each: Array
    logarithm: float


def tail_weights(residual: Array) -> Weights | None:
    """Return the weights of rows from residuals, shape (M,); None where all are alike."""
    count = residual.size
    squares = residual**2
    if count == 0 or not squares.any():
        return None
    variance = float(squares.mean())
    best, found = -0.5 * count * (np.log(2.0 * np.pi * variance) + 1.0) + 0.5 * np.log(count), None
    for degrees in TAILS.degrees:
        scale = float(np.median(squares)) or variance
        for _ in range(TAILS.steps):
            weights = (degrees + 1.0) / (degrees + squares / scale)
            scale = float(np.mean(weights * squares))
        likelihood = count * (
            math.lgamma(0.5 * (degrees + 1.0)) - math.lgamma(0.5 * degrees) - 0.5 * np.log(np.pi * degrees * scale)
        ) - 0.5 * (degrees + 1.0) * float(np.log1p(squares / (degrees * scale)).sum())
        if likelihood > best:
            each = (degrees + 1.0) / (degrees + squares / scale) / scale
            normal = -0.5 * (count * np.log(2.0 * np.pi) + float(each @ squares))
            best, found = likelihood, Weights(each, float(likelihood - normal))
    return found
