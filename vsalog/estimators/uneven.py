"""Noise that comes and goes, and what it makes of a score.

The octaves of `noise.py` take noise for the same throughout. Where it comes together with the motion, as what too few samples
make of a jerk between long rests, its mean over the rests tells little of it. So the products of coefficients, the left-overs'
times the regressors', are also summed up stretch by stretch. Stretches that are longer than noise lasts are independent, and the
squares of their sums add up to the score's covariance, however the noise changes from one to the next. That is less certain, for
it rests on the few stretches in which much happens: it counts where it is more than chance would make of even noise.
(White, "A heteroskedasticity-consistent covariance matrix estimator and a direct test for heteroskedasticity", Econometrica
48(4), 1980; of stretches: Liang and Zeger, "Longitudinal data analysis using generalized linear models", Biometrika 73(1), 1986.)

Products of wavelets' coefficients, unlike those of samples, have no ends of stretches in them, at which noise that was
differentiated would seem larger than it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Lengths of stretches, each twice the one before; stretches that are enough.
LENGTHS, ENOUGH = 20, 32
# Uneven noise is believed where it makes so many times the variance that even noise would.
SURELY = 2.0


class Stretches(NamedTuple):
    """Stretches of each length, in boxes of samples, for n unknowns.

    Attributes
    ----------
    scores : shape (LENGTHS, n), sums of the stretches in progress
    number : shape (LENGTHS,), of stretches that are complete
    products : shape (LENGTHS, n, n), sums of score scoreᵀ over these
    """

    scores: Array
    number: Array
    products: Array

    def copied(self) -> Stretches:
        """Return an independent copy."""
        return Stretches._make(a.copy() for a in self)


def stretches_start(n: int) -> Stretches:
    """Return the state before the first sample, for n unknowns."""
    return Stretches(np.zeros((LENGTHS, n)), np.zeros(LENGTHS), np.zeros((LENGTHS, n, n)))


@njit(cache=True, error_model="numpy")
def add_product(s: Stretches, x: Array, left: float) -> None:
    """Add what a coefficient of the left-overs makes with those of the regressors, the first n of x."""
    for i in range(s.scores.shape[1]):
        s.scores[0, i] += left * x[i]


@njit(cache=True, error_model="numpy")
def end_box(s: Stretches, kept: float) -> None:
    """End the stretches that end with a box; in the next one what was before counts `kept` of what it did, squared."""
    boxes = int(s.number[0]) + 1
    for length in range(LENGTHS):
        if boxes % (1 << length):
            break
        score = s.scores[length]
        s.number[length] += 1.0
        for i in range(score.shape[0]):
            for j in range(score.shape[0]):
                s.products[length, i, j] += score[i] * score[j]
        if length + 1 < LENGTHS:
            s.scores[length + 1] += score
        s.scores[length] = 0.0
    if kept != 1.0:
        s.products[:] *= kept
        s.scores[:] *= np.sqrt(kept)


@njit(cache=True, error_model="numpy")
def uneven(s: Stretches, out: Array) -> None:
    """Write the score's covariance, shape (n, n), as the longest stretches have it of which there are enough; else zero."""
    out[:] = 0.0
    for length in range(LENGTHS - 1, -1, -1):
        if s.number[length] >= ENOUGH:
            out[:] = s.products[length]
            return
