"""Compiled: the torque of hysteresis over a measured deflection."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.mechanics._atoms import (
    STAMP,
    Element,
    beyond_gap,
    bristles_after,
    loop_after,
    slipped,
)

Array = NDArray[np.float64]


def loop_torque(row: Array, elements: Array, phi: Array, slack: float = 0.0) -> Array:
    """Return the torque of a transmission's loops over its deflection.

    Parameters
    ----------
    row : of `mechanics.transmissions.coded`
    elements : shape (n, 2), stiffness [N·m/rad] and limit [N·m] of the slip elements
    phi : shape (N,), deflection [rad]; the loops rest while it is NaN
    slack : changes below this do not move the loops for good [rad]: noise goes to and fro and would erase them

    Returns
    -------
    shape (N,) [N·m]; the loops begin relaxed
    """
    out = np.empty_like(phi)
    width = float(row[Element.LOOP_WIDTH]) if row[Element.LOOP_TORQUE] else 0.0
    _run(
        phi, float(row[Element.HALF_GAP]), float(row[Element.LOOP_TORQUE]), width,
        float(row[Element.LOOP_EXPONENT]), float(row[Element.LOOP_SHAPE]),
        slack, elements, np.zeros(elements.shape[0]), out,
    )  # fmt: skip
    return out


def _compiled_run(stamp: str) -> Callable[..., Any]:
    """Compile it again where a formula that it calls has changed, which numba's cache does not see."""

    @njit(cache=True, error_model="numpy")
    def run(
        phi: Array, half_gap: float, height: float, width: float, exponent: float, shape: float, slack: float,
        elements: Array, slip: Array, out: Array,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        z, last = 0.0, np.nan
        for k in range(phi.shape[0]):
            x = phi[k]
            if np.isnan(x):
                out[k] = np.nan
                continue
            u = beyond_gap(x, half_gap)[0]
            if np.isnan(last):
                last = u
            du = u - last
            now = z
            if height != 0.0:
                now = loop_after(z, du, width, exponent, shape)
            torque = height * now
            moved = abs(du) > slack
            for e in range(elements.shape[0]):
                pulled = slipped(slip[e], du, elements[e, 0], elements[e, 1])
                torque += pulled
                if moved:
                    slip[e] = pulled
            if moved:
                z, last = now, u
            out[k] = torque

    return run


_run = _compiled_run(STAMP)


def bristle_torque(x: Array, level: Array, stiffness: float, slack: float) -> Array:
    """Return the torque of bristles that give way over a displacement before they slide: σ₀ z, dz = dx − σ₀ |dx| z / level.

    Parameters
    ----------
    x : shape (N,), position [rad]; the bristles rest while it is NaN
    level : shape (N,), at which they slide [N·m]
    stiffness : σ₀ [N·m/rad]
    slack : changes below this do not move the bristles for good [rad]

    Returns
    -------
    shape (N,) [N·m]; the bristles begin relaxed (Dahl; LuGre without the bristles' own damping)
    """
    out = np.empty_like(x)
    _bristles(x, level, stiffness, slack, out)
    return out


def _compiled_bristles(stamp: str) -> Callable[..., Any]:
    """Compile it again where a formula that it calls has changed, which numba's cache does not see."""

    @njit(cache=True, error_model="numpy")
    def bristles(x: Array, level: Array, stiffness: float, slack: float, out: Array) -> None:
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        torque, last = 0.0, np.nan
        for k in range(x.shape[0]):
            if np.isnan(x[k]):
                out[k] = np.nan
                continue
            if np.isnan(last):
                last = x[k]
            dx = x[k] - last
            now = bristles_after(torque, dx, level[k], stiffness, max(level[k], 1e-300))
            out[k] = now
            if abs(dx) > slack:
                torque, last = now, x[k]

    return bristles


_bristles = _compiled_bristles(STAMP)
