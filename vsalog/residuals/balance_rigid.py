"""The equations of a joint whose motor and link move as one.

    motor          (B + M) q̈ + (D_θ + D_q) q̇ + friction − cogging + g(q) − τ − τ_ext      without a torque sensor
    motor          B q̈ + D_θ q̇ + friction − cogging − τ_sensor − τ                       with one between motor and link
    link           M q̈ + D_q q̇ + friction + g(q) + τ_sensor − τ_ext
    encoders       θ − q, where both are recorded

An elastic joint's equations (Flacco 2012 eq. 3–4) where the transmission is stiff.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.core.significance import DETECTED
from vsalog.effects.gravity import holding_torque
from vsalog.mechanics.links import link_weight
from vsalog.mechanics.rigid_joint import as_one
from vsalog.residuals.balance import (
    Equation,
    Motion,
    driven,
    in_angles,
    less_torques,
    recorded,
    rubbing,
    scaled,
    torque_unit,
    turned,
)
from vsalog.residuals.memory import remembered
from vsalog.rig.schema import Friction, Link, Motor, RigidJoint

Array = NDArray[np.float64]


def balance_rigid(
    joint: RigidJoint, roles: Mapping[str, Array], time: Array, spread: Mapping[str, float]
) -> list[Equation]:
    """Form every equation that the roles allow; parameters as `balance.balance`."""
    motion = rigid_motion(joint, roles, time, spread)
    q = motion.link
    if q is None:
        return []
    motor, link, slack, equations = joint.motor, joint.link, motion.slacks["link"], list[Equation]()
    external, sensor = roles.get("external_torque"), motion.torques.get("")
    if "motor_torque" in roles and sensor is not None and motor.inertia is not None:
        residual = remembered(turned, motor, q, sensor, roles["motor_torque"])
        shaped = _resisted(motor, motor.reflected.friction, q, sensor if motor.friction.load else None, slack, time)
        equations.append(recorded(Equation("motor", "motor", "N*m", residual, shaped, q[1]), motor, joint, roles))
    elif "motor_torque" in roles and sensor is None and (motor.inertia is not None or link is not None):
        one = as_one(motor, link)
        residual = remembered(driven, one, q, remembered(_against, roles["motor_torque"]), external)
        load = remembered(_weight, one, q) if one.friction.load else None
        shaped = less_torques(one.torques, 1.0, q, time, _resisted(motor, one.friction, q, load, slack, time))
        equations.append(recorded(Equation("motor", "motor", "N*m", residual, shaped, q[1]), motor, joint, roles))
    if link is not None and sensor is not None:
        residual = remembered(driven, link, q, sensor, external)
        shaped = remembered(rubbing, link.friction, q, sensor if link.friction.load else None, slack)
        shaped = less_torques(link.torques, 1.0, q, time, shaped)
        equation = Equation("link", "link", "N*m", residual, shaped, q[1])
        equations.append(in_angles(scaled(equation, torque_unit(joint, roles)), joint, roles))
    if "motor_position" in roles and "link_position" in roles:
        off = roles["motor_position"][0] - roles["link_position"][0]
        equations.append(Equation("encoders", "sensor", "rad", off))
    if "link_acceleration" in roles:
        equations.append(Equation("link_acceleration", "sensor", "rad/s^2", roles["link_acceleration"][0] - q[2]))
    return equations


def rigid_motion(joint: RigidJoint, roles: Mapping[str, Array], time: Array, spread: Mapping[str, float]) -> Motion:
    """Return the motion of a joint; see `Motion`. The motor's encoder measures it where there is one, in front of the gear."""
    role = next((r for r in ("motor_position", "link_position") if r in roles), "")
    q = roles.get(role)
    torques = {"": remembered(_value, roles["torque_sensor"])} if "torque_sensor" in roles else {}
    slack = DETECTED * spread.get(role, 0.0)
    motors = {} if q is None else {"": q}
    return Motion(roles, motors, q, {}, torques, frozenset(), frozenset(), {"": slack, "link": slack})


def _resisted(
    motor: Motor, friction: Friction, q: Array, load: Array | None, slack: float, time: Array
) -> Array | float:
    torque = remembered(rubbing, friction, q, load, slack)
    return less_torques(motor.reflected.torques, motor.gear_ratio, q, time, torque)


def _against(torque: Array) -> Array:
    return np.asarray(-torque[0])


def _value(x: Array) -> Array:
    return np.asarray(x[0])


def _weight(link: Link, q: Array) -> Array:
    """Return the torque that holds the link."""
    return np.asarray(holding_torque(link_weight(link), link.gravity_angle, q[0]))
