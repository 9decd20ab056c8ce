"""Where the links of a chain are and how they move, and what an accelerometer on one of them reads.

Everything is over time: q has the shape (…, N), and each result the same leading dimensions. Vectors are in the base's frame
unless stated otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.rig.chain import Accelerometer, Chain, ChainLink

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LinkMotion:
    """How the frame of a link moves; the frame sits at the link's far end (Denavit–Hartenberg).

    Attributes
    ----------
    rotation : shape (…, 3, 3), R; its columns are the frame's axes
    position : shape (…, 3), of the frame's origin [m]
    angular_velocity : shape (…, 3), ω [rad/s]
    angular_acceleration : shape (…, 3), ω̇ [rad/s²]
    velocity : shape (…, 3), of the frame's origin [m/s]
    acceleration : shape (…, 3), of the frame's origin [m/s²]
    """

    rotation: Array
    position: Array
    angular_velocity: Array
    angular_acceleration: Array
    velocity: Array
    acceleration: Array


def chain_motion(chain: Chain, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> list[LinkMotion]:
    """Return how each link moves, from the base to the tip (Siciliano et al. 2009, §2.8 and §3.1; all in the base's frame).

    Parameters
    ----------
    chain : of the rig, N links
    q, dq, ddq : shape (…, N) [rad, rad/s, rad/s²], broadcast
    """
    x, v, a = np.broadcast_arrays(*(np.asarray(values, dtype=np.float64) for values in (q, dq, ddq)))
    still = np.zeros((*x.shape[:-1], 3))
    base = np.broadcast_to(np.eye(3), (*x.shape[:-1], 3, 3))
    now, motions = LinkMotion(base, still, still, still, still, still), []
    for i, link in enumerate(chain.link):
        now = _next(now, link, x[..., i], v[..., i], a[..., i])
        motions.append(now)
    return motions


def point_position(motion: LinkMotion, point: ArrayLike) -> Array:
    """Return where a point of a link is [m], shape (…, 3); `point` is x, y, z in the link's frame [m]."""
    return motion.position + motion.rotation @ np.asarray(point, dtype=np.float64)


def point_acceleration(motion: LinkMotion, point: ArrayLike) -> Array:
    """Return the acceleration of a point of a link, p̈ + ω̇ × r + ω × (ω × r) [m/s²], shape (…, 3)."""
    arm = motion.rotation @ np.asarray(point, dtype=np.float64)
    return motion.acceleration + _turning(motion.angular_velocity, motion.angular_acceleration, arm)


def specific_force(motion: LinkMotion, mounting: Accelerometer, gravity: ArrayLike) -> Array:
    """Return what an accelerometer on a link reads along its own axes, Rᵀ (a − g) [m/s²]: g upwards when at rest.

    Parameters
    ----------
    motion : of the link
    mounting : where the sensor sits on it
    gravity : g, shape (3,) [m/s²], pointing down

    Returns
    -------
    shape (…, 3)
    """
    felt = point_acceleration(motion, mounting.position) - np.asarray(gravity, dtype=np.float64)
    axes = motion.rotation @ rotation_of(mounting.orientation)
    return np.asarray(np.einsum("...ji,...j->...i", axes, felt))


def rotation_of(angles: ArrayLike) -> Array:
    """Return R_z(yaw) R_y(pitch) R_x(roll), shape (3, 3), for (roll, pitch, yaw) [rad]."""
    roll, pitch, yaw = np.asarray(angles, dtype=np.float64)
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.asarray(about_z @ about_y @ about_x)


def _next(before: LinkMotion, link: ChainLink, q: Array, dq: Array, ddq: Array) -> LinkMotion:
    """Move on to the next link's frame: R_z(q + angle) T_z(offset) T_x(length) R_x(twist)."""
    c, s = np.cos(q + link.angle), np.sin(q + link.angle)
    ca, sa = np.cos(link.twist), np.sin(link.twist)
    zero = np.zeros_like(c)
    turn = np.stack(
        [
            np.stack([c, -s * ca, s * sa], axis=-1),
            np.stack([s, c * ca, -c * sa], axis=-1),
            np.stack([zero, zero + sa, zero + ca], axis=-1),
        ],
        axis=-2,
    )
    along = np.stack([link.length * c, link.length * s, zero + link.offset], axis=-1)
    arm = np.einsum("...ij,...j->...i", before.rotation, along)
    axis, rate = before.rotation[..., :, 2], dq[..., None]
    omega = before.angular_velocity + rate * axis
    alpha = before.angular_acceleration + ddq[..., None] * axis + rate * _cross(before.angular_velocity, axis)
    return LinkMotion(
        before.rotation @ turn,
        before.position + arm,
        omega,
        alpha,
        before.velocity + _cross(omega, arm),
        before.acceleration + _turning(omega, alpha, arm),
    )


def _turning(omega: Array, alpha: Array, arm: Array) -> Array:
    """Return ω̇ × r + ω × (ω × r): the tangential and the centripetal acceleration."""
    return np.asarray(_cross(alpha, arm) + _cross(omega, _cross(omega, arm)))


def _cross(a: Array, b: Array) -> Array:
    """Return a × b along the last axis: numpy's own takes ten times as long over a single sample."""
    x, y = np.broadcast_arrays(a, b)
    out = np.empty(x.shape)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = x[..., j] * y[..., k] - x[..., k] * y[..., j]
    return out
