"""The factor by which a channel is out of proportion to the others, where an equation determines it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from vsalog.checks.constrained_fit import residual_of
from vsalog.checks.fault import RULE, Fault, unit_factors
from vsalog.checks.joint_equations import Equation
from vsalog.checks.late_channels import least
from vsalog.checks.undone_channels import Channels, Faults

Array = NDArray[np.float64]


def scaled(channels: Channels, undone: Faults, roles: tuple[str, ...]) -> Iterator[Fault]:
    """Yield that roles are in another unit or out of proportion by one factor, where an equation contains the first.

    A factor that is no larger than a sensor's gain may be is one.
    """
    role = roles[0]
    if role in channels.unknown_scale:
        return
    for factor in unit_factors(role):
        if _is_told(channels, undone, unit := Fault("unit", roles, factor=factor)):
            yield unit
    for name in channels.equations:
        slope = _slope(channels, channels.equation(name, undone), undone, role) if role in channels.read[name] else 0.0
        if slope > 0.0 and abs(math.log(slope)) > math.log(RULE.scale):
            yield _refined(channels, undone, roles, slope)
        elif slope > 0.0 and channels.touched(gain := Fault("gain", roles), undone):
            yield replace(gain, factor=slope * math.exp(_most_likely(channels, undone, gain, slope)))


def _is_told(channels: Channels, undone: Faults, unit: Fault) -> bool:
    """Return whether half and twice a unit's factor explain channels worse: a torque near zero determines no factor."""
    touched = channels.touched(unit, undone)
    by_unit = channels.trial((*undone, unit), touched)
    others = (replace(unit, factor=by * unit.factor) for by in (0.5, 2.0))
    return by_unit.is_better(channels.trial(undone, touched)) and all(
        by_unit.is_better(channels.trial((*undone, other), touched)) for other in others
    )


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
    if kind in ("rate", "drive"):
        # y is the target less what it should be.
        target, should = eq.scale - eq.scale.mean(), eq.scale - eq.y
        slope = float(target @ (should - should.mean()) / np.sum((should - should.mean()) ** 2))
        return slope if role == eq.target else 1.0 / slope if slope > 0.0 else 0.0
    if kind == "pair" and role == motor:
        q, theta = eq.scale - eq.scale.mean(), eq.scale - eq.y
        return float((theta - theta.mean()) @ q / (q @ q))
    if eq.elastic and role.startswith(("motor_position", "link_position")) and motor and "link_position" in eq.roles:
        q, theta = channels.values("link_position", undone), channels.values(motor, undone)
        columns = np.column_stack((np.ones(q.shape[1]), q[0], theta[0], q[1], theta[1], theta[2]))
        _, of_q, of_theta, *_ = np.linalg.lstsq(columns, eq.y, rcond=None)[0].tolist()
        over, under = (of_q, of_theta) if role == motor else (of_theta, of_q)
        # With both positions of one joint, the other one's factor is equivalent.
        return 0.0 if under == 0.0 or (role != motor and "pair " in channels.equations) else -float(over / under)
    return 0.0


def _by_grid(channels: Channels, undone: Faults, role: str) -> float:
    """Return the least power of two, up or down, with a residual of noise alone; else the one that explains the channels best.

    For a torque near zero many powers do. The losses of gears are smaller.
    """
    one = Fault("scale", (role,))
    touched, now = channels.touched(one, undone), channels.trial(undone)
    powers = sorted((2.0**k for k in range(-10, 11)), key=lambda s: abs(math.log(s)))
    tried = {s: (*undone, replace(one, factor=s)) for s in powers}
    for s, faults in tried.items():
        if abs(math.log(s)) > math.log(RULE.scale) and not channels.wrong(faults, touched):
            return s
    return max(powers, key=lambda s: channels.trial(tried[s], touched).better(now))


def _most_likely(channels: Channels, undone: Faults, gain: Fault, slope: float) -> float:
    """Return the exponent, near zero, by which a gain has to differ from a slope to explain the channels best."""
    touched, now = channels.touched(gain, undone), channels.trial(undone)

    def left(exponent: float) -> float:
        fault = replace(gain, factor=slope * math.exp(exponent))
        return -channels.trial((*undone, fault), touched).better(now)

    near = math.log1p(RULE.unit_tolerance)
    return float(minimize_scalar(left, bounds=(-near, near), method="bounded").x)


def _refined(channels: Channels, undone: Faults, roles: tuple[str, ...], slope: float) -> Fault:
    """Return the factor near one that explains the channels best, as a unit where it is one's."""
    one = Fault("scale", roles)
    touched, now = channels.touched(one, undone), channels.trial(undone)

    def left(exponent: float) -> float:
        fault = replace(one, factor=slope * math.exp(exponent))
        return -channels.trial((*undone, fault), touched).better(now)

    finest = 0.05 * RULE.unit_tolerance
    factor = slope * math.exp(least(left, 0.25, 0.05, finest) or 0.0)
    # A torque may be out of proportion by as much as gears lose, whatever its unit.
    tolerance = math.log(RULE.scale if "torque" in roles[0] else 1.0 + RULE.unit_tolerance)
    for unit in unit_factors(roles[0]):
        if abs(math.log(factor / unit)) < tolerance:
            return Fault("unit", roles, factor=unit)
    return replace(one, factor=factor)
