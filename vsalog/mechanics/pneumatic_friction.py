"""Friction of a pneumatic joint: a viscous part, a dry level that depends on the state, and Kikuuwe's discrete form.

Between steps of time the law of Shin, Ibayashi, Kogiso (2021) is T_f = c_s ψ̇ + level · sgn ψ̇ while the joint slips. At rest
T_f is whatever balances the other torques, up to the level.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.rig.schema import PneumaticJoint, PressureFriction, SimpleFriction, TonduFriction

Array = NDArray[np.float64]

LEAST_GAUGE = 1e3
"""Gauge pressure below which T_p stays as it is there [Pa]: it would grow without bound as a muscle is emptied."""


def friction_level(
    joint: PneumaticJoint, p1: ArrayLike, p2: ArrayLike, f1: ArrayLike, f2: ArrayLike, speed: ArrayLike
) -> Array:
    """Return the dry friction's level T_s + T_p, or that of the model the rig chooses [N·m], 0 or more.

    T_s = r_p μ_s |F₁ + F₂ − M g| and T_p = T_p′ (1/(P₁ − P_out)² + 1/(P₂ − P_out)²) (Shin 2021 §II-B4). The models that Table III
    compares with are F_r sgn ẋ and sgn ẋ ((f_s − f_k) exp(−ẋ/ẋ_k) + f_k) (§IV-B). Of these the paper prints numbers without
    units and leaves open whether they are forces on a muscle or torques: here they are torques over the joint's velocity, and
    the exponential takes the velocity's size, so that both directions are alike.

    Parameters
    ----------
    joint : of the rig; the level is 0 without friction
    p1, p2 : absolute pressures [Pa]
    f1, f2 : muscles' pulls [N]
    speed : ψ̇ [rad/s]; all broadcast
    """
    match joint.friction:
        case PressureFriction() as model:
            load = np.abs(np.asarray(f1) + np.asarray(f2) - joint.seesaw.mass * joint.seesaw.gravity)
            outside = joint.air.outside_pressure
            gauges = (np.maximum(np.abs(np.asarray(p) - outside), LEAST_GAUGE) for p in (p1, p2))
            tube = sum((1.0 / (gauge * gauge) for gauge in gauges), start=np.zeros(()))
            return np.asarray(model.shaft_radius * model.shaft_coefficient * load + model.muscle * tube)
        case SimpleFriction() as model:
            return np.full(np.shape(speed), model.level)
        case TonduFriction() as model:
            fall = np.exp(-np.abs(np.asarray(speed, dtype=np.float64)) / model.speed)
            return np.asarray((model.static - model.kinetic) * fall + model.kinetic)
    return np.zeros(np.shape(speed))


def viscous_coefficient(joint: PneumaticJoint) -> float:
    """Return c_s [N·m·s/rad]; the models that Table III compares with have no viscous part."""
    return joint.friction.viscous if isinstance(joint.friction, PressureFriction) else 0.0


def kikuuwe_friction(free_velocity: ArrayLike, level: ArrayLike, viscous: ArrayLike, z: ArrayLike) -> Array:
    """Return T_f of one implicit Euler step (Kikuuwe 2006; Shin 2021 eq. 10, whose print is lost in part) [N·m].

    A step without friction would end at v* = ψ̇ + Z T₀; with it the step ends at v = v* − Z T_f. Asking T_f = c_s v + level sgn v
    of the *end* of the step gives, where |v*| > Z level,

        T_f = (c_s v* + level sgn v*) / (1 + Z c_s),

    and otherwise the joint stops, v = 0, T_f = v*/Z. The paper prints Z = J / T; the units ask for T / J. As Z → 0 this is the
    law of slip and stick that the simulation solves, at order one in the step; the simulation finds the changes themselves
    instead.

    Parameters
    ----------
    free_velocity : v* [rad/s]
    level : T_s + T_p [N·m]
    viscous : c_s [N·m·s/rad]
    z : step over inertia, above 0 [s/(kg·m²)]; all broadcast
    """
    v, limit, step = (np.asarray(x, dtype=np.float64) for x in (free_velocity, level, z))
    slip = (np.asarray(viscous) * v + limit * np.sign(v)) / (1.0 + step * np.asarray(viscous))
    return np.asarray(np.where(np.abs(v) > step * limit, slip, v / step))
