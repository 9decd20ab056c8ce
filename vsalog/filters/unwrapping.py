"""Encoders that wrap after a turn: their jumps are removed, and two of them are put onto the same turn."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

WRAP_JUMP = 0.9
"""A larger jump is one to the next turn [turns]: a joint turns less than the rest from one sample to the next."""

WRAPPED_SPAN = 1.01
"""Range that the readings of an encoder that wraps stay in [turns]: one, and its noise."""


@dataclass(frozen=True, slots=True)
class Unwrapping:
    """The state of unwrapping an encoder: the last number before, and its correction; NaN before the first."""

    last: float = np.nan
    correction: float = 0.0


def wraps_around(span: float, turn: float) -> bool:
    """Return whether an encoder that jumps wraps: only one that stays within a turn does; one with a larger range jumps for
    another reason.
    """
    return span <= WRAPPED_SPAN * turn


def unwrapped_on(values: Array, turn: float, before: Unwrapping) -> tuple[Array, Unwrapping]:
    """Remove the jumps from the next part of an encoder's positions.

    Corrections are summed up in the order of the samples, so that it does not matter how a log is cut into parts.

    Parameters
    ----------
    values : shape (n,), NaN where missing
    turn : in the unit of the values
    before : the state after the part before
    """
    filled = np.isfinite(values)
    known = values[filled]
    if not known.size:
        return values, before
    steps = np.diff(known, prepend=known[0] if np.isnan(before.last) else before.last)
    short = np.mod(steps + 0.5 * turn, turn) - 0.5 * turn
    # Half a turn is ambiguous: the previous direction is kept.
    short[(short == -0.5 * turn) & (steps > 0.0)] = 0.5 * turn
    correction = np.where(np.abs(steps) < 0.5 * turn, 0.0, short - steps)
    correction = np.cumsum(np.concatenate(([before.correction], correction)))[1:]
    out = values.copy()
    out[filled] = known + correction
    return out, Unwrapping(float(known[-1]), float(correction[-1]))


@dataclass(slots=True)
class SameTurn:
    """The shift of a motor's position in the present run, and the deflection that the next run begins nearest to.

    Attributes
    ----------
    shift : [rad], NaN as long as the run has shown no deflection
    near : [rad]
    ever : whether any number was moved
    """

    shift: float = np.nan
    near: float = 0.0
    ever: bool = False


def turnable(roles: Collection[str], wrapped: Collection[str]) -> list[str]:
    """Return the motor positions that may be on another turn than the link."""
    motors = [role for role in roles if role.startswith("motor_position")] if "link_position" in roles else []
    return [role for role in motors if {role, "link_position"} & set(wrapped)]


def turned_on(link: Array, theta: Array, starts: Flags, state: SameTurn) -> Array:
    """Return the next part of a motor's position, turned by whole turns for the deflection to begin within half a turn.

    An encoder that wraps does not determine its turn, neither at the beginning nor after a gap: the motor and the
    link may begin on different sides of the jump, with most of a turn between them that is no deflection. A later run is
    put onto the turn on which it begins nearest to the one before.

    Parameters
    ----------
    link, theta : shape (n,) [rad]
    starts : shape (n,), where a run begins; a run that continues from the part before shows its deflection within its first part
    state : that after the part before; updated to that after this one
    """
    turned = theta.copy()
    phi = link - theta
    edges = np.flatnonzero(starts)
    for first, last in pairwise([*([] if starts.size and starts[0] else [0]), *edges, len(starts)]):
        if first < len(starts) and starts[first]:
            state.shift = np.nan
        if np.isnan(state.shift):
            known = phi[first:last][np.isfinite(phi[first:last])]
            if not known.size:
                continue
            state.shift = math.tau * np.ceil((known[0] - state.near) / math.tau - 0.5)
            state.near = known[0] - state.shift
        if state.shift:
            turned[first:last] += state.shift
            state.ever = state.ever or bool(np.isfinite(theta[first:last]).any())
    return turned
