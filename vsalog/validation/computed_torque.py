"""Torque channels that are not measured, but computed from another channel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.torque_independence import computed_from
from vsalog.core.finding import Finding

Array = NDArray[np.float64]


def computed_torques(joint: str, roles: Mapping[str, Array], *, lever: bool) -> dict[str, Finding]:
    """Return torque sensor's role → the finding that it is no measurement.

    Parameters
    ----------
    joint : its name
    roles : role → values, shape (N,), as a formula in the drive or in the log uses them
    lever : whether the torque over the deflection scales with the square of a lever arm, the set-point (Flacco 2012 eq. 49)
    """
    found = dict[str, Finding]()
    for suffix in ("", "_1", "_2"):
        role = f"torque_sensor{suffix}" if f"torque_sensor{suffix}" in roles else "torque_sensor"
        if role not in roles or role in found:
            continue
        own = roles[role]
        spring = own / roles["setpoint"] ** 2 if lever and "setpoint" in roles else own
        sources = [(spring, x, what) for x, what in _deflections(roles, suffix)]
        if f"motor_torque{suffix}" in roles:
            sources.append((own, roles[f"motor_torque{suffix}"], "the motor's torque"))
        why = (computed_from(torque, joint, role, x, what) for torque, x, what in sources)
        first = next((finding for finding in why if finding is not None), None)
        if first is not None:
            found[role] = first
    return found


def _deflections(roles: Mapping[str, Array], suffix: str) -> Iterator[tuple[Array, str]]:
    """Yield the deflection as measured and from the positions: a torque may be computed from either."""
    if f"deflection{suffix}" in roles:
        yield roles[f"deflection{suffix}"], "the deflection"
    if "link_position" in roles and f"motor_position{suffix}" in roles:
        yield roles["link_position"] - roles[f"motor_position{suffix}"], "the difference of the positions"
