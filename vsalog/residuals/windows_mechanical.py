"""Joints with motors and transmissions, simulated in windows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.residuals.balance import motion_of
from vsalog.residuals.channels import Channels
from vsalog.residuals.sensing import is_commanded, motors_of, position_role, torque_role, true_roles
from vsalog.rig.roles import COMMANDS
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    Link,
    Motor,
    SerialJoint,
    UnknownTransmission,
)
from vsalog.simulation.accuracy import COARSE
from vsalog.simulation.inputs import Input, Motion, TorqueInput, bridged, table
from vsalog.simulation.machine import BRISTLE_SPEED, DEFLECTING, Machine, build
from vsalog.simulation.play import play

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NUDGES = (1e-5, 1e-3)
"""Perturbations of positions [rad] and velocities [rad/s] that show how a window depends on its beginning."""


class Lengths(NamedTuple):
    """How long windows are.

    Attributes
    ----------
    window : of a window [s]
    lead : of the measured motion that is simulated before a run of them for unmeasured states: bristles, loops and slip elements,
        or a planned motion and an integral; longer than the memory of these at any usual speed [s]
    """

    window: float
    lead: float


FREE = Lengths(0.5, 0.5)
COMMANDED = Lengths(10.0, 2.0)
"""Of a joint that is commanded a position: its loop forgets its beginning within a second."""
NAME = "joint"
SIMULATED = ("motor_position", "link_position", "deflection", "torque_sensor", "setpoint")


class MechanicalPlayer:
    """Simulates a joint with motors; the states are (q, q̇, θ₁, θ̇₁, …). See `windows.Player`.

    A body without an inertia in the rig, and a motor whose torque is not recorded, moves as it was measured.

    Parameters
    ----------
    joint : of the rig
    channels : of the log

    Raises
    ------
    SimulationError
        The joint cannot be simulated.
    """

    def __init__(self, joint: Any, channels: Channels) -> None:
        if isinstance(joint, SerialJoint) and joint.secondary_motor is None:
            joint = replace(joint, secondary_motor=Motor())  # the set-point moves as it was measured
        self.joint, self.channels, self.commanded = joint, channels, is_commanded(joint, channels.raw)
        self.lengths = COMMANDED if self.commanded else FREE
        self.window, self.settling = self.lengths.window, self.lengths.lead if self.commanded else 0.0
        self.moved, self.link_moves = self.measured()
        self.model = self._with_stand_ins(joint)
        self.machine = build({NAME: self.model})
        latest = max(getattr(joint, name).torque_delay for name in motors_of(joint))
        self.lead = int(np.ceil(latest / channels.period))
        roles = [torque_role(m) for m in self.moved]
        prescribed = [m.index for m in self.machine.motors if m.role in roles] + ([0] if self.link_moves else [])
        self.speeds, self.deflecting = self._speeds()
        self.steps, self.stiff = self._steps(self.machine, prescribed)
        if self.stiff and not self._sees_bristles():
            plain = build({NAME: without_bristles(self.model)})
            steps, stiff = self._steps(plain, prescribed)
            if not stiff:
                self.machine, self.model = plain, without_bristles(self.model)
                self.steps, self.stiff = steps, stiff
        follows = self.commanded or remembers(self.model)
        self.run_in = round(self.lengths.lead / channels.period) if follows else 0
        if self.commanded and "commanded_position" not in channels.raw:
            self.run_in = len(channels)  # a velocity's integral forgets nothing

    def _steps(self, machine: Machine, prescribed: Sequence[int]) -> tuple[int, bool]:
        return machine.steps(self.channels.period, prescribed, self.speeds, COARSE, deflecting=self.deflecting)

    def _speeds(self) -> tuple[Array | float, float]:
        """Return how fast bristles slide and springs deflect: for a measured motion that is known."""
        if not remembers(self.model):
            return BRISTLE_SPEED, DEFLECTING
        moved = self.measured_states()[:, 1::2]
        deflecting = np.fmax.reduce(np.abs(moved[:, 1:] - moved[:, :1]), axis=None, initial=DEFLECTING)
        return np.asarray(np.fmax.reduce(np.abs(moved), axis=0, initial=BRISTLE_SPEED)), float(deflecting)

    def _sees_bristles(self) -> bool:
        """Return whether any encoder resolves how far bristles give way before they slide; others are ideal friction."""
        roles = {"link": "link_position"} | {name: position_role(name) for name in motors_of(self.model)}
        floors = {part: self.channels.noise[r].floor for part, r in roles.items() if r in self.channels.noise}
        if "secondary_motor" in floors:  # recorded as a lever arm
            floors["secondary_motor"] /= abs(self.model.lever.travel)
        finest = min(floors.values(), default=np.inf)
        parts = (getattr(self.model, name) for name in (*motors_of(self.model), "link"))
        frictions = [f for f in (getattr(part, "friction", None) for part in parts) if f is not None]
        return any(f.presliding_stiffness and f.breakaway / f.presliding_stiffness > finest for f in frictions)

    def measured(self) -> tuple[tuple[str, ...], bool]:
        """Return the motors that move as they were measured, and whether the link does."""
        free = free_motors(self.joint, self.channels)
        return tuple(m for m in motors_of(self.joint) if m not in free), self.joint.link is None

    def _with_stand_ins(self, joint: Any) -> Any:
        changed: dict[str, Any] = {}
        for name in self.moved:
            motor = getattr(joint, name)
            if motor.inertia is None:
                changed[name] = replace(motor, inertia=1.0)  # any: it moves as it was measured
        if self.link_moves:
            changed["link"] = Link(inertia=1.0)
        return replace(joint, **changed) if changed else joint

    def driving(self) -> list[str]:
        """Return the command, or the roles of the torques of the motors that are free."""
        return [role for m in motors_of(self.joint) if m not in self.moved for role in self._drives(m)]

    def _drives(self, motor: str) -> list[str]:
        if self.commanded and motor == "motor":
            return [role for role in COMMANDS if role in self.channels.raw]
        return [torque_role(motor)]

    def followed(self) -> list[str]:
        """Return the positions that prescribe a motion."""
        there = self.channels.roles
        roles = {position_role(m) for m in self.moved}
        if self.link_moves:
            roles |= {"link_position"} if "link_position" in there else {r for r in there if r.startswith("deflection")}
        return [r for r in there if r in roles]

    def answered(self) -> list[str]:
        """Return the recorded positions and torque sensors that drive nothing."""
        roles = [r for r in self.channels.roles if r.removesuffix("_1").removesuffix("_2") in SIMULATED]
        followed = self.followed()
        return [r for r in roles if r not in followed]

    def moving(self) -> list[str]:
        """Return the motors that are not prescribed, and the link where it is not."""
        return [*(m for m in motors_of(self.joint) if m not in self.moved), *(() if self.link_moves else ("link",))]

    def measured_states(self) -> Array:
        """Return the states as rig and filter have them, shape (N, n)."""
        joint, channels = self.joint, self.channels
        roles = true_roles(joint, channels, 0.0)
        motion = motion_of(joint, roles, channels.time, channels.spread)
        motors = [self._position(name, roles, motion.motors) for name in motors_of(joint)]
        link = motion.link
        if self.commanded and not link_told(joint, channels):
            link = motors[0]  # another one is forgotten before a window begins
        if link is None:
            raise SimulationError("the position of the link is not recorded, and cannot be determined")
        columns = [column for x in (link, *motors) for column in x[:2]]
        return np.stack(columns, axis=-1)

    def _position(self, name: str, roles: Mapping[str, Array], motors: Mapping[str, Array]) -> Array:
        """Return θ of a motor as it was measured, with its derivatives."""
        if name == "secondary_motor":
            arm, lever = roles.get("setpoint"), self.joint.lever
            if arm is None or lever is None:
                raise SimulationError("the set-point is not recorded")
            return np.asarray(np.stack([lever.start - arm[0], -arm[1], -arm[2]]) / lever.travel)
        suffix = name.removeprefix("motor")
        if suffix not in motors:
            raise SimulationError(f"the position of the {name} is not recorded, and cannot be determined")
        return np.asarray(motors[suffix])

    def free(self, states: Array) -> Mapping[int, tuple[float, Flags]]:
        """Return the states of the link and of the motors, but for those that move as they were measured.

        A loop that is commanded a position forgets them long before a window ends.
        """
        if self.commanded:
            return {}
        free = [] if self.link_moves else [0, 1]
        for k, name in enumerate(motors_of(self.joint)):
            if name not in self.moved:
                free += [2 + 2 * k, 3 + 2 * k]
        return {i: (NUDGES[i % 2], np.ones(len(states), dtype=np.bool_)) for i in free}

    def after(self, truth: Mapping[str, Array], sample: int) -> Array:
        """Return the state one sample later: positions go on with their velocities."""
        state = []
        for name in ("link", *(m.removesuffix("_motor") for m in motors_of(self.joint)))[: self.machine.freedom]:
            base, _, number = name.partition("_")
            suffix = f"_{number}" if number else ""
            velocity = truth[f"{base}_velocity{suffix}"][sample]
            state += [truth[f"{base}_position{suffix}"][sample] + velocity * self.channels.period, velocity]
        return np.array(state)

    def simulated(
        self, spans: NDArray[np.int64], states: Array, hold: bool
    ) -> Iterator[tuple[slice, Mapping[str, Array]]]:
        """Yield the windows' truth; those that touch are one run with restarts."""
        channels = self.channels
        roles = true_roles(self.joint, channels, 0.0)
        measured = self.measured_states() if self.run_in else None
        for first_w, last_w in _stretches(spans):
            part = slice(int(spans[first_w, 0]), int(spans[last_w - 1, 1]))
            # A late torque was recorded before the stretch: the motion is begun so much earlier, and begun again there.
            before, begin = self._before(part.start, states[first_w], measured)
            whole = slice(part.start - before, part.stop)
            time = self.times(whole)
            inputs = self.inputs(roles, whole, hold)
            restarts = {int(spans[w, 0]) - whole.start: {NAME: states[w]} for w in range(first_w, last_w)}
            start = {NAME: begin}
            truth = play(
                self.machine, {NAME: inputs}, time, steps=self.steps, start=start, restarts=restarts, speeds=self.speeds,
                deflecting=self.deflecting,
            )[NAME]  # fmt: skip
            yield part, {name: values[before:] for name, values in truth.items()}

    def _before(self, first: int, state: Array, measured: Array | None) -> tuple[int, Array]:
        """Return how many samples before a stretch its motion begins, and the state there."""
        lead = min(first, self.lead)
        if measured is None:
            return lead, state
        cuts = np.flatnonzero(self.channels.starts[: first + 1])
        earliest = max(first - self.run_in, int(cuts[-1]) if cuts.size else 0)
        known = np.flatnonzero(np.isfinite(measured[earliest : first - lead]).all(axis=1))
        return (first - earliest - int(known[0]), measured[earliest + known[0]]) if known.size else (lead, state)

    def times(self, part: slice) -> Array:
        """Return the times of a run's samples."""
        back = np.arange(part.start - part.stop + 1, 1)
        return np.asarray(self.channels.time[part.stop - 1] + back * self.channels.period)

    def inputs(self, roles: Mapping[str, Array], part: slice, hold: bool) -> dict[str, Input]:
        """Return the inputs of the machine: recorded torques, and motions where no torque is recorded."""
        channels, time, given = self.channels, self.times(part), dict[str, Input]()
        motion = motion_of(self.joint, roles, channels.time, channels.spread) if self.moved or self.link_moves else None
        for name in motors_of(self.joint):
            role = torque_role(name)
            if self.commanded and name == "motor":
                given |= {command: bridged(channels.raw[command][part]) for command in self._drives(name)}
            elif name not in self.moved:
                given[role] = acting(channels.raw[role][part], time, channels, part.start, hold)
            elif motion is not None:
                given[role] = Motion(self._position(name, roles, motion.motors)[0][part])
        if self.link_moves and motion is not None and motion.link is not None:
            given["link_position"] = Motion(motion.link[0][part])
        if "external_torque" in roles:
            given["external_torque"] = table(time, roles["external_torque"][0][part])
        return given


def acting(recorded: Array, time: Array, channels: Channels, first: int, hold: bool) -> TorqueInput:
    """Return the inputs of a machine, recorded from a sample on: held from sample to sample, or smooth.

    An input that was held for another time than a sample has been interpolated; it acts half of that time later.
    """
    held = channels.held_at(first)
    late = 0.5 * held * channels.period if hold else 0.0
    return recorded if hold and held == 1.0 else table(time + late, recorded)


def remembers(joint: Any) -> bool:
    """Return whether a joint has bristles, loops or slip elements: its motion depends on its history."""
    parts = [getattr(joint, name) for name in joint.__struct_fields__]
    bristles = any(getattr(getattr(p, "friction", None), "presliding_stiffness", None) is not None for p in parts)
    return bristles or any(getattr(p, "bouc_wen", None) is not None or getattr(p, "slip", ()) for p in parts)


def without_bristles(joint: Any) -> Any:
    """Return the joint with ideal friction: a sticking part does not give way."""
    changed = {}
    for name in (*motors_of(joint), "link"):
        part = getattr(joint, name)
        if part is not None and part.friction.presliding_stiffness is not None:
            friction = replace(part.friction, presliding_stiffness=None, presliding_damping=0.0)
            changed[name] = replace(part, friction=friction)
    return replace(joint, **changed) if changed else joint


def free_motors(joint: Any, channels: Channels) -> list[str]:
    """Return the motors of a joint whose inertia is known and whose torque, or command, is recorded."""
    driven = {torque_role(m) for m in motors_of(joint)} & set(channels.raw)
    if is_commanded(joint, channels.raw):
        driven.add("motor_torque")
    return [m for m in motors_of(joint) if getattr(joint, m).inertia is not None and torque_role(m) in driven]


def movable(joint: Any, channels: Channels) -> bool:
    """Return whether any part of a joint can be moved by the inputs, with all else moving as it was measured.

    This depends on what the rig has and the log records, not on values: all rigs that a search tries are simulated alike.
    """
    roles = channels.roles
    if isinstance(joint, SerialJoint):
        awas = isinstance(joint.transmission, AwasTransmission | UnknownTransmission)
        if joint.lever is None or not awas or (joint.secondary_motor is None and "setpoint" not in roles):
            return False
    free = free_motors(joint, channels)
    if joint.link is None and not free:
        return False
    seen = any(r.startswith(("motor_position", "link_position")) for r in roles)
    return seen and (joint.link is not None or link_told(joint, channels))


def link_told(joint: Any, channels: Channels) -> bool:
    """Return whether encoders determine where the link is."""
    suffixes = ("_1", "_2") if isinstance(joint, AntagonisticJoint) else ("",)
    roles = channels.roles
    return "link_position" in roles or any(
        f"deflection{s}" in roles and f"motor_position{s}" in roles for s in suffixes
    )


def _stretches(spans: NDArray[np.int64]) -> list[tuple[int, int]]:
    breaks = [0, *(w + 1 for w in range(len(spans) - 1) if spans[w, 1] != spans[w + 1, 0]), len(spans)]
    return list(pairwise(breaks))
