"""The parameters of a pneumatic joint as the compiled plant takes them (`_pneumatic_joint.integrate_pam`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.mechanics._pneumatic_joint import Friction, Pull
from vsalog.mechanics.muscle_forces import braid_numbers
from vsalog.mechanics.pneumatic_friction import LEAST_GAUGE
from vsalog.mechanics.pneumatics import critical_ratio, orifice_flow
from vsalog.rig.schema import (
    BraidForce,
    ExponentialForce,
    LinearForce,
    Muscle,
    PneumaticJoint,
    PressureFriction,
    SimpleFriction,
    SpringForce,
    TonduFriction,
    Valve,
)

Array = NDArray[np.float64]


def air_numbers(joint: PneumaticJoint) -> Array:
    """Return the numbers of the air and of its supply, as `integrate_pam` takes them."""
    air = joint.air
    heat = air.gas_constant * air.temperature
    numbers = (air.supply_pressure, air.outside_pressure, heat, air.heat_ratio, critical_ratio(air))
    choked = float(orifice_flow(air, 1.0, 1.0, critical_ratio(air)))
    return np.array([*numbers, air.inflow_index, air.volume_index, choked])


def muscle_numbers(muscle: Muscle, valve: Valve) -> list[float]:
    """Return the numbers of a muscle and its valve."""
    volume = [muscle.volume_curvature, muscle.volume_slope, muscle.volume_constant]
    areas = [valve.area_scale * valve.inflow_area, valve.area_scale * valve.outflow_area]
    code, numbers, rest = _coded(muscle)
    numbers += [0.0] * (6 - len(numbers))
    return [muscle.length, *volume, muscle.force_gain, muscle.leak_area, *areas, code, *numbers, rest]


def _coded(muscle: Muscle) -> tuple[float, list[float], float]:
    match muscle.force:
        case LinearForce() as m:
            return Pull.LINEAR, [m.area_slope, m.area, m.passive_slope, m.passive], 1.0
        case BraidForce() as m:
            return Pull.BRAID, [*braid_numbers(m)], m.rest_length
        case ExponentialForce() as m:
            return Pull.EXPONENTIAL, [m.a1, m.a2, m.a3, m.a4, m.a5, m.a6], m.rest_length
        case SpringForce() as m:
            return Pull.SPRING, [m.c0, m.c1, m.c2, m.c3], m.rest_length


def seesaw_numbers(joint: PneumaticJoint) -> Array:
    """Return the numbers of the seesaw."""
    s = joint.seesaw
    return np.array([s.radius, s.inertia, s.return_stiffness, s.mass * s.gravity])


def friction_numbers(joint: PneumaticJoint) -> Array:
    """Return the code of the friction model and its numbers."""
    match joint.friction:
        case PressureFriction() as m:
            return np.array([Friction.PRESSURE, m.viscous, m.shaft_radius * m.shaft_coefficient, m.muscle, LEAST_GAUGE])
        case SimpleFriction() as m:
            return np.array([Friction.SIMPLE, 0.0, m.level, 0.0, 0.0])
        case TonduFriction() as m:
            return np.array([Friction.TONDU, 0.0, m.static, m.kinetic, m.speed])
    return np.array([Friction.NONE, 0.0, 0.0, 0.0, 0.0])
