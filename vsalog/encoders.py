"""Encoders that begin anew after a turn: their jumps taken out, and two of them brought onto the same turn."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TURN = 2.0 * np.pi


def unwrapped(values: Array, turn: float) -> tuple[Array, bool]:
    """Return a position without the jumps of an encoder that begins anew after a turn, and whether it has any.

    Parameters
    ----------
    values : shape (n,), NaN where missing
    turn : in the unit of the values
    """
    filled = np.isfinite(values)
    known = values if filled.all() else values[filled]
    jumps = np.abs(np.diff(known)) > 0.9 * turn
    # Only one who stays within a turn wraps; whoever has counted further jumps for another reason.
    if not jumps.any() or float(np.ptp(known)) > 1.01 * turn:
        return values, False
    out = values.copy()
    out[filled] = np.unwrap(known, period=turn)
    return out, True


def on_the_same_turn(roles: Mapping[str, Array], starts: Flags, wrapped: Collection[str]) -> dict[str, Array]:
    """Return the motor positions that have to be turned by whole turns for the deflection to begin within half a turn.

    An encoder that wraps does not tell which turn it is on, neither at the beginning nor after a gap: the motor and the
    link may begin on different sides of the jump, with most of a turn between them that is no deflection. A later run is
    put onto the turn on which it begins nearest to the one before.

    Parameters
    ----------
    roles : of a joint, on one grid [rad]
    starts : where a run begins
    wrapped : the roles that begin anew after a turn of the joint
    """
    out: dict[str, Array] = {}
    link = roles.get("link_position")
    for role, theta in roles.items():
        if link is None or not role.startswith("motor_position") or not {role, "link_position"} & set(wrapped):
            continue
        turned = theta.copy()
        phi, near = link - theta, 0.0
        for first, last in pairwise([*np.flatnonzero(starts), len(starts)]):
            known = phi[first:last][np.isfinite(phi[first:last])]
            if known.size:
                shift = TURN * np.ceil((known[0] - near) / TURN - 0.5)
                turned[first:last] += shift
                near = known[0] - shift
        if not np.array_equal(turned, theta, equal_nan=True):
            out[role] = turned
    return out
