"""What a log shows a joint to bear: an experiment that is proposed stays within it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.experiment_design import DESIGN
from vsalog.residuals.balance import lever_angle
from vsalog.residuals.kinds import motion_for
from vsalog.residuals.sensing import VALVES, motors_of, torque_role, true_roles
from vsalog.residuals.system import System
from vsalog.rig.schema import PneumaticJoint
from vsalog.simulation.machine import drive_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Range:
    """An interval that a quantity was seen in, and how fast it changed.

    Attributes
    ----------
    low, high : least and greatest value, SI
    rate : largest rate but for a few, SI per second
    curvature : largest change of the rate but for a few, SI per second²
    limited : whether the rate is a limit, which not even a few samples may exceed
    """

    low: float
    high: float
    rate: float
    curvature: float = np.inf
    limited: bool = False

    @property
    def half(self) -> float:
        """Half of the interval's width."""
        return 0.5 * (self.high - self.low)

    def taken(self, values: Array, rates: Array | None = None) -> float:
        """Return the share of what was seen that values, and their rates, take: above 1 they leave it."""
        off = float(np.max(np.abs(values - 0.5 * (self.low + self.high))))
        swing = off / ((1.0 + DESIGN.slack) * self.half) if self.half else np.inf if off > 0.0 else 0.0
        if rates is None or not self.rate:
            return swing
        share = 1.0 if self.limited else DESIGN.range_share
        return max(swing, float(np.quantile(np.abs(rates), share)) / ((1.0 + DESIGN.slack) * self.rate))


@dataclass(frozen=True, slots=True)
class Limits:
    """What a joint may be asked for; none where nothing is stated.

    Attributes
    ----------
    torque : of each motor, as the joint feels it [N·m]
    speed : of motors and link, on the joint's side [rad/s]
    angle : of motors and link, to either side of the rig's zero [rad]
    """

    torque: float | None = None
    speed: float | None = None
    angle: float | None = None

    def of(self, joint: Any) -> Limits:
        """Return the limits with those that a joint's drive has where none are stated."""
        drive = drive_of(joint) if not isinstance(joint, PneumaticJoint) else None
        if drive is None:
            return self
        return replace(self, torque=self.torque or drive.torque_limit, speed=self.speed or drive.speed_limit)

    def on(self, one: Range) -> Range:
        """Return the interval of an angle that a joint may use; what was seen of it where there is no limit."""
        exact = 1.0 / (1.0 + DESIGN.slack)
        if self.angle is not None:
            one = replace(one, low=-exact * self.angle, high=exact * self.angle)
        return one if self.speed is None else replace(one, rate=exact * self.speed, curvature=np.inf, limited=True)


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

    def taken(self, truth: Mapping[str, Array]) -> float:
        """Return the share of what was seen that a simulated motion takes: above 1 it leaves it.

        Parameters
        ----------
        truth : of a simulation, name → shape (N,)
        """
        known = {key.replace("servo", "position"): one for key, one in self.driven.items()} | dict(self.moved)
        shares = [0.0]
        for name, one in known.items():
            if name in truth and one.half:
                rates = truth.get(name.replace("position", "velocity")) if "position" in name else None
                shares.append(one.taken(truth[name], rates))
        for role, most in self.torques.items():
            if role in truth and most:
                shares.append(float(np.max(np.abs(truth[role]))) / ((1.0 + DESIGN.slack) * most))
        return max(shares)

    def within(self, limits: Limits) -> Seen:
        """Return it with limits in the place of what was seen.

        Springs bear what they were seen to bear, or the deflection that a stated torque makes.
        """
        driven = {key: limits.on(one) if key.startswith("motor") else one for key, one in self.driven.items()}
        moved = {name: limits.on(one) if name == "link_position" else one for name, one in self.moved.items()}
        torques = dict(self.torques)
        if limits.torque is not None:
            exact = limits.torque / (1.0 + DESIGN.slack)
            torques |= {role: exact for role in torques if role.startswith("motor")}
            moved = {name: one for name, one in moved.items() if not name.startswith("deflection")}
        return Seen(driven, torques, moved)


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
        return _seen_of_muscles(motion.roles, system)
    driven, torques, moved = dict[str, Range](), dict[str, float](), dict[str, Range]()
    for name in motors_of(joint):
        role = torque_role(name)
        if role in channels.roles:
            torques[role] = float(np.nanmax(np.abs(channels.roles[role][0])))
        if name == "secondary_motor":
            if "setpoint" in roles and joint.lever is not None:
                driven["secondary_servo"] = _range(lever_angle(joint.lever, roles["setpoint"]), system)
            continue
        suffix = name.removeprefix("motor")
        if suffix in motion.motors:
            one = _range(motion.motors[suffix], system)
            if "commanded_position" in channels.roles:
                # Friction keeps a motor short of what its drive is commanded.
                asked = channels.roles["commanded_position"][0]
                one = replace(one, low=min(one.low, np.nanmin(asked)), high=max(one.high, np.nanmax(asked)))
            driven[f"motor_servo{suffix}"] = one
    for suffix, phi in motion.deflections.items():
        moved[f"deflection{suffix}"] = _range(phi, system)
    if motion.link is not None:
        moved["link_position"] = _range(motion.link, system)
    return Seen(driven, torques, moved)


def _seen_of_muscles(roles: Mapping[str, Array], system: System) -> Seen:
    driven = {role: _range(roles[role], system) for role in VALVES if role in roles}
    moved = {
        role: _range(roles[role], system) for role in ("pressure_1", "pressure_2", "link_position") if role in roles
    }
    return Seen(driven, {}, moved)


def _range(values: Array, system: System) -> Range:
    """Return the interval of a motion, shape (3, N)."""
    x = values[0][np.isfinite(values[0])]
    if not x.size:
        return Range(0.0, 0.0, 0.0)
    # A second derivative is mostly noise: it is averaged as the equations are.
    return Range(float(x.min()), float(x.max()), _most(values[1]), _most(system.average(values[2])))


def _most(values: Array) -> float:
    finite = np.abs(values[np.isfinite(values)])
    return float(np.quantile(finite, DESIGN.range_share)) if finite.size else 0.0
