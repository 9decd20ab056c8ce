"""Compiled: the deflection under a torque that was measured, sample after sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.mechanics._atoms import STAMP, Element, loop_after, slipped, spring

Array = NDArray[np.float64]

LEAST = 0.05
"""Part of a spring's slope in the middle below which the slope elsewhere is not trusted for a Newton step."""
# Weights of the samples before in a rate of the deflection (backward differences, of orders 1 to 4; those of Gear, which do not
# swing however small a damping is): the sample's own weight, then those of the samples before.
RATES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.0, -1.0, 0.0, 0.0, 0.0],
        [1.5, -2.0, 0.5, 0.0, 0.0],
        [11.0 / 6.0, -3.0, 1.5, -1.0 / 3.0, 0.0],
        [25.0 / 12.0, -4.0, 3.0, -4.0 / 3.0, 0.25],
    ]
)


def deflection_under(
    row: Array, elements: Array, torque: Array, arm: Array, time: Array, limit: float, slack: float, near: float
) -> Array:
    """Return the deflection at which spring, damping and loops together transmit a torque.

    Parameters
    ----------
    row : of `mechanics.transmissions.coded`
    elements : shape (n, 2), stiffness [N·m/rad] and limit [N·m] of the slip elements
    torque : shape (N,) [N·m]; loops and damping begin again after NaN
    arm : shape (N,), lever arm [m]; anything where there is none
    time : shape (N,), evenly spaced [s]
    limit : largest deflection that the spring has [rad]
    slack : changes of the torque below this do not move the loops for good [N·m]
    near : accuracy of the torque [N·m]

    Returns
    -------
    shape (N,) [rad]
    """
    out = np.empty_like(torque)
    period = float(time[1] - time[0]) if time.size > 1 else 1.0
    _follow(row, elements, torque, arm, time, period, limit, slack, near, RATES, np.zeros(len(elements)), out)
    return out


def _compiled_follow(stamp: str) -> Callable[..., Any]:
    """Compile it again where a formula that it calls has changed, which numba's cache does not see."""

    @njit(cache=True, error_model="numpy")
    def follow(
        row: Array, elements: Array, torque: Array, arm: Array, time: Array, period: float, limit: float, slack: float,
        near: float, rates: Array, slip: Array, out: Array,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        half, damping = row[Element.HALF_GAP], row[Element.DAMPING]
        past = np.zeros(4)
        z, rest, felt, known = 0.0, 0.0, np.nan, 0
        for k in range(torque.shape[0]):
            if np.isnan(torque[k]) or np.isnan(arm[k]):
                out[k], known = np.nan, 0
                continue
            # The rate follows from the samples before; a new start is at rest.
            order = min(known, 4)
            own, before = damping * rates[order, 0] / period, 0.0
            for j in range(order):
                before += damping * rates[order, j + 1] / period * past[j]
            guess = past[0] if order else 0.0
            if np.isnan(felt):
                guess, rest, felt = _solve(row, elements, slip, False, z, 0.0, torque[k], arm[k], time[k], 0.0, 0.0, 0.0,
                                           limit, near), 0.0, torque[k]  # fmt: skip
                rest = guess
            u = _solve(row, elements, slip, True, z, rest, torque[k], arm[k], time[k], own, before, guess, limit, near)
            if abs(torque[k] - felt) > slack:
                z = (
                    loop_after(
                        z, u - rest, row[Element.LOOP_WIDTH], row[Element.LOOP_EXPONENT], row[Element.LOOP_SHAPE]
                    )
                    if row[Element.LOOP_TORQUE]
                    else z
                )
                for e in range(elements.shape[0]):
                    slip[e] = slipped(slip[e], u - rest, elements[e, 0], elements[e, 1])
                rest, felt = u, torque[k]
            past[3], past[2], past[1], past[0] = past[2], past[1], past[0], u
            known += 1
            out[k] = u + half if u > 0.0 else u - half if u < 0.0 else 0.0

    return follow


_follow = _compiled_follow(STAMP)


def _compiled_solve(stamp: str) -> Callable[..., Any]:
    """Compile it again where a formula that it calls has changed, which numba's cache does not see."""

    @njit(cache=True, error_model="numpy")
    def solve(
        row: Array, elements: Array, slip: Array, loops: bool, z: float, rest: float, torque: float, arm: float, t: float,
        own: float, before: float, guess: float, limit: float, near: float,
    ) -> float:  # fmt: skip
        """Return the deflection beyond the gap at which the torques balance: Newton's steps, halved between known bounds."""
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        width = row.shape[0]
        soft = max(spring(row, 0, width, 0.0, 1.0, arm, t)[2], 1e-9)
        low, high, u = -limit, limit, min(max(guess, -limit), limit)
        # After this number of halvings, bounds are known to the last bit.
        for _ in range(60):
            _, off, slope = spring(row, 0, width, u, 1.0 if u >= 0.0 else -1.0, arm, t)
            # At its singularity a mechanism's torque is no number: far too much.
            if np.isnan(off):
                off, slope = np.copysign(1e12, u), 0.0
            off += own * u + before - torque
            slope = max(slope, LEAST * soft) + own
            if loops and row[Element.LOOP_TORQUE] != 0.0:
                du = u - rest
                now = loop_after(z, du, row[Element.LOOP_WIDTH], row[Element.LOOP_EXPONENT], row[Element.LOOP_SHAPE])
                off += row[Element.LOOP_TORQUE] * now
                # Going on it saturates towards ±1, turning back it has the full slope.
                way = 1.0 if du >= 0.0 else -1.0
                slope += row[Element.LOOP_TORQUE] / row[Element.LOOP_WIDTH] * max(1.0 - way * now, 0.0)
            if loops:
                for e in range(elements.shape[0]):
                    pulled = slip[e] + elements[e, 0] * (u - rest)
                    bounded = min(max(pulled, -elements[e, 1]), elements[e, 1])
                    off += bounded
                    slope += elements[e, 0] if bounded == pulled else 0.0
            if abs(off) <= near:
                break
            if off > 0.0:
                high = min(high, u)
            else:
                low = max(low, u)
            trial = u - off / slope
            # A bound that was never reached does not locate the deflection: half way to it is too far at first.
            if not (low < trial < high):
                trial = 0.5 * (low + high)
            if trial == u:
                break
            u = trial
        return u

    return solve


_solve = _compiled_solve(STAMP)
