"""Joints with motors and transmissions, played in windows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.diagnosis.balance import motion_of
from vsalog.diagnosis.channels import Channels
from vsalog.diagnosis.sensing import motors_of, torque_role, true_roles
from vsalog.errors import SimulationError
from vsalog.simulation.inputs import Input, Motion, table
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Perturbations of positions [rad] and velocities [rad/s] that tell how a window depends on its beginning.
NUDGES = (1e-5, 1e-3)
NAME = "joint"
SIMULATED = ("motor_position", "link_position", "deflection", "torque_sensor", "setpoint")


class MechanicalPlayer:
    """Plays a joint with motors; the states are (q, q̇, θ₁, θ̇₁, …). See `windows.Player`.

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
        self.joint, self.channels, self.played = joint, channels, joint
        self.machine = build({NAME: joint})
        latest = max(getattr(joint, name).torque_delay for name in motors_of(joint))
        self.lead = int(np.ceil(latest / channels.period))
        prescribed = [m.index for m in self.machine.motors if m.role not in channels.raw]
        if self.machine.steps(channels.period, prescribed)[1]:
            plain = build({NAME: without_bristles(joint)})
            # Bristles so stiff that they ask for an implicit integrator differ from ideal friction by less than encoders see.
            if not plain.steps(channels.period, prescribed)[1]:
                self.machine, self.played = plain, without_bristles(joint)

    def driving(self) -> list[str]:
        """Return the roles of the motors' torques."""
        return [torque_role(m) for m in motors_of(self.joint)]

    def answered(self) -> list[str]:
        """Return the recorded positions and torque sensors that drive nothing."""
        roles = [r for r in self.channels.roles if r.removesuffix("_1").removesuffix("_2") in SIMULATED]
        return [r for r in roles if not _drives(self.channels, r)]

    def measured_states(self) -> Array:
        """Return the states as rig and filter have them, shape (N, n)."""
        joint, channels = self.joint, self.channels
        roles = true_roles(joint, channels, 0.0)
        motion = motion_of(joint, roles, channels.time, channels.spread)
        if motion.link is None:
            raise SimulationError("the position of the link is not recorded, and nothing tells it")
        columns = [motion.link[0], motion.link[1]]
        for name in motors_of(joint):
            if name == "secondary_motor":
                arm, lever = roles.get("setpoint"), joint.lever
                if arm is None or lever is None:
                    raise SimulationError("the set-point is not recorded")
                columns += [(lever.start - arm[0]) / lever.travel, -arm[1] / lever.travel]
                continue
            suffix = name.removeprefix("motor")
            if suffix not in motion.motors:
                raise SimulationError(f"the position of the {name} is not recorded, and nothing tells it")
            columns += [motion.motors[suffix][0], motion.motors[suffix][1]]
        return np.stack(columns, axis=-1)

    def free(self, states: Array) -> Mapping[int, tuple[float, Flags]]:
        """Return the states of the link, and of motors whose torque is recorded."""
        free = [0, 1]
        for k, name in enumerate(motors_of(self.joint)):
            if torque_role(name) in self.channels.raw:
                free += [2 + 2 * k, 3 + 2 * k]
        return {i: (NUDGES[i % 2], np.ones(len(states), dtype=np.bool_)) for i in free}

    def simulated(
        self, spans: NDArray[np.int64], states: Array, hold: bool
    ) -> Iterator[tuple[slice, Mapping[str, Array]]]:
        """Yield the windows' truth; those that touch are one run with restarts."""
        channels = self.channels
        roles = true_roles(self.joint, channels, 0.0)
        for first_w, last_w in _stretches(spans):
            part = slice(int(spans[first_w, 0]), int(spans[last_w - 1, 1]))
            # A late torque was recorded before the stretch: the motion is begun so much earlier, and begun again there.
            before = min(part.start, self.lead)
            whole = slice(part.start - before, part.stop)
            time = self.times(whole)
            inputs = self.inputs(roles, whole, hold)
            restarts = {int(spans[w, 0]) - whole.start: {NAME: states[w]} for w in range(first_w, last_w)}
            start = {NAME: states[first_w]}
            truth = play(self.machine, {NAME: inputs}, time, start=start, restarts=restarts)[NAME]
            yield part, {name: values[before:] for name, values in truth.items()}

    def times(self, part: slice) -> Array:
        """Return the times of a run's samples."""
        back = np.arange(part.start - part.stop + 1, 1)
        return np.asarray(self.channels.time[part.stop - 1] + back * self.channels.period)

    def inputs(self, roles: Mapping[str, Array], part: slice, hold: bool) -> dict[str, Input]:
        """Return what drives the machine: recorded torques, and motions where no torque is recorded."""
        joint, channels, time, given = self.joint, self.channels, self.times(part), dict[str, Input]()
        for name in motors_of(joint):
            role = torque_role(name)
            if role in channels.raw:
                torque = channels.raw[role][part]
                given[role] = torque if hold else table(time, torque)
            elif name == "secondary_motor":
                given[role] = Motion((joint.lever.start - roles["setpoint"][0][part]) / joint.lever.travel)
            else:
                given[role] = Motion(roles[name.replace("motor", "motor_position")][0][part])
        if "external_torque" in roles:
            given["external_torque"] = table(time, roles["external_torque"][0][part])
        return given


def without_bristles(joint: Any) -> Any:
    """Return the joint with ideal friction: what sticks does not give way."""
    changed = {}
    for name in (*motors_of(joint), "link"):
        part = getattr(joint, name)
        if part is not None and part.friction.presliding_stiffness is not None:
            friction = replace(part.friction, presliding_stiffness=None, presliding_damping=0.0)
            changed[name] = replace(part, friction=friction)
    return replace(joint, **changed) if changed else joint


def _drives(channels: Channels, role: str) -> bool:
    """Tell whether a position prescribes a motor's motion, because its torque is not recorded."""
    torque = "secondary_torque" if role == "setpoint" else role.replace("motor_position", "motor_torque")
    return torque != role and torque not in channels.roles


def _stretches(spans: NDArray[np.int64]) -> list[tuple[int, int]]:
    breaks = [0, *(w + 1 for w in range(len(spans) - 1) if spans[w, 1] != spans[w + 1, 0]), len(spans)]
    return list(pairwise(breaks))
