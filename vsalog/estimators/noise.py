"""The noise in what a fit leaves over, and how many of its samples count as one.

Left-over torques are not white: filters smooth them, encoders repeat themselves, and a model that does not fit leaves a slow
pattern. Taking N of them for N independent samples would make every uncertainty too small. So they are summed over batches:
the variance of the sums against that of the samples tells how many samples count as one within a batch, and the
correlation of neighbouring sums does the same beyond it (batch means, with a first-order correction between batches).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Samples in a batch, and batches that are needed before their sums mean anything.
BATCH = 64
BATCHES = 8

# Weight, Σ e², Σ e(k) e(k−1), last e, samples; in the batch: count, sum; weight, Σ S², Σ S(b) S(b−1), last S, batches.
_SIZE = 12


def noise_start() -> Array:
    """Return the state before the first sample."""
    return np.zeros(_SIZE)


def noise_block(state: Array, left: Array, unknowns: int, memory: float) -> tuple[Array, Array]:
    """Observe what a fit leaves over.

    Parameters
    ----------
    state : of `noise_start` or a previous call
    left : shape (N,), NaN where nothing was learnt
    unknowns : number of parameters fitted
    memory : samples over which the noise is observed

    Returns
    -------
    state, and shape (N,): variance of a left-over times the number of samples that count as one; NaN while not known
    """
    new, out = state.copy(), np.empty(left.shape[0])
    _run(left, unknowns, memory, new, out)
    return new, out


def noise_now(state: Array, unknowns: int) -> tuple[float, float]:
    """Return the variance of a single left-over, and the number of samples that count as one; NaN while not known."""
    return float(_variance(state, unknowns)), float(_inflation(state))


@njit(cache=True, error_model="numpy")
def _variance(s: Array, unknowns: int) -> Any:
    if s[0] <= 1.0 or s[4] <= unknowns + 1.0:
        return np.nan
    return s[1] / s[0] * s[4] / (s[4] - unknowns)


@njit(cache=True, error_model="numpy")
def _inflation(s: Array) -> Any:
    if s[1] <= 0.0:
        return 1.0
    if s[11] < BATCHES or s[8] <= 0.0:
        r = min(max(s[2] / s[1], 0.0), 0.999)
        return (1.0 + r) / (1.0 - r)
    within = s[8] / s[7] / (BATCH * s[1] / s[0])
    r = min(max(s[9] / s[8], 0.0), 0.99)
    return max(within, 1.0) * (1.0 + r) / (1.0 - r)


@njit(cache=True, error_model="numpy")
def _run(left: Array, unknowns: int, memory: float, s: Array, out: Array) -> None:
    forget = 1.0 - 1.0 / memory
    forget_batch = forget**BATCH
    for k in range(left.shape[0]):
        e = left[k]
        if not np.isnan(e):
            s[0] = forget * s[0] + 1.0
            s[1] = forget * s[1] + e * e
            s[2] = forget * s[2] + e * s[3]
            s[3] = e
            s[4] += 1.0
            s[5] += 1.0
            s[6] += e
            if s[5] == BATCH:
                s[7] = forget_batch * s[7] + 1.0
                s[8] = forget_batch * s[8] + s[6] * s[6]
                s[9] = forget_batch * s[9] + s[6] * s[10]
                s[10] = s[6]
                s[11] += 1.0
                s[5] = 0.0
                s[6] = 0.0
        out[k] = _variance(s, unknowns) * _inflation(s)
