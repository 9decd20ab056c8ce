"""A stiffness observer and a Kalman filter of the link in one loop: Serio et al. (2011) §III-A, eq. 8–9, derived again.

The link's equation of motion, differentiated (eq. 4, with the derivatives that its print has lost),

    f = d/dt (τ_ext − g(q)) = I q⃛ + N q̈ + K φ̇ + Σ_u θ̇₂,

is used twice at every sample: for I and N, which a Kalman filter finds in f − K̂ φ̇ (eq. 8), and for K, which the observer of
eq. 6 follows in f − Î q⃛ − N̂ q̈ (eq. 9). Each takes the other's estimate as true: where f contains little information, the loop
may settle wherever it began. Print of Serio 2011: eq. 4, 5, 8 and 9 have q̈ and q̇ where these derivatives are one higher.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class CoupledState(NamedTuple):
    """State of the loop.

    Attributes
    ----------
    link : shape (2,), Î [kg·m²] and N̂ [N·m·s/rad]
    P : shape (2, 2), their covariance
    stiffness : shape (3,), the estimate of K̂, its variance, and how much of the memory is filled
    """

    link: Array
    P: Array
    stiffness: Array


class CoupledNoise(NamedTuple):
    """What the filter of the link assumes.

    Attributes
    ----------
    rate : standard deviation of f − K̂ φ̇ [N·m/s], of a sample as if its neighbours were independent of it
    inertia, damping : standard deviations of I and N before anything is known
    wander : per √second, share of these by which they may change
    filled : part of the observer's memory that must be filled before its stiffness counts for the link
    """

    rate: float
    inertia: float
    damping: float
    wander: float
    filled: float


def coupled_start(inertia: float, damping: float, noise: CoupledNoise) -> CoupledState:
    """Return the state before the first sample, from an initial guess of I [kg·m²] and N [N·m·s/rad]."""
    P = np.diag([noise.inertia**2, noise.damping**2])
    return CoupledState(np.array([inertia, damping]), P, np.zeros(3))


def observe_coupled(
    state: CoupledState, f: Array, jerk: Array, acceleration: Array, deflection_rate: Array, use: Flags, alpha: float,
    period: float, noise: CoupledNoise,
) -> tuple[Array, Array, CoupledState]:  # fmt: skip
    """Follow stiffness, inertia and damping over a block.

    Parameters
    ----------
    state : of `coupled_start` or of the block before
    f : shape (N,), rate of the torque that moves the link from outside [N·m/s]
    jerk, acceleration : shape (N,), q⃛ [rad/s³] and q̈ [rad/s²]
    deflection_rate : shape (N,), φ̇ [rad/s]
    use : shape (N,), which samples are used
    alpha : gain α of the observer [1/rad]
    period : T [s]
    noise : assumed

    Returns
    -------
    stiffness : shape (N, 3), K̂ [N·m/rad], its standard deviation were samples independent, the filled part of the memory
    link : shape (N, 4), Î, N̂ and their standard deviations
    state : to go on with
    """
    link, P, learnt = state.link.copy(), state.P.copy(), state.stiffness.copy()
    stiffness, links = np.full((f.size, 3), np.nan), np.empty((f.size, 4))
    _run(f, jerk, acceleration, deflection_rate, use, alpha, period, np.array(noise), link, P, learnt, stiffness, links)
    return stiffness, links, CoupledState(link, P, learnt)


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    f: Array, jerk: Array, acceleration: Array, phi_dot: Array, use: Flags, alpha: float, T: float, noise: Array,
    link: Array, P: Array, learnt: Array, stiffness: Array, links: Array,
) -> None:  # fmt: skip
    r, inertia, damping, wander, filled = noise
    for k in range(f.size):
        if use[k]:
            P[0, 0] += (wander * inertia) ** 2 * T
            P[1, 1] += (wander * damping) ** 2 * T
            rate, h0, h1 = phi_dot[k], jerk[k], acceleration[k]
            K = learnt[0] / learnt[2] if learnt[2] > 0.0 else 0.0
            # Eq. 8: what the spring does not account for is the link's. Before the spring is known all would be.
            g0, g1 = P[0, 0] * h0 + P[0, 1] * h1, P[0, 1] * h0 + P[1, 1] * h1
            variance = h0 * g0 + h1 * g1 + r * r
            step = (f[k] - K * rate - h0 * link[0] - h1 * link[1]) / variance
            if learnt[2] >= filled:
                link[0] += g0 * step
                link[1] += g1 * step
                P[0, 0] -= g0 * g0 / variance
                P[1, 1] -= g1 * g1 / variance
                P[0, 1] -= g0 * g1 / variance
                P[1, 0] = P[0, 1]
            # Eq. 9: what the link does not account for is the spring's; solved over the sample as in `stiffness_observer`.
            gain = -np.expm1(-alpha * abs(rate) * T)
            if gain > 0.0:
                single = (f[k] - h0 * link[0] - h1 * link[1]) / rate
                off = single - K if learnt[2] > 0.0 else 0.0
                learnt[0] += gain * (single - learnt[0])
                learnt[1] = (1.0 - gain) ** 2 * learnt[1] + (gain * off) ** 2
                learnt[2] += gain * (1.0 - learnt[2])
        stiffness[k, 2] = learnt[2]
        if learnt[2] > 0.0:
            stiffness[k, 0], stiffness[k, 1] = learnt[0] / learnt[2], np.sqrt(learnt[1]) / learnt[2]
        links[k, 0], links[k, 1] = link
        links[k, 2], links[k, 3] = np.sqrt(P[0, 0]), np.sqrt(P[1, 1])
