"""Inertia and damping of a link by an extended Kalman filter: Serio et al. (2011) eq. 10–12 and 21–25, derived afresh.

The link obeys I q̈ + N q̇ = u (eq. 10), u what acts on it. With a = 1/I and b = N/I it is q̈ = a u − b q̇, and over a sample

    q⁺ = q + T q̇ + ½ T² q̈,    q̇⁺ = q̇ + T q̈,

a and b nearly constant. The link's position alone is measured.

Print of Serio 2011: eq. 11 calls 1/I x₃ and N/I x₄, but eq. 12 has q̈ = −x₃ q̇ − x₄ u: the two have changed places there, and u has
the wrong sign.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Order of the state: position, velocity, a = 1/I, b = N/I.
POSITION, VELOCITY, MOBILITY, DECAY = range(4)


class LinkState(NamedTuple):
    """Where the filter stands.

    Attributes
    ----------
    x : shape (4,), q [rad], q̇ [rad/s], 1/I [1/(kg·m²)], N/I [1/s]
    P : shape (4, 4), their covariance
    last : shape (3,), the last u [N·m], the running mean of normalised squared innovations, and whether a run has begun
    """

    x: Array
    P: Array
    last: Array


class LinkNoise(NamedTuple):
    """What the filter assumes, standard deviations.

    Attributes
    ----------
    position : of a measured position [rad]
    torque : of u, sample by sample [N·m]
    velocity : of the velocity when a run begins [rad/s]
    mobility, decay : of a and b before anything is known
    wander : per second, share of these by which a and b may change
    """

    position: float
    torque: float
    velocity: float
    mobility: float
    decay: float
    wander: float


def link_start(noise: LinkNoise) -> LinkState:
    """Return the state before the first sample: nothing is known, a = b = 0 as in the paper."""
    P = np.diag([0.0, 0.0, noise.mobility**2, noise.decay**2])
    return LinkState(np.zeros(4), P, np.array([0.0, 1.0, 0.0]))


def anew(state: LinkState) -> LinkState:
    """Return the state at the beginning of another run: the link lies elsewhere, and is the same."""
    return LinkState(state.x, state.P, np.array([0.0, state.last[1], 0.0]))


def estimate_link(
    state: LinkState, position: Array, torque: Array, period: float, noise: LinkNoise, memory: float
) -> tuple[Array, Array, Array, LinkState]:
    """Filter a block of one run.

    Parameters
    ----------
    state : of `link_start`, `anew` or of the block before
    position : shape (N,), measured q [rad], NaN where missing
    torque : shape (N,), u [N·m]; NaN where missing: the velocity is then not known any more
    period : T [s]
    noise : assumed
    memory : samples over which the innovations are averaged

    Returns
    -------
    x : shape (N, 4), states
    P : shape (N, 4, 4), covariances, as much larger as innovations are larger than the filter believes
    excess : shape (N,), that factor, at least 1
    state : to go on with
    """
    x, P, last = state.x.copy(), state.P.copy(), state.last.copy()
    xs, Ps, excess = np.empty((position.size, 4)), np.empty((position.size, 4, 4)), np.empty(position.size)
    _run(x, P, last, position, torque, period, np.array(noise), memory, xs, Ps, excess)
    return xs, Ps, excess, LinkState(x, P, last)


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    x: Array, P: Array, last: Array, q: Array, u: Array, T: float, noise: Array, memory: float,
    xs: Array, Ps: Array, excess: Array,
) -> None:  # fmt: skip
    r, torque, velocity, mobility, decay, wander = noise
    F, G, H = np.eye(4), np.zeros(4), np.zeros(4)
    for k in range(q.size):
        if last[2] == 0.0:
            if np.isnan(q[k]):
                xs[k], Ps[k], excess[k] = np.nan, np.nan, max(1.0, last[1])
                continue
            # A run begins: position and velocity anew, and independent of what is known of the link.
            x[0], x[1], last[2] = q[k], 0.0, 1.0
            P[:2, :], P[:, :2] = 0.0, 0.0
            P[0, 0], P[1, 1] = r * r, velocity * velocity
        else:
            # What acts between two samples is taken as the mean of both; where one is missing nothing is known of it.
            acting = 0.5 * (last[0] + u[k])
            known = not np.isnan(acting)
            if not known:
                acting = 0.0
            acceleration = x[2] * acting - x[3] * x[1]
            G[0], G[1] = 0.5 * T * T, T
            for i in range(2):
                F[i, 1] = (1.0 if i == 1 else T) - G[i] * x[3]
                F[i, 2], F[i, 3] = G[i] * acting, -G[i] * x[1]
            x[0] += T * x[1] + G[0] * acceleration
            x[1] += G[1] * acceleration
            P[:, :] = F @ P @ F.T
            doubt = x[2] * torque if known else velocity / T
            for i in range(2):
                for j in range(2):
                    P[i, j] += doubt * doubt * G[i] * G[j]
            P[2, 2] += (wander * mobility) ** 2 * T
            P[3, 3] += (wander * decay) ** 2 * T
            if not np.isnan(q[k]):
                innovation, variance = q[k] - x[0], P[0, 0] + r * r
                last[1] += (innovation * innovation / variance - last[1]) / memory
                H[:] = P[:, 0] / variance
                x += H * innovation
                for i in range(4):
                    for j in range(4):
                        P[i, j] -= H[i] * H[j] * variance
        last[0] = u[k]
        excess[k] = max(1.0, last[1])
        xs[k], Ps[k] = x, P * excess[k]
