"""The stiffness observer of Grioli and Bicchi, as Serio et al. (2011) use it on a measured torque: eq. 6 and 13, derived again.

The torque Σ(φ, θ₂) that a transmission bears changes by Σ̇ = K φ̇ + (∂Σ/∂θ₂) θ̇₂ (eq. 4). The observer follows K̂ by

    dK̂/dt = α e sgn φ̇,    e = Σ̇ − K̂ φ̇,

and the set-point's contribution to e averages out as φ̇ changes sign. Over a sample in which Σ̇ and φ̇ are held its solution is
K̂ → K̂ + (1 − exp(−α |φ̇| T)) (Σ̇/φ̇ − K̂), which is stable for every α; the print's Euler step (eq. 13) is its first order.

Print of Serio 2011: eq. 14 takes B₁ q̈ and D₁ times a fourth difference of q off Σ̇. Such terms belong to the motor equation,
with θ₁ and in Σ = B₁ θ̈₁ + D₁ θ̇₁ − τ₁; where Σ itself is measured nothing is subtracted.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def observer_start() -> Array:
    """Return the state before the first sample: K̂, its variance, and the filled part of the memory; shape (3,)."""
    return np.zeros(3)


@njit(cache=True, error_model="numpy", nogil=True)
def observe_stiffness(
    state: Array, torque_rate: Array, deflection_rate: Array, use: Flags, alpha: float, period: float
) -> tuple[Array, Array, Array, Array]:
    """Follow the stiffness over a block.

    Parameters
    ----------
    state : of `observer_start` or of the block before
    torque_rate, deflection_rate : shape (N,), Σ̇ [N·m/s] and φ̇ [rad/s]
    use : shape (N,), which samples are used
    alpha : gain α [1/rad]
    period : T [s]

    Returns
    -------
    stiffness : shape (N,) [N·m/rad], NaN before any sample is used; the start at K̂ = 0 is corrected, as it is of any average
    deviation : shape (N,), its standard deviation if the samples' e were independent of one another [N·m/rad]
    learnt : shape (N,), 0 to 1, the part of the observer's memory that is filled
    state : to go on with
    """
    n = torque_rate.size
    stiffness, deviation, learnt = np.full(n, np.nan), np.full(n, np.nan), np.empty(n)
    total, variance, weight = state
    for k in range(n):
        rate = deflection_rate[k]
        if use[k] and rate != 0.0:
            gain = -np.expm1(-alpha * abs(rate) * period)
            if gain > 0.0:
                single = torque_rate[k] / rate
                # Of the estimate before: a sample is no test of itself.
                off = single - total / weight if weight > 0.0 else 0.0
                total += gain * (single - total)
                variance = (1.0 - gain) ** 2 * variance + (gain * off) ** 2
                weight += gain * (1.0 - weight)
        learnt[k] = weight
        if weight > 0.0:
            stiffness[k], deviation[k] = total / weight, np.sqrt(variance) / weight
    return stiffness, deviation, learnt, np.array([total, variance, weight])
