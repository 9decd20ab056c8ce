"""Compiled rigid-body dynamics of a chain of links: the recursive Newton–Euler method (Luh, Walker, Paul 1980).

A link is 18 numbers, laid out by `rigid_body.bodies`; its frame sits at its far end (Denavit–Hartenberg).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Body(IntEnum):
    """Layout of a link's numbers; the centre of mass has 3, the inertia about it 9."""

    LENGTH, OFFSET, COS_TWIST, SIN_TWIST, ANGLE, MASS, CENTRE, INERTIA, END = 0, 1, 2, 3, 4, 5, 6, 9, 18


class Row(IntEnum):
    """Rows of the work array: position, velocity, acceleration and torque of the joints, then the base and the links."""

    Q, DQ, DDQ, TAU, BASE = range(5)


class Left(IntEnum):
    """What the outward pass stores in a link's row for the inward pass: rotation (9), ω, ω̇, v̇, force, moment, arm (3 each)."""

    ROTATION, OMEGA, ALPHA, ACCELERATION, FORCE, MOMENT, ARM, END = 0, 9, 12, 15, 18, 21, 24, 27


@njit(error_model="numpy")
def _add_cross(a0: float, a1: float, a2: float, b0: float, b1: float, b2: float, w: Array, row: int, at: int) -> None:
    w[row, at] += a1 * b2 - a2 * b1
    w[row, at + 1] += a2 * b0 - a0 * b2
    w[row, at + 2] += a0 * b1 - a1 * b0


@njit(error_model="numpy")
def _add_centripetal(w: Array, k: int, r0: float, r1: float, r2: float, at: int) -> None:
    """Add ω̇ × r + ω × (ω × r) to w[k, at:]; ω is at 9, ω̇ at 12."""
    x, y, z = w[k, 9], w[k, 10], w[k, 11]
    _add_cross(w[k, 12], w[k, 13], w[k, 14], r0, r1, r2, w, k, at)
    _add_cross(x, y, z, y * r2 - z * r1, z * r0 - x * r2, x * r1 - y * r0, w, k, at)


@njit(error_model="numpy")
def _outwards(numbers: Array, at: int, w: Array, k: int, q: float, dq: float, ddq: float) -> None:
    """Move on from ω, ω̇, v̇ of row k − 1 to those of row k, and to the force and moment its link takes."""
    c, s = np.cos(q + numbers[at + Body.ANGLE]), np.sin(q + numbers[at + Body.ANGLE])
    ca, sa = numbers[at + Body.COS_TWIST], numbers[at + Body.SIN_TWIST]
    w[k, 0], w[k, 1], w[k, 2] = c, -s * ca, s * sa
    w[k, 3], w[k, 4], w[k, 5] = s, c * ca, -c * sa
    w[k, 6], w[k, 7], w[k, 8] = 0.0, sa, ca
    b = k - 1
    o0, o1, o2 = w[b, 9], w[b, 10], w[b, 11] + dq
    d0, d1, d2 = w[b, 12] + w[b, 10] * dq, w[b, 13] - w[b, 9] * dq, w[b, 14] + ddq
    for i in range(3):
        w[k, 9 + i] = w[k, i] * o0 + w[k, 3 + i] * o1 + w[k, 6 + i] * o2
        w[k, 12 + i] = w[k, i] * d0 + w[k, 3 + i] * d1 + w[k, 6 + i] * d2
        w[k, 15 + i] = w[k, i] * w[b, 15] + w[k, 3 + i] * w[b, 16] + w[k, 6 + i] * w[b, 17]
    p0, p1, p2 = numbers[at + Body.LENGTH], numbers[at + Body.OFFSET] * sa, numbers[at + Body.OFFSET] * ca
    _add_centripetal(w, k, p0, p1, p2, 15)
    w[k, 24], w[k, 25], w[k, 26] = p0, p1, p2
    for i in range(3):
        w[k, 18 + i] = w[k, 15 + i]
    _add_centripetal(w, k, numbers[at + Body.CENTRE], numbers[at + Body.CENTRE + 1], numbers[at + Body.CENTRE + 2], 18)
    h0, h1, h2, n0, n1, n2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        o, d = w[k, 9 + i], w[k, 12 + i]
        i0, i1, i2 = (
            numbers[at + Body.INERTIA + i],
            numbers[at + Body.INERTIA + 3 + i],
            numbers[at + Body.INERTIA + 6 + i],
        )
        h0, h1, h2 = h0 + i0 * o, h1 + i1 * o, h2 + i2 * o
        n0, n1, n2 = n0 + i0 * d, n1 + i1 * d, n2 + i2 * d
        w[k, 18 + i] *= numbers[at + Body.MASS]
    w[k, 21], w[k, 22], w[k, 23] = n0, n1, n2
    _add_cross(w[k, 9], w[k, 10], w[k, 11], h0, h1, h2, w, k, 21)


@njit(error_model="numpy")
def inverse_dynamics(numbers: Array, at: int, count: int, field: int, weight: float, w: Array, first: int) -> None:
    """Put M(q) q̈ + C(q, q̇) q̇ + g(q) [N·m] into the row TAU.

    Parameters
    ----------
    numbers, at, count : the links are in numbers[at : at + 18 count]
    field, weight : gravity in the base's frame [m/s²] is in numbers[field : field + 3] and is multiplied with `weight`
    w, first : work array, shape (first + 5 + count or more, 27 or more); its rows Q, DQ, DDQ count from `first`
    """
    base = first + Row.BASE
    for i in range(Left.END):
        w[base, i] = 0.0
    for i in range(3):
        w[base, 15 + i] = -weight * numbers[field + i]
    for k in range(count):
        _outwards(
            numbers,
            at + Body.END * k,
            w,
            base + 1 + k,
            w[first + Row.Q, k],
            w[first + Row.DQ, k],
            w[first + Row.DDQ, k],
        )
    f0, f1, f2, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(count - 1, -1, -1):
        r, c = base + 1 + k, at + Body.END * k + Body.CENTRE
        # Force and moment of the links beyond come in this link's frame, about its frame's origin.
        p0, p1, p2 = w[r, 24], w[r, 25], w[r, 26]
        s0, s1, s2 = p0 + numbers[c], p1 + numbers[c + 1], p2 + numbers[c + 2]
        m0 += w[r, 21] + p1 * f2 - p2 * f1 + s1 * w[r, 20] - s2 * w[r, 19]
        m1 += w[r, 22] + p2 * f0 - p0 * f2 + s2 * w[r, 18] - s0 * w[r, 20]
        m2 += w[r, 23] + p0 * f1 - p1 * f0 + s0 * w[r, 19] - s1 * w[r, 18]
        f0, f1, f2 = f0 + w[r, 18], f1 + w[r, 19], f2 + w[r, 20]
        # Into the frame below; its z-axis is the joint's.
        f0, f1, f2 = (
            w[r, 0] * f0 + w[r, 1] * f1 + w[r, 2] * f2,
            w[r, 3] * f0 + w[r, 4] * f1 + w[r, 5] * f2,
            w[r, 7] * f1 + w[r, 8] * f2,
        )
        m0, m1, m2 = (
            w[r, 0] * m0 + w[r, 1] * m1 + w[r, 2] * m2,
            w[r, 3] * m0 + w[r, 4] * m1 + w[r, 5] * m2,
            w[r, 7] * m1 + w[r, 8] * m2,
        )
        w[first + Row.TAU, k] = m2


@njit(cache=True, error_model="numpy")
def inverse_dynamics_over_time(numbers: Array, field: int, q: Array, dq: Array, ddq: Array, tau: Array) -> None:
    """`inverse_dynamics` for arrays of shape (T, N)."""
    count = q.shape[1]
    w = np.zeros((Row.BASE + 1 + count, max(Left.END.value, count)))
    for t in range(q.shape[0]):
        for k in range(count):
            w[Row.Q, k], w[Row.DQ, k], w[Row.DDQ, k] = q[t, k], dq[t, k], ddq[t, k]
        inverse_dynamics(numbers, 0, count, field, 1.0, w, 0)
        for k in range(count):
            tau[t, k] = w[Row.TAU, k]
