"""By what factor a channel is out of proportion to the others, where an equation tells it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.constrained_fit import residual_of
from vsalog.checks.fault import RULE, Fault, unit_factors
from vsalog.checks.joint_equations import Equation
from vsalog.checks.late_channels import least
from vsalog.checks.undone_channels import Channels, Faults

Array = NDArray[np.float64]


def scaled(channels: Channels, undone: Faults, role: str) -> Iterator[Fault]:
    """Yield that a role is in another unit or out of proportion, where an equation tells."""
    if role in channels.unknown_scale:
        return
    for factor in unit_factors(role):
        yield Fault("unit", (role,), factor=factor)
    for name in channels.equations:
        slope = _slope(channels, channels.equation(name, undone), undone, role) if role in channels.read[name] else 0.0
        if slope > 0.0 and abs(math.log(slope)) > math.log(RULE.scale):
            yield _refined(channels, undone, role, slope)


def _slope(channels: Channels, eq: Equation, undone: Faults, role: str) -> float:
    """Return the factor that an equation gives a role by itself; 0 where it gives none."""
    kind = eq.name.split(" ")[0]
    motor = next((r for r in sorted(eq.roles) if r.startswith("motor_position")), "")
    if (
        kind == "motor"
        and role == eq.target
        and any(r.startswith("torque_sensor") for r in eq.roles - channels.unknown_scale)
    ):
        # τ_m = s (B θ̈ + … − τ_e): the sensor's torque becomes a column.
        _, x = residual_of(eq.scale, eq.free, np.column_stack((eq.positive, eq.scale - eq.y)))
        return float(x[-1]) or _by_grid(channels, undone, role)
    if kind == "pair" and role == motor:
        q, theta = eq.scale - eq.scale.mean(), eq.scale - eq.y
        return float((theta - theta.mean()) @ q / (q @ q))
    if kind == "spring" and role.startswith(("motor_position", "link_position")) and motor:
        q, theta = channels.values("link_position", undone), channels.values(motor, undone)
        columns = np.column_stack((np.ones(q.shape[1]), q[0], theta[0], q[1], theta[1]))
        _, of_q, of_theta, *_ = np.linalg.lstsq(columns, eq.y, rcond=None)[0].tolist()
        over, under = (of_q, of_theta) if role == motor else (of_theta, of_q)
        # With both positions of one joint, the other one's factor says the same.
        return 0.0 if under == 0.0 or (role != motor and "pair " in channels.equations) else -float(over / under)
    return 0.0


def _by_grid(channels: Channels, undone: Faults, role: str) -> float:
    """Return the power of two that explains the channels best."""
    one = Fault("scale", (role,))
    touched, now = channels.touched(one), channels.trial(undone)
    powers = [2.0**k for k in range(-10, 11)]
    return max(powers, key=lambda s: channels.trial((*undone, replace(one, factor=s)), touched).better(now))


def _refined(channels: Channels, undone: Faults, role: str, slope: float) -> Fault:
    """Return the factor near one that explains the channels best, as a unit where it is one's."""
    one = Fault("scale", (role,))
    touched, now = channels.touched(one), channels.trial(undone)

    def left(exponent: float) -> float:
        fault = replace(one, factor=slope * math.exp(exponent))
        return -channels.trial((*undone, fault), touched).better(now)

    finest = 0.05 * RULE.unit_tolerance
    factor = slope * math.exp(least(left, 0.25, 0.05, finest) or 0.0)
    for unit in unit_factors(role):
        if abs(factor / unit - 1.0) < RULE.unit_tolerance:
            return Fault("unit", (role,), factor=unit)
    return replace(one, factor=factor)
