"""What a log shows a joint to bear: an experiment that is proposed stays within it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.kinds import motion_for
from vsalog.diagnosis.sensing import VALVES, motors_of, torque_role, true_roles
from vsalog.diagnosis.system import System
from vsalog.rig.schema import PneumaticJoint

Array = NDArray[np.float64]

# Rates and pressures are taken without their few largest values, which may be noise.
MOST = 0.995
# So much beyond what was seen is still what was seen: encoders count in steps, filters smear peaks.
SLACK = 0.02


@dataclass(frozen=True, slots=True)
class Range:
    """An interval that a quantity was seen in, and how fast it changed.

    Attributes
    ----------
    low, high : least and greatest value, SI
    rate : largest rate but for a few, SI per second
    """

    low: float
    high: float
    rate: float

    @property
    def half(self) -> float:
        """Half of the interval's width."""
        return 0.5 * (self.high - self.low)

    def holds(self, values: Array, rates: Array | None = None) -> bool:
        """Tell whether values, and their rates, stay within what was seen."""
        room = SLACK * (self.high - self.low)
        inside = bool(np.all(values >= self.low - room) and np.all(values <= self.high + room))
        if rates is None:
            return inside
        return inside and float(np.quantile(np.abs(rates), MOST)) <= (1.0 + SLACK) * self.rate


@dataclass(frozen=True, slots=True)
class Seen:
    """What a joint went through in a log.

    Attributes
    ----------
    driven : key of a scenario (``motor_servo``, ``secondary_servo``, ``valve_1`` …) → of the angle [rad] or voltage [V] set
    torques : motor torque's role → its largest size [N·m]
    moved : name of a simulation's truth → interval, for what follows from what is driven: link, deflections, pressures
    """

    driven: Mapping[str, Range]
    torques: Mapping[str, float]
    moved: Mapping[str, Range]

    def holds(self, truth: Mapping[str, Array]) -> bool:
        """Tell whether a simulated motion stays within what was seen."""
        for key, one in self.driven.items():
            name = "secondary_position" if key == "secondary_servo" else key.replace("servo", "position")
            rates = truth.get(name.replace("position", "velocity")) if "servo" in key else None
            if name in truth and not one.holds(truth[name], rates):
                return False
        for role, most in self.torques.items():
            if role in truth and float(np.max(np.abs(truth[role]))) > (1.0 + SLACK) * most:
                return False
        return all(
            one.holds(truth[name], truth.get(name.replace("position", "velocity")) if "position" in name else None)
            for name, one in self.moved.items()
            if name in truth
        )


def seen_in(joint: Any, system: System) -> Seen:
    """Look at how far and how fast a joint went in a log, as its rig with all that was found in it has it.

    Parameters
    ----------
    joint : of the extended rig, on the joint's side
    system : of the log
    """
    channels = system.channels
    roles = true_roles(joint, channels, system.hold)
    motion = motion_for(joint, roles, channels.time, channels.spread)
    if isinstance(joint, PneumaticJoint):
        return _seen_of_muscles(motion.roles)
    driven, torques, moved = dict[str, Range](), dict[str, float](), dict[str, Range]()
    for name in motors_of(joint):
        role = torque_role(name)
        if role in roles:
            torques[role] = float(np.nanmax(np.abs(channels.roles[role][0])))
        if name == "secondary_motor":
            if "setpoint" in roles and joint.lever is not None:
                driven["secondary_servo"] = _range(_turned(joint, roles["setpoint"]))
            continue
        suffix = name.removeprefix("motor")
        if suffix in motion.motors:
            driven[f"motor_servo{suffix}"] = _range(motion.motors[suffix])
    for suffix, phi in motion.deflections.items():
        moved[f"deflection{suffix}"] = _range(phi)
    if motion.link is not None:
        moved["link_position"] = _range(motion.link)
    return Seen(driven, torques, moved)


def _seen_of_muscles(roles: Mapping[str, Array]) -> Seen:
    driven = {role: _range(roles[role]) for role in VALVES if role in roles}
    moved = {role: _range(roles[role]) for role in ("pressure_1", "pressure_2", "link_position") if role in roles}
    return Seen(driven, {}, moved)


def _turned(joint: Any, arm: Array) -> Array:
    """Return the secondary motor's angle of a lever arm, shape (3, N)."""
    lever = joint.lever
    return np.asarray(np.stack([lever.start - arm[0], -arm[1], -arm[2]]) / lever.travel)


def _range(values: Array) -> Range:
    """Return the interval of a motion, shape (3, N)."""
    x, rate = (values[i][np.isfinite(values[i])] for i in (0, 1))
    if not x.size:
        return Range(0.0, 0.0, 0.0)
    fastest = float(np.quantile(np.abs(rate), MOST)) if rate.size else 0.0
    return Range(float(x.min()), float(x.max()), fastest)
