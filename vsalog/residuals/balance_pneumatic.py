"""The equations that a pneumatic joint's roles allow, as residuals: not zero where the rig and the log disagree.

    seesaw          J ψ̈ + k_s ψ + T_f − τ(P₁, P₂, ψ) − τ_ext                  (Shin 2021 eq. 8–10)
    transmission    τ_sensor − τ(P₁, P₂, ψ)                                   (eq. 9)
    pressure_1, _2  Ṗ + k₂ (V̇/V) P − k₁ R T (m(P, u) − leak) / V              (eq. 4)
    link_position   ψ_sensor − ψ of a seesaw that is clamped

One role of ψ, P₁ and P₂ may be missing: the torque meter determines it through the muscles' forces, which uses up its equation;
without a meter the seesaw's equation determines a pressure. An angle without an encoder, a meter or a clamp leaves
nothing: every equation holds it, and only a simulation of the seesaw under its muscles could determine it.
Without its valve's voltage a muscle has no equation of pressure. A clamp's torque is not measured: a clamped seesaw has none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from vsalog.core.significance import DETECTED
from vsalog.mechanics.pneumatic_friction import friction_level, viscous_coefficient
from vsalog.mechanics.pneumatics import (
    joint_torque,
    muscle_lengths,
    muscle_pulls,
    muscle_volume,
    orifice_flow,
    valve_flow,
    valve_opening,
    volume_slope,
)
from vsalog.residuals._inverse import LEAST
from vsalog.residuals.balance import Equation, Motion
from vsalog.residuals.channels import WINDOW
from vsalog.residuals.sensing import known
from vsalog.rig.schema import PneumaticJoint

Array = NDArray[np.float64]

ANGLE, PRESSURES = "link_position", ("pressure_1", "pressure_2")
ABOUT = 1.4
"""Windows of the filter over which the direction of a motion has to be the same to be known."""
CREEP = 0.1
"""Part of its usual velocity below which a seesaw may be creeping, and friction is then below its level."""


def balance_pneumatic(
    joint: PneumaticJoint, roles: Mapping[str, Array], time: Array, spread: Mapping[str, float]
) -> list[Equation]:
    """Form every equation that the roles allow; parameters as `balance.balance`.

    Returns
    -------
    Equations of the sides "link", "transmission", "pneumatic" and "sensor"
    """
    motion = pneumatic_motion(joint, roles, time, spread)
    equations = _torques(joint, motion, time) if motion.torques else []
    if motion.link is not None:
        for index in (1, 2):
            if known(motion.roles, f"pressure_{index}", f"valve_{index}"):
                # The seesaw determines a pressure only where the direction of its friction is known.
                derived = "seesaw" in motion.spent and f"pressure_{index}" not in roles
                rate = _least_about(motion.link[1], time) if derived else None
                equations.append(_filling(joint, motion.roles, index, rate))
    held = joint.seesaw.held_at
    if held is not None and ANGLE in roles:
        equations.append(Equation("link_position", "sensor", "rad", roles[ANGLE][0] - held))
    return equations


def pneumatic_motion(
    joint: PneumaticJoint, roles: Mapping[str, Array], time: Array, spread: Mapping[str, float]
) -> Motion:
    """Return the motion of a joint; parameters as `balance.balance`.

    Returns
    -------
    The angle as `link`, the muscles' torque as the only one of `torques`, a missing angle or pressure among the
    `roles`, and in `spent` the name of the equation that it follows from
    """
    found, spent = dict(roles), frozenset[str]()
    held = joint.seesaw.held_at
    if held is not None:
        found[ANGLE] = np.stack([np.full(time.size, held), np.zeros(time.size), np.zeros(time.size)])
    missing = [role for role in (ANGLE, *PRESSURES) if role not in found]
    if len(missing) == 1:
        torque, equation = _source(joint, found, missing[0])
        if torque is not None:
            found[missing[0]], spent = _with_rates(torque, time), frozenset({equation})
    torques = {}
    if known(found, ANGLE, *PRESSURES):
        torques[""] = joint_torque(joint, *(found[role][0] for role in (ANGLE, *PRESSURES)))
    slacks = {"link": DETECTED * spread.get(ANGLE, 0.0)}
    return Motion(found, {}, found.get(ANGLE), {}, torques, frozenset(), spent, slacks)


def _source(joint: PneumaticJoint, roles: Mapping[str, Array], missing: str) -> tuple[Array | None, str]:
    """Return the missing angle or pressure by a torque, and the name of that torque's equation."""
    if "torque_sensor" in roles:
        return _told(joint, roles, missing, lambda _: roles["torque_sensor"][0]), "transmission"
    if missing == ANGLE or joint.seesaw.held_at is not None:
        return None, ""
    carried = _carried(joint, roles)
    # Friction depends on the unknown pressure.
    return _told(joint, roles, missing, lambda x: carried + _dry(joint, {**roles, missing: x[None]})), "seesaw"


def _told(joint: PneumaticJoint, roles: Mapping[str, Array], role: str, torque: Callable[[Array], Array]) -> Array:
    """Return the angle, or the pressure, at which the muscles make a torque, by Newton's method from the middle of its range.

    Parameters
    ----------
    joint : of the rig
    roles : all but the one the unknown one
    role : that is looked for
    torque : of values of the role, shape (N,)
    """
    air, turns = joint.air, role == ANGLE
    low, high = (-1.5, 1.5) if turns else (air.outside_pressure, 2.0 * air.supply_pressure)
    step = 1e-6 if turns else 1e-5 * air.supply_pressure

    def off(x: Array) -> Array:
        state = [x if r == role else roles[r][0] for r in (ANGLE, *PRESSURES)]
        return np.asarray(joint_torque(joint, *state) - torque(x))

    middle = 0.0 if turns else 0.5 * (air.supply_pressure + air.outside_pressure)
    x = np.full(roles[PRESSURES[0] if turns else ANGLE].shape[1], middle)
    least: Array | None = None
    # Newton's method doubles the digits: this number of rounds is enough from any start.
    for _ in range(12):
        left, before = off(x), x
        slope = (off(x + step) - left) / step
        least = LEAST * np.abs(slope) if least is None else least
        slope = np.where(np.abs(slope) < least, np.copysign(least, slope), slope)
        x = np.clip(x - left / slope, low, high)
        if not np.any(np.abs(x - before) > 64.0 * np.finfo(np.float64).eps * (high - low)):
            break
    return np.asarray(x)


def _torques(joint: PneumaticJoint, motion: Motion, time: Array) -> list[Equation]:
    roles, out = motion.roles, []
    psi, torque = roles[ANGLE], motion.torques[""]
    if joint.seesaw.held_at is None and "seesaw" not in motion.spent:
        rate = _least_about(psi[1], time)
        out.append(Equation("seesaw", "link", "N*m", _carried(joint, roles) - torque, _dry(joint, roles), rate))
    if "torque_sensor" in roles and "transmission" not in motion.spent:
        out.append(Equation("transmission", "transmission", "N*m", roles["torque_sensor"][0] - torque))
    return out


def _least_about(rate: Array, time: Array) -> Array:
    """Return the slowest of the velocities about each sample, 0 where it turns or creeps.

    A seesaw that stops sticks for a while, and the filter smears its stop; a sticking one creeps, as tubes and threads give way.
    """
    size = 2 * round(0.5 * ABOUT * WINDOW / max(float(time[1] - time[0]), 1e-9)) + 1
    known = np.nan_to_num(rate)
    least = np.maximum(minimum_filter1d(known, size), minimum_filter1d(-known, size))
    return np.asarray(np.where(np.isfinite(rate), np.where(least > CREEP * np.nanstd(rate), least, 0.0), np.nan))


def _carried(joint: PneumaticJoint, roles: Mapping[str, Array]) -> Array:
    """Return J ψ̈ + k_s ψ + c_s ψ̇ − τ_ext."""
    psi, seesaw = roles[ANGLE], joint.seesaw
    torque = seesaw.inertia * psi[2] + seesaw.return_stiffness * psi[0] + viscous_coefficient(joint) * psi[1]
    return np.asarray(torque - roles["external_torque"][0] if "external_torque" in roles else torque)


def _dry(joint: PneumaticJoint, roles: Mapping[str, Array]) -> Array:
    """Return the torque of dry friction; at rest it is not known."""
    psi, p1, p2 = roles[ANGLE], roles["pressure_1"][0], roles["pressure_2"][0]
    pulls = muscle_pulls(joint, psi[0], p1, p2)
    return np.asarray(friction_level(joint, p1, p2, *pulls, psi[1]) * np.sign(psi[1]))


def _filling(joint: PneumaticJoint, roles: Mapping[str, Array], index: int, rate: Array | None) -> Equation:
    """Return the equation of a muscle's pressure."""
    muscle, valve = ((joint.muscle_1, joint.valve_1), (joint.muscle_2, joint.valve_2))[index - 1]
    air, name = joint.air, f"pressure_{index}"
    psi, p, voltage = roles[ANGLE], roles[name], roles[f"valve_{index}"][0]
    length = muscle_lengths(joint, psi[0])[index - 1]
    side = -1.0 if index == 1 else 1.0
    speed = side * joint.seesaw.radius * np.cos(psi[0]) * psi[1]
    volume = muscle_volume(muscle, length)
    swelling = air.volume_index * volume_slope(muscle, length) * speed * p[0] / volume
    net = valve_flow(valve, air, valve_opening(valve, voltage), p[0])
    net = net - orifice_flow(air, muscle.leak_area, p[0], air.outside_pressure)
    # A valve's voltage steps and its map has corners, which the filter would have rounded: the flow passes it afterwards.
    filling = air.inflow_index * air.gas_constant * air.temperature * net / volume
    return Equation(name, "pneumatic", "Pa/s", p[1] + swelling, -filling, rate)


def _with_rates(values: Array, time: Array) -> Array:
    rate = np.gradient(values, time)
    return np.stack([values, rate, np.gradient(rate, time)])
