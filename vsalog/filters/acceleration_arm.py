"""Observers of the joints of an arm side by side, and joint accelerations out of its accelerometers: De Luca 2007 eq. 8–12.

An axis v of an accelerometer reads v · (p̈ − g) = T(q) q̈ + W(q, q̇) (eq. 8–10). At each sample q̈ is the weighted least squares
solution of all axes (eq. 11), with T and W at the positions and velocities that the observers predict from the sample before
(eq. 12), and then drives the observers. A link acceleration that is measured itself is one more row, with T = 1 and W = 0.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Arm(NamedTuple):
    """N joints from the base on, their links, and M measured accelerations.

    Attributes
    ----------
    links : shape (N, 5): length, offset, cosine and sine of the twist, angle (Denavit–Hartenberg)
    gravity : shape (3,), in the base's frame [m/s²]
    row_link : shape (M,), index of the link each axis is mounted on
    row_direct : shape (M,), 1 for a measured link acceleration, 0 for an axis of an accelerometer
    row_point, row_axis : shape (M, 3), where it sits and its direction, in the link's frame [m]
    row_noise : shape (M,), standard deviation [m/s² or rad/s²]
    Phi, before, after : shape (N, 4, 4), of each joint's `SampledObserver`
    K : shape (N,), stiffness [N·m/rad], for where an observer begins
    farthest : shape (N,), deflection beyond which an observer has diverged [rad]
    coupling : shape (N, N), S, strictly upper triangular [kg·m²]
    reach : least arm at which a joint's acceleration is used [m]
    unit_noise : noise of an accelerometer that `reach` refers to [m/s²]
    period : T [s]
    """

    links: Array
    gravity: Array
    row_link: Integers
    row_direct: Integers
    row_point: Array
    row_axis: Array
    row_noise: Array
    Phi: Array
    before: Array
    after: Array
    K: Array
    farthest: Array
    coupling: Array
    reach: float
    unit_noise: float
    period: float


class ArmState(NamedTuple):
    """State of the observers.

    Attributes
    ----------
    x : shape (N, 4), θ, q, θ̇, q̇ of each joint
    u : shape (N, 4), the inputs of the last sample: θ, τ, q̈, Sᵀ q̈
    since : shape (N,), samples since a joint's observer began, or was last without an input; −1 while it is without one
    begun : shape (1,), 1 once all joints have begun
    """

    x: Array
    u: Array
    since: Integers
    begun: Integers


def arm_start(joints: int) -> ArmState:
    """Return the state before the first sample."""
    return ArmState(
        np.zeros((joints, 4)), np.zeros((joints, 4)), np.full(joints, -1, np.int64), np.zeros(1, dtype=np.int64)
    )


def observe_arm(
    arm: Arm, state: ArmState, theta: Array, tau: Array, y: Array
) -> tuple[Array, Array, Array, Integers, ArmState]:
    """Follow the states of all joints over a block of one run.

    A missing encoder or torque sample is replaced by the observer's prediction, and an acceleration that no axis measures is
    taken for zero; `since` says that nothing is known then. One joint's position that is wrong makes the accelerations of all
    wrong, and these the positions: where a deflection is beyond its bound, all observers begin again with the next sample.

    Parameters
    ----------
    arm, state : of `arm_start` or of the block before
    theta, tau : shape (n, N), motor positions [rad] and torques [N·m]; NaN where missing
    y : shape (n, M), measured accelerations [m/s² or rad/s²]; NaN where missing

    Returns
    -------
    x : shape (n, N, 4), θ, q, θ̇, q̇
    acceleration, deviation : shape (n, N), q̈ and its standard deviation under the accelerometers' noise [rad/s²]
    since : shape (n, N), see `ArmState`; `Since.LOST` where an observer has diverged
    state : to go on with
    """
    n, joints = theta.shape
    new = ArmState(state.x.copy(), state.u.copy(), state.since.copy(), state.begun.copy())
    x, acceleration, deviation = np.empty((n, joints, 4)), np.empty((n, joints)), np.empty((n, joints))
    since = np.empty((n, joints), dtype=np.int64)
    rows = arm.row_noise.size
    work = np.empty((joints, 27)), np.empty((rows, joints)), np.empty(rows), np.empty((joints, joints + 1))
    _run(*arm, *new, theta, tau, y, *work, x, acceleration, deviation, since)
    return x, acceleration, deviation, since, new


def axis_rows(arm: Arm, q: Array, dq: Array) -> tuple[Array, Array]:
    """Return T, shape (M, N), and W, shape (M,), of De Luca 2007 eq. 10 at one position and velocity, each of shape (N,)."""
    T, W = np.empty((arm.row_noise.size, q.size)), np.empty(arm.row_noise.size)
    frames = np.empty((q.size, 27))
    _move(arm.links, arm.gravity, q, dq, frames)
    _rows(arm.row_link, arm.row_direct, arm.row_point, arm.row_axis, frames, T, W)
    return T, W


class Since(IntEnum):
    """`since` of samples that no observer has a state of: it has not begun, or has diverged there."""

    NEVER = -1
    LOST = -2


class Frame(IntEnum):
    """Columns of a row of `frames`: rotation (9), position, ω, ω̇, p̈ − g with all q̈ zero, the joint's axis and its position."""

    ROTATION, POSITION, OMEGA, ALPHA, FELT, AXIS, PIVOT = 0, 9, 12, 15, 18, 21, 24


@njit(cache=True, error_model="numpy")
def _crossed(a0: float, a1: float, a2: float, b0: float, b1: float, b2: float) -> tuple[float, float, float]:
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@njit(cache=True, error_model="numpy")
def _felt(f: Array, k: int, r0: float, r1: float, r2: float) -> tuple[float, float, float]:
    """Return p̈ − g at r from the origin of frame `k`: tangential and centripetal added to the origin's."""
    w0, w1, w2 = f[k, Frame.OMEGA], f[k, Frame.OMEGA + 1], f[k, Frame.OMEGA + 2]
    t0, t1, t2 = _crossed(f[k, Frame.ALPHA], f[k, Frame.ALPHA + 1], f[k, Frame.ALPHA + 2], r0, r1, r2)
    v0, v1, v2 = _crossed(w0, w1, w2, r0, r1, r2)
    c0, c1, c2 = _crossed(w0, w1, w2, v0, v1, v2)
    return f[k, Frame.FELT] + t0 + c0, f[k, Frame.FELT + 1] + t1 + c1, f[k, Frame.FELT + 2] + t2 + c2


@njit(cache=True, error_model="numpy")
def _move(links: Array, gravity: Array, q: Array, dq: Array, f: Array) -> None:
    """Fill `f` with how each link moves while no joint accelerates, in the base's frame (Siciliano et al. 2009, §2.8, §3.1)."""
    before = np.zeros(27)
    before[0], before[4], before[8] = 1.0, 1.0, 1.0
    for i in range(3):
        before[Frame.FELT + i] = -gravity[i]
    for k in range(q.size):
        length, offset, ca, sa, angle = links[k]
        c, s = np.cos(q[k] + angle), np.sin(q[k] + angle)
        z0, z1, z2 = before[2], before[5], before[8]
        for i in range(3):
            x, y, z = before[3 * i], before[3 * i + 1], before[3 * i + 2]
            f[k, 3 * i] = x * c + y * s
            f[k, 3 * i + 1] = (y * c - x * s) * ca + z * sa
            f[k, 3 * i + 2] = (x * s - y * c) * sa + z * ca
            f[k, Frame.PIVOT + i] = before[Frame.POSITION + i]
            f[k, Frame.FELT + i] = before[Frame.FELT + i]
        w0, w1, w2 = before[Frame.OMEGA], before[Frame.OMEGA + 1], before[Frame.OMEGA + 2]
        f[k, Frame.AXIS], f[k, Frame.AXIS + 1], f[k, Frame.AXIS + 2] = z0, z1, z2
        f[k, Frame.OMEGA], f[k, Frame.OMEGA + 1], f[k, Frame.OMEGA + 2] = (
            w0 + dq[k] * z0,
            w1 + dq[k] * z1,
            w2 + dq[k] * z2,
        )
        t0, t1, t2 = _crossed(w0, w1, w2, z0, z1, z2)
        f[k, Frame.ALPHA] = before[Frame.ALPHA] + dq[k] * t0
        f[k, Frame.ALPHA + 1] = before[Frame.ALPHA + 1] + dq[k] * t1
        f[k, Frame.ALPHA + 2] = before[Frame.ALPHA + 2] + dq[k] * t2
        # The frame sits at the link's far end.
        r0 = f[k, 0] * length + z0 * offset
        r1 = f[k, 3] * length + z1 * offset
        r2 = f[k, 6] * length + z2 * offset
        f[k, Frame.FELT], f[k, Frame.FELT + 1], f[k, Frame.FELT + 2] = _felt(f, k, r0, r1, r2)
        f[k, Frame.POSITION] = before[Frame.POSITION] + r0
        f[k, Frame.POSITION + 1] = before[Frame.POSITION + 1] + r1
        f[k, Frame.POSITION + 2] = before[Frame.POSITION + 2] + r2
        before = f[k]


@njit(cache=True, error_model="numpy")
def _rows(link: Integers, direct: Integers, point: Array, axis: Array, f: Array, T: Array, W: Array) -> None:
    """Fill T and W of eq. 10."""
    for m in range(W.size):
        k = link[m]
        W[m] = 0.0
        for j in range(T.shape[1]):
            T[m, j] = 1.0 if direct[m] and j == k else 0.0
        if direct[m]:
            continue
        p0, p1, p2 = point[m]
        a0, a1, a2 = axis[m]
        r0 = f[k, 0] * p0 + f[k, 1] * p1 + f[k, 2] * p2
        r1 = f[k, 3] * p0 + f[k, 4] * p1 + f[k, 5] * p2
        r2 = f[k, 6] * p0 + f[k, 7] * p1 + f[k, 8] * p2
        v0 = f[k, 0] * a0 + f[k, 1] * a1 + f[k, 2] * a2
        v1 = f[k, 3] * a0 + f[k, 4] * a1 + f[k, 5] * a2
        v2 = f[k, 6] * a0 + f[k, 7] * a1 + f[k, 8] * a2
        b0, b1, b2 = _felt(f, k, r0, r1, r2)
        W[m] = v0 * b0 + v1 * b1 + v2 * b2
        for j in range(k + 1):
            l0 = f[k, Frame.POSITION] + r0 - f[j, Frame.PIVOT]
            l1 = f[k, Frame.POSITION + 1] + r1 - f[j, Frame.PIVOT + 1]
            l2 = f[k, Frame.POSITION + 2] + r2 - f[j, Frame.PIVOT + 2]
            t0, t1, t2 = _crossed(f[j, Frame.AXIS], f[j, Frame.AXIS + 1], f[j, Frame.AXIS + 2], l0, l1, l2)
            T[m, j] = v0 * t0 + v1 * t1 + v2 * t2


@njit(cache=True, error_model="numpy")
def _solve(T: Array, W: Array, y: Array, noise: Array, prior: float, N: Array, a: Array, deviation: Array) -> None:
    """Put the weighted least squares q̈ of y = T q̈ + W into `a` and its standard deviation into `deviation`.

    The normal equations, N (n, n + 1) with the right-hand side, are inverted in place by Gauss–Jordan elimination: they are
    positive definite, by the prior even where no axis sees a joint.
    """
    n = a.size
    for i in range(n):
        for j in range(n + 1):
            N[i, j] = prior if i == j else 0.0
    for m in range(W.size):
        if np.isnan(y[m]):
            continue
        weight = 1.0 / noise[m] ** 2
        for i in range(n):
            for j in range(n):
                N[i, j] += weight * T[m, i] * T[m, j]
            N[i, n] += weight * T[m, i] * (y[m] - W[m])
    for k in range(n):
        pivot = N[k, k]
        N[k, k] = 1.0
        for j in range(n + 1):
            N[k, j] /= pivot
        for i in range(n):
            if i != k:
                factor = N[i, k]
                N[i, k] = 0.0
                for j in range(n + 1):
                    N[i, j] -= factor * N[k, j]
    for i in range(n):
        a[i], deviation[i] = N[i, n], np.sqrt(max(N[i, i], 0.0))


@njit(cache=True, error_model="numpy")
def _run(
    links: Array, gravity: Array, row_link: Integers, row_direct: Integers, row_point: Array, row_axis: Array,
    row_noise: Array, Phi: Array, before: Array, after: Array, K: Array, farthest: Array, coupling: Array, reach: float,
    unit_noise: float, period: float, x: Array, u: Array, since: Integers, begun: Integers, theta: Array, tau: Array, y: Array,
    frames: Array, T: Array, W: Array, N: Array, xs: Array, acceleration: Array, deviation: Array, sinces: Integers,
) -> None:  # fmt: skip
    count, joints = theta.shape
    q, dq, now, next_x = np.empty(joints), np.empty(joints), np.empty(4), np.empty(4)
    # A direction in which no axis sees anything is kept at q̈ = 0 by the least arm that the normal equations resolve.
    prior = ROUNDING * (reach / unit_noise) ** 2
    for s in range(count):
        beginning = begun[0] == 0
        if beginning:
            ready = True
            for i in range(joints):
                ready = ready and not np.isnan(theta[s, i]) and not np.isnan(tau[s, i])
            if not ready:
                xs[s], acceleration[s], deviation[s], sinces[s] = np.nan, np.nan, np.nan, -1
                continue
            begun[0] = 1
            for i in range(joints):
                # At rest the spring holds the motor's torque.
                x[i, 0], x[i, 1], x[i, 2], x[i, 3] = theta[s, i], theta[s, i] - tau[s, i] / K[i], 0.0, 0.0
                q[i], dq[i] = x[i, 1], 0.0
        else:
            for i in range(joints):
                q[i] = x[i, 1] + period * (x[i, 3] + 0.5 * period * u[i, 2])
                dq[i] = x[i, 3] + period * u[i, 2]
        _move(links, gravity, q, dq, frames)
        _rows(row_link, row_direct, row_point, row_axis, frames, T, W)
        _solve(T, W, y[s], row_noise, prior, N, acceleration[s], deviation[s])
        lost = False
        for i in range(joints):
            seen = deviation[s, i] * reach <= unit_noise
            now[0], now[1], now[2], now[3] = theta[s, i], tau[s, i], acceleration[s, i], 0.0
            for j in range(i):
                now[3] += coupling[j, i] * acceleration[s, j]
            if np.isnan(now[0]):
                now[0], seen = x[i, 0] + period * x[i, 2], False
            if np.isnan(now[1]):
                now[1], seen = u[i, 1], False
            if not beginning:
                for r in range(4):
                    value = 0.0
                    for c in range(4):
                        value += Phi[i, r, c] * x[i, c] + before[i, r, c] * u[i, c] + after[i, r, c] * now[c]
                    next_x[r] = value
                for r in range(4):
                    x[i, r] = next_x[r]
            for c in range(4):
                u[i, c] = now[c]
            since[i] = since[i] + 1 if seen else -1
            sinces[s, i] = since[i]
            for r in range(4):
                xs[s, i, r] = x[i, r]
            lost = lost or not abs(x[i, 1] - x[i, 0]) <= farthest[i]
        if lost:
            begun[0], since[:], sinces[s] = 0, Since.NEVER.value, Since.LOST.value
