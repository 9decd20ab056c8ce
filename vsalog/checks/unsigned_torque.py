"""Whether a torque is a magnitude, and the signs that it lost, from its equation.

Signs and coefficients are found in turn, from several starts: alternating projections, as for lost phases
(Gerchberg and Saxton, "A practical algorithm for the determination of phase from image and diffraction plane pictures", Optik 35,
1972).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.constrained_fit import residual_of
from vsalog.checks.fault import Fault
from vsalog.checks.joint_equations import Equation
from vsalog.checks.undone_channels import Channels, Faults

Array = NDArray[np.float64]


def unsigned(channels: Channels, undone: Faults, role: str) -> Fault | None:
    """Return that a torque is a magnitude; None where it is not, or no equation is about it.

    The signs that it lost are left in `channels`.
    """
    x = channels.signals.roles[role]
    done = any(fault.kind == "unsigned" and role in fault.roles for fault in undone)
    if done or not (np.nanmin(x) >= 0.0 or np.nanmax(x) <= 0.0):
        return None
    equations = (channels.equation(name, undone) for name in channels.equations)
    eq = next((eq for eq in equations if eq.target == role), None)
    if eq is None:
        return None
    signs = min((_settled(eq, begin) for begin in _beginnings(channels, undone, eq)), key=lambda found: found[0])[1]
    if np.ptp(signs) == 0.0:
        return None
    channels.signs[role] = signs
    return Fault("unsigned", (role,))


def _settled(eq: Equation, signs: Array) -> tuple[float, Array]:
    """Return the residual of the equation with the signs that it converges to from some, and these."""
    size, rest = np.abs(eq.scale), eq.y - eq.scale
    least = math.inf
    while True:
        y = signs * size + rest
        left, _ = residual_of(y, eq.free, eq.positive)
        fresh = np.where(y - left - rest >= 0.0, 1.0, -1.0)
        if not (squares := float(left @ left)) < least or np.array_equal(fresh, signs):
            return min(squares, least), signs
        least, signs = squares, fresh


def _beginnings(channels: Channels, undone: Faults, eq: Equation) -> Iterator[Array]:
    """Yield initial signs: those of possible terms of a torque, negative for a third, half and two thirds of the time."""
    parts = [eq.y - eq.scale, *eq.positive.T[-3:]]
    parts += [channels.values(role, undone)[0] for role in sorted(eq.roles - {eq.target})]
    if "link_position" in eq.roles:
        q = channels.values("link_position", undone)[0]
        parts += [q - channels.values(r, undone)[0] for r in sorted(eq.roles) if r.startswith("motor_position")]
    for part in parts:
        for share in (1 / 3, 1 / 2, 2 / 3):
            yield np.where(part >= np.quantile(part, share), 1.0, -1.0)
