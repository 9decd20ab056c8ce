"""Which side of a joint something is wrong on: whose torque, were it free at every moment, would explain most of the residual.

A torque that is missing at a motor or at the link shows in that one equation. One that is missing in a transmission acts on both
and on the torque sensor, too, and a torque sensor that errs shows in its own equation alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles
from vsalog.residuals.system import System

Array = NDArray[np.float64]

# A torque sensor is blamed only where that leaves no more than this part of what blaming the transmission leaves: where motors
# and link are hardly determined, the two are the same.
CLEARLY = 0.5


def side_of(system: System, joint: Any, left: Array, springs: Collection[str]) -> tuple[str, int]:
    """Return the side that explains most of the residual, and the equation of that side with the largest residual.

    Parameters
    ----------
    system : of the log
    joint : of the rig, on the joint's side
    left : shape (R, m), whitened equations
    springs : suffixes of the transmissions whose deflections are measured by positions; of a deflection that follows from
        its own torque the effect cannot be separated
    """
    whole = float(np.sum(left**2))
    remains: dict[str, float] = {}
    for side, direction in _suspects(system, joint, springs):
        push = system.white(np.where(system.weights > 0.0, direction, 0.0))
        size = np.sum(push**2, axis=1)
        known = size > 0.0
        explained = float(np.sum(np.sum(left[known] * push[known], axis=1) ** 2 / size[known]))
        remains[side] = min(remains.get(side, whole), whole - explained)
    side = min(remains, key=lambda s: remains[s])
    noise = system.count
    if side == "sensor" and remains[side] + noise > CLEARLY * (remains.get("transmission", np.inf) + noise):
        side = "transmission"
    squares = np.sum(left**2, axis=0)
    own = [i for i, s in enumerate(system.sides) if s == side] or list(range(len(system.sides)))
    return side, max(own, key=lambda i: float(squares[i]))


def _suspects(system: System, joint: Any, springs: Collection[str]) -> Iterator[tuple[str, Array]]:
    """Yield sides with the change of the equations, shape (m,), that a torque there makes."""
    names = system.names
    for i, side in enumerate(system.sides):
        yield ("sensor" if springs and side == "transmission" else side), np.eye(len(names))[i]
    for suffix in springs:
        yield "transmission", spring_direction(system, joint, suffix)


def spring_direction(system: System, joint: Any, suffix: str) -> Array:
    """Return the change of the equations, shape (m,), with more torque of a spring than the rig has: see `balance`."""
    signs = {f"motor{suffix}": -1.0, "link": 1.0}
    for name in (f"transmission{suffix}", "transmission"):
        if name in system.names:
            signs[name] = -offered_roles(joint)[name.replace("transmission", "torque_sensor")].gain
    return np.array([signs.get(name, 0.0) for name in system.names])
