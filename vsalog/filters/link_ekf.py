"""Inertia and damping of a link by an extended Kalman filter: Serio et al. (2011) eq. 10–12 and 21–25, derived again.

The link obeys I q̈ + N q̇ = u (eq. 10), u what acts on it. With a = 1/I and b = N/I it is q̈ = a u − b q̇, and over a sample

    q⁺ = q + T q̇ + ½ T² q̈,    q̇⁺ = q̇ + T q̈,

with q̈ in its middle: u the mean of both samples, and the velocity there q̇ + ½ T q̈, so that q̈ = (a u − b q̇) / (1 + ½ b T);
with the velocity at its beginning a and b would be off by ½ b T. Both are nearly constant. The link's position alone is measured.

Print of Serio 2011: eq. 11 calls 1/I x₃ and N/I x₄, but eq. 12 has q̈ = −x₃ q̇ − x₄ u: the two are exchanged there, and u has
the wrong sign.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.significance import DETECTED_OF_MANY

Array = NDArray[np.float64]


class State(IntEnum):
    """Position, velocity, a = 1/I, b = N/I."""

    POSITION, VELOCITY, MOBILITY, DECAY = range(4)


FIRST = 20.0
"""Innovations of the expected size with which the mean of the innovations begins."""
MOST_LOST = 3
"""Times that a filter may diverge before the link is known; more often the link is another than assumed."""


class LinkState(NamedTuple):
    """State of the filter.

    Attributes
    ----------
    x : shape (4,), q [rad], q̇ [rad/s], 1/I [1/(kg·m²)], N/I [1/s]
    P : shape (4, 4), their covariance
    last : shape (5,), the last u [N·m], the running mean of normalised squared innovations, whether a run has begun, how often
        1/I and N/I were forgotten because they had become impossible, and of how many innovations the mean is
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
    first_mobility, first_decay : a and b to begin with
    """

    position: float
    torque: float
    velocity: float
    mobility: float
    decay: float
    wander: float
    first_mobility: float = 0.0
    first_decay: float = 0.0


def link_start(noise: LinkNoise) -> LinkState:
    """Return the state before the first sample: nothing is known. The paper begins with a = b = 0."""
    P = np.diag([0.0, 0.0, noise.mobility**2, noise.decay**2])
    return LinkState(
        np.array([0.0, 0.0, noise.first_mobility, noise.first_decay]), P, np.array([0.0, 1.0, 0.0, 0.0, FIRST])
    )


def restarted(state: LinkState) -> LinkState:
    """Return the state at the beginning of another run: the same link at another position."""
    return LinkState(state.x, state.P, np.array([0.0, state.last[1], 0.0, *state.last[3:]]))


def estimate_link(
    state: LinkState, position: Array, torque: Array, period: float, noise: LinkNoise, memory: float
) -> tuple[Array, Array, Array, LinkState]:
    """Filter a block of one run.

    Parameters
    ----------
    state : of `link_start`, `restarted` or of the block before
    position : shape (N,), measured q [rad], NaN where missing
    torque : shape (N,), u [N·m]; NaN where missing: the velocity is then not known any more
    period : T [s]
    noise : assumed
    memory : samples over which the innovations are averaged

    Returns
    -------
    x : shape (N, 4), states; NaN where the filter begins again
    P : shape (N, 4, 4), covariances, scaled by the excess of the innovations
    excess : shape (N,), that factor, at least 1; infinite once the filter has begun again more than `MOST_LOST` times
    state : to go on with
    """
    x, P, last = state.x.copy(), state.P.copy(), state.last.copy()
    xs, Ps, excess = np.empty((position.size, 4)), np.empty((position.size, 4, 4)), np.empty(position.size)
    _run(x, P, last, position, torque, period, np.array([*noise, DETECTED_OF_MANY]), memory, xs, Ps, excess)
    return xs, Ps, excess, LinkState(x, P, last)


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    x: Array, P: Array, last: Array, q: Array, u: Array, T: float, noise: Array, memory: float,
    xs: Array, Ps: Array, excess: Array,
) -> None:  # fmt: skip
    r, torque, velocity, mobility, decay, wander, first_a, first_b, impossible = noise
    F, G, H = np.eye(4), np.zeros(4), np.zeros(4)
    for k in range(q.size):
        if last[2] == 0.0:
            if np.isnan(q[k]):
                xs[k], Ps[k], excess[k] = np.nan, np.nan, max(1.0, last[1])
                continue
            # A run begins: position and velocity are new, and independent of what is known of the link.
            x[0], x[1], last[2] = q[k], 0.0, 1.0
            P[:2, :], P[:, :2] = 0.0, 0.0
            P[0, 0], P[1, 1] = r * r, velocity * velocity
        else:
            # The torque between two samples is taken as the mean of both; where one is missing it is not known.
            mean_torque = 0.5 * (last[0] + u[k])
            known = not np.isnan(mean_torque)
            if not known:
                mean_torque = 0.0
            slower = 1.0 / (1.0 + 0.5 * x[3] * T)
            acceleration = slower * (x[2] * mean_torque - x[3] * x[1])
            middle = x[1] + 0.5 * T * acceleration
            # The effect of a force on position and velocity.
            G[0], G[1] = 0.5 * T * T * slower, T * slower
            for i in range(2):
                F[i, 1] = (1.0 if i == 1 else T) - G[i] * x[3]
                F[i, 2], F[i, 3] = G[i] * mean_torque, -G[i] * middle
            x[0] += T * x[1] + 0.5 * T * T * acceleration
            x[1] += T * acceleration
            P[:, :] = F @ P @ F.T
            # The torque's noise acts through a, which is uncertain itself: a link at rest must not drive a to zero.
            doubt = (x[2] * x[2] + P[2, 2]) * torque * torque if known else (velocity / T) ** 2
            for i in range(2):
                for j in range(2):
                    P[i, j] += doubt * G[i] * G[j]
            P[2, 2] += (wander * mobility) ** 2 * T
            P[3, 3] += (wander * decay) ** 2 * T
            if not np.isnan(q[k]):
                innovation, variance = q[k] - x[0], P[0, 0] + r * r
                last[4] = min(last[4] + 1.0, memory)
                last[1] += (innovation * innovation / variance - last[1]) / last[4]
                H[:] = P[:, 0] / variance
                x += H * innovation
                for i in range(4):
                    for j in range(4):
                        P[i, j] -= H[i] * H[j] * variance
            if _is_lost(x, P, T, impossible):
                x[:], P[:, :] = 0.0, 0.0
                x[2], P[2, 2], x[3], P[3, 3] = first_a, mobility * mobility, first_b, decay * decay
                # The next sample measures where the link is.
                last[1], last[2], last[4] = 1.0, 0.0, FIRST
                last[3] += 1.0
                xs[k], Ps[k], excess[k] = np.nan, np.nan, 1.0
                last[0] = u[k]
                continue
        last[0] = u[k]
        excess[k] = max(1.0, last[1]) if last[3] <= MOST_LOST else np.inf
        xs[k], Ps[k] = x, P * excess[k]


@njit(cache=True, error_model="numpy", nogil=True)
def _is_lost(x: Array, P: Array, T: float, impossible: float) -> bool:
    """Return whether the filter has diverged: 1/I or N/I negative by more than an `impossible` number of standard deviations, a
    link that would come to rest within a sample.
    """
    for i in (2, 3):
        if x[i] < 0.0 and x[i] * x[i] > impossible * impossible * P[i, i]:
            return True
    return not (np.isfinite(x).all() and np.isfinite(P).all() and abs(x[3]) * T < 1.0)
