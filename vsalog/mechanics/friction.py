"""Dry friction of a motor, from its measured motion.

Friction is known as far as the motion is: where the velocity is too small for its sign to be known, ideal friction
may be anything between minus and plus its level, and bristles begin anywhere between their extremes. So both extremes are
followed; their middle is taken as the friction, and half of their distance is the doubt.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.effects.friction import Friction
from vsalog.mechanics._atoms import STAMP, bristles_after, stribeck

Array = NDArray[np.float64]


def friction_start() -> Array:
    """Return the state before the first sample, shape (4,): extremes of the bristles' deflection, last velocity and level."""
    return np.full(4, np.nan)


def friction_block(
    state: Array, friction: Friction, velocity: Array, load: Array, floor: float, reach: float, period: float
) -> tuple[Array, Array, Array, Array]:
    """Return the torque of dry friction, but for the part that goes with the transmitted torque.

    That part is `load` |τ| · way with the transmitted torque τ, which only the estimator knows.

    Parameters
    ----------
    state : of `friction_start` or a previous call
    friction : on the joint's side of the gear
    velocity : shape (N,) [rad/s]; NaN where it is not known
    load : shape (N,), rough size of the transmitted torque [N·m], for how far bristles give way, and for the doubt
    floor : velocity whose sign is not known [rad/s]
    reach : samples on either side of a change of the velocity's sign within which it is not known either
    period : T [s]

    Returns
    -------
    state
    torque : shape (N,), opposes the motion [N·m]
    way : shape (N,), share of the level that acts, with its sign
    doubt : shape (N,), by how much the whole friction may be off [N·m]
    """
    new, out = state.copy(), np.empty((3, velocity.shape[0]))
    f = friction
    _rub(
        velocity, np.abs(load), f.coulomb, f.breakaway - f.coulomb, f.stribeck_velocity or 1.0, f.load,
        f.presliding_stiffness or 0.0, f.presliding_damping, floor, reach, period, new, out,
    )  # fmt: skip
    return new, out[0], out[1], out[2]


def _compiled_rub(stamp: str) -> Callable[..., Any]:
    """Compile it again where a formula that it calls has changed, which numba's cache does not see."""

    @njit(cache=True, error_model="numpy")
    def rub(
        velocity: Array, load: Array, coulomb: float, excess: float, slow: float, share: float, stiffness: float,
        damping: float, floor: float, reach: float, period: float, state: Array, out: Array,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        high, low, last, before = state[0], state[1], state[2], state[3]
        for k in range(velocity.shape[0]):
            v = velocity[k]
            seen = not np.isnan(v)
            near = floor if np.isnan(last) or not seen else floor + reach * abs(v - last)
            unsure = not (seen and abs(v) > near)
            base = coulomb + (stribeck(excess, slow, v if seen else 0.0) if excess > 0.0 else 0.0)
            level = base + share * load[k]
            extra = 0.0
            if stiffness > 0.0 and level > 0.0:
                limit = level / stiffness
                if not seen or np.isnan(high):
                    high, low = limit, -limit
                elif not np.isnan(last):
                    dx = 0.5 * period * (v + last)
                    if dx != 0.0:
                        middle = 0.5 * (level + before)
                        end = middle / stiffness
                        up, down = (
                            bristles_after(high, dx, end, stiffness, middle),
                            bristles_after(low, dx, end, stiffness, middle),
                        )
                        # A deflection that only noise would reduce is kept.
                        high, low = (max(high, up), min(low, down)) if unsure else (up, down)
                # Beyond 1 where the level has fallen faster than the bristles, as it does over the Stribeck velocity.
                top, bottom = high / limit, low / limit
                if seen:
                    extra = damping * (v - abs(v) * 0.5 * (top + bottom))
            else:
                top, bottom = (1.0, -1.0) if unsure else (np.sign(v), np.sign(v))
            last, before = v, level
            out[0, k] = base * 0.5 * (top + bottom) + extra
            out[1, k] = 0.5 * (top + bottom)
            out[2, k] = level * 0.5 * (top - bottom)
        state[0], state[1], state[2], state[3] = high, low, last, before

    return rub


_rub = _compiled_rub(STAMP)
