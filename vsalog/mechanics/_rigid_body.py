"""Compiled rigid-body dynamics of a chain of links: the recursive Newton–Euler method (Luh, Walker, Paul 1980).

A link is a row of numbers, laid out by `rigid_body.bodies`; its frame sits at its far end (Denavit–Hartenberg).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTH, OFFSET, COS_TWIST, SIN_TWIST, ANGLE, MASS, CENTRE, INERTIA = 0, 1, 2, 3, 4, 5, 6, 9
BODY = 18

# Per link, what the way out leaves for the way back: rotation (9), ω, ω̇, v̇, force, moment, arm (3 each).
SCRATCH = 27


@njit(error_model="numpy")
def _add_cross(a0: float, a1: float, a2: float, b0: float, b1: float, b2: float, out: Array, at: int) -> None:
    out[at] += a1 * b2 - a2 * b1
    out[at + 1] += a2 * b0 - a0 * b2
    out[at + 2] += a0 * b1 - a1 * b0


@njit(error_model="numpy")
def _add_centripetal(w: Array, r0: float, r1: float, r2: float, at: int) -> None:
    """Add ω̇ × r + ω × (ω × r) to w[at:]; ω stands at 9, ω̇ at 12."""
    x, y, z = w[9], w[10], w[11]
    _add_cross(w[12], w[13], w[14], r0, r1, r2, w, at)
    _add_cross(x, y, z, y * r2 - z * r1, z * r0 - x * r2, x * r1 - y * r0, w, at)


@njit(error_model="numpy")
def _outwards(body: Array, below: Array, q: float, dq: float, ddq: float, w: Array) -> None:
    """Move on from one link's ω, ω̇, v̇ (in `below`) to the next one's, and to the force and moment it takes."""
    c, s = np.cos(q + body[ANGLE]), np.sin(q + body[ANGLE])
    ca, sa = body[COS_TWIST], body[SIN_TWIST]
    w[0], w[1], w[2] = c, -s * ca, s * sa
    w[3], w[4], w[5] = s, c * ca, -c * sa
    w[6], w[7], w[8] = 0.0, sa, ca
    o0, o1, o2 = below[9], below[10], below[11] + dq
    d0, d1, d2 = below[12] + below[10] * dq, below[13] - below[9] * dq, below[14] + ddq
    p0, p1, p2 = body[LENGTH], body[OFFSET] * sa, body[OFFSET] * ca
    for i in range(3):
        w[9 + i] = w[i] * o0 + w[3 + i] * o1 + w[6 + i] * o2
        w[12 + i] = w[i] * d0 + w[3 + i] * d1 + w[6 + i] * d2
        w[15 + i] = w[i] * below[15] + w[3 + i] * below[16] + w[6 + i] * below[17]
    _add_centripetal(w, p0, p1, p2, 15)
    w[24], w[25], w[26] = p0, p1, p2
    for i in range(3):
        w[18 + i] = w[15 + i]
    _add_centripetal(w, body[CENTRE], body[CENTRE + 1], body[CENTRE + 2], 18)
    h0, h1, h2 = 0.0, 0.0, 0.0
    for i in range(3):
        o, d = w[9 + i], w[12 + i]
        h0 += body[INERTIA + i] * o
        h1 += body[INERTIA + 3 + i] * o
        h2 += body[INERTIA + 6 + i] * o
        if i == 0:
            w[21], w[22], w[23] = 0.0, 0.0, 0.0
        w[21] += body[INERTIA + i] * d
        w[22] += body[INERTIA + 3 + i] * d
        w[23] += body[INERTIA + 6 + i] * d
        w[18 + i] *= body[MASS]
    _add_cross(w[9], w[10], w[11], h0, h1, h2, w, 21)


@njit(error_model="numpy")
def inverse_dynamics(
    bodies: Array, gravity: Array, q: Array, dq: Array, ddq: Array, scratch: Array, tau: Array
) -> None:
    """Fill `tau`, shape (N,), with M(q) q̈ + C(q, q̇) q̇ + g(q) [N·m].

    Parameters
    ----------
    bodies : shape (N, 18)
    gravity : shape (3,), in the base's frame [m/s²]
    q, dq, ddq : shape (N,) [rad, rad/s, rad/s²]
    scratch : shape (N + 1, 27)
    """
    n = bodies.shape[0]
    scratch[0, :] = 0.0
    for i in range(3):
        scratch[0, 15 + i] = -gravity[i]
    for k in range(n):
        _outwards(bodies[k], scratch[k], q[k], dq[k], ddq[k], scratch[k + 1])
    f0, f1, f2, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n - 1, -1, -1):
        w, b = scratch[k + 1], bodies[k]
        # Force and moment of the links beyond come in this link's frame, about its frame's origin.
        p0, p1, p2 = w[24], w[25], w[26]
        s0, s1, s2 = p0 + b[CENTRE], p1 + b[CENTRE + 1], p2 + b[CENTRE + 2]
        m0 += w[21] + p1 * f2 - p2 * f1 + s1 * w[20] - s2 * w[19]
        m1 += w[22] + p2 * f0 - p0 * f2 + s2 * w[18] - s0 * w[20]
        m2 += w[23] + p0 * f1 - p1 * f0 + s0 * w[19] - s1 * w[18]
        f0, f1, f2 = f0 + w[18], f1 + w[19], f2 + w[20]
        # Into the frame below; its z-axis is the joint's.
        f0, f1, f2 = w[0] * f0 + w[1] * f1 + w[2] * f2, w[3] * f0 + w[4] * f1 + w[5] * f2, w[7] * f1 + w[8] * f2
        m0, m1, m2 = w[0] * m0 + w[1] * m1 + w[2] * m2, w[3] * m0 + w[4] * m1 + w[5] * m2, w[7] * m1 + w[8] * m2
        tau[k] = m2


@njit(error_model="numpy")
def mass_matrix(bodies: Array, q: Array, zero: Array, unit: Array, scratch: Array, column: Array, M: Array) -> None:
    """Fill `M`, shape (N, N), column by column; `zero` and `unit` hold zeros, shape (N,) or (3,) whichever is longer."""
    n = bodies.shape[0]
    for k in range(n):
        unit[k] = 1.0
        inverse_dynamics(bodies, zero, q, zero, unit, scratch, column)
        unit[k] = 0.0
        for i in range(n):
            M[i, k] = column[i]


@njit(cache=True, error_model="numpy")
def inverse_dynamics_over_time(bodies: Array, gravity: Array, q: Array, dq: Array, ddq: Array, tau: Array) -> None:
    """`inverse_dynamics` for arrays of shape (T, N)."""
    scratch = np.empty((bodies.shape[0] + 1, SCRATCH))
    for t in range(q.shape[0]):
        inverse_dynamics(bodies, gravity, q[t], dq[t], ddq[t], scratch, tau[t])
