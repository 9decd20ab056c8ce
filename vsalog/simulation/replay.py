"""Replay: a rig's simulation driven by a recording's own inputs, to be compared with the recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.core.signals import JointSignals
from vsalog.filters.savitzky_golay import savgol_weights
from vsalog.rig.roles import COMMANDS
from vsalog.rig.schema import Chain, RigidJoint, SerialJoint
from vsalog.simulation.inputs import Input, Motion, bridged, table
from vsalog.simulation.machine import Machine, MotorSlot, Movable, build, drive_of
from vsalog.simulation.play import play

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SMOOTHING = 21
"""Samples that a cubic is fitted to, for restarts and prescribed motions."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """The simulation of a recording's inputs, on the recording's grid.

    Attributes
    ----------
    simulated : joint → name → shape (N,), named as the truth of an experiment; NaN in pieces too short to replay
    driven : joint → role → how it drives: "torque", "motion", or "nothing" where the recording has neither
    restarted : shape (N,), where the state was set to the measured one
    """

    simulated: Mapping[str, Mapping[str, Array]]
    driven: Mapping[str, Mapping[str, str]]
    restarted: Flags


def replay(
    joints: Mapping[str, Movable],
    signals: Mapping[str, JointSignals],
    *,
    chain: Chain | None = None,
    window: float | None = None,
    steps: int | None = None,
    held: bool = False,
) -> Replayed:
    """Simulate joints with a recording's inputs.

    A motor is driven by its drive and that one's command; else by its recorded torque; where there is none, by its
    recorded position, as prescribed. A set-point that is
    recorded without its motor's torque is prescribed. Every run of the recording begins with the measured state.

    Parameters
    ----------
    joints : one joint, or those of `chain` in its order
    signals : by joint, on one grid; bound with `acting=False`, since the simulation applies gain, offset, delay and step of their
        motors
    chain : that the joints form
    window : restart from the measured state every so often [s]; not within a run when absent
    steps : as for `play`
    held : torques act from sample to sample, as a drive holds them; else they are interpolated linearly

    Raises
    ------
    SimulationError
        A position to begin with is not recorded, nothing drives a rigid joint, the joints' signals are on different grids, or the
        machine cannot be simulated.
    """
    first = next(iter(signals.values()))
    if any(len(s) != len(first) or not np.array_equal(s.stamps, first.stamps) for s in signals.values()):
        raise SimulationError("the joints of a chain are replayed on one grid, but were recorded at different times")
    if window is not None and not window >= 2.0 * first.period:
        raise SimulationError(f"a window of {window:g} s is shorter than two samples")
    machine = build(joints, chain)
    cuts = np.flatnonzero(np.logical_or.reduce([s.starts for s in signals.values()]))
    edges = [0, *(int(c) for c in cuts if c > 0), len(first)]
    simulated: dict[str, dict[str, Array]] = {name: {} for name in joints}
    restarted = np.zeros(len(first), dtype=np.bool_)
    driven: dict[str, dict[str, str]] = {}
    for begin, end in pairwise(edges):
        if end - begin < SMOOTHING:
            continue
        piece = {name: s[begin:end] for name, s in signals.items()}
        states = {name: _measured_states(machine, name, piece[name]) for name in joints}
        every = end - begin if window is None else max(2, round(window / first.period))
        restarts = {k: {name: state[k] for name, state in states.items()} for k in range(0, end - begin, every)}
        inputs = {name: _inputs(machine, name, piece[name], states[name], held) for name in joints}
        driven = {name: {role: _kind(given) for role, given in own.items()} for name, own in inputs.items()}
        time = first.time[begin] + np.arange(end - begin) * first.period
        part = play(machine, inputs, time, steps=steps, start=restarts[0], restarts=restarts)
        restarted[[begin + k for k in restarts]] = True
        for name, found in part.items():
            for key, values in found.items():
                simulated[name].setdefault(key, np.full(len(first), np.nan))[begin:end] = values
    if not driven:
        raise SimulationError(f"no run of the recording is as long as {SMOOTHING} samples: there is nothing to replay")
    return Replayed(simulated, driven, restarted)


def _inputs(machine: Machine, name: str, signals: JointSignals, states: Array, held: bool) -> dict[str, Input]:
    """Return role → its input from the recording."""
    roles, time = signals.roles, signals.time[0] + np.arange(len(signals)) * signals.period
    given: dict[str, Input] = {}
    slots = [slot for slot in machine.motors if slot.joint == name]
    if drive_of(machine.joints[name]) is not None and any(role in roles for role in COMMANDS):
        given |= {role: bridged(roles[role]) for role in COMMANDS if role in roles}
        slots = []
    for i, slot in enumerate(slots):
        if slot.role in roles:
            given[slot.role] = _torque(bridged(roles[slot.role]), time, held)
        elif isinstance(machine.joints[name], RigidJoint):
            # Its motion is what the replay simulates.
            raise SimulationError(
                f"joint '{name}': nothing in the log drives it; name the channel of {slot.role} under [joint.{name}.signals] in"
                f" the rig, or that of commanded_position along with the drive under [joint.{name}.drive]"
            )
        elif np.isfinite(states[:, 2 + 2 * i]).all() and _recorded(slot.role, roles):
            given[slot.role] = Motion(states[:, 2 + 2 * i])
    if "external_torque" in roles:
        given["external_torque"] = _torque(bridged(roles["external_torque"]), time, held)
    return given


def _torque(values: Array, time: Array, held: bool) -> Input:
    return values if held else table(time, values)


def _kind(given: Input) -> str:
    return "motion" if isinstance(given, Motion) else "torque"


def _recorded(torque_role: str, roles: Mapping[str, Array]) -> bool:
    """Return whether the position of the motor with this torque follows from the recording."""
    if torque_role == "secondary_torque":
        return "setpoint" in roles
    position = torque_role.replace("torque", "position")
    return position in roles or {"link_position", torque_role.replace("motor_torque", "deflection")} <= set(roles)


def _measured_states(machine: Machine, name: str, signals: JointSignals) -> Array:
    """Return (q, q̇, θ₁, θ̇₁, …) as measured, smoothed, shape (N, 2 + 2 · motors)."""
    roles, joint = signals.roles, machine.joints[name]
    slots = [slot for slot in machine.motors if slot.joint == name]
    positions: list[Array | None] = [roles.get("link_position")]
    if isinstance(joint, RigidJoint):
        positions, slots = [roles.get("link_position", roles.get("motor_position"))], []
    for slot in slots:
        if slot.role == "secondary_torque":
            arm = roles.get("setpoint")
            assert isinstance(joint, SerialJoint)
            assert joint.lever is not None
            positions.append(None if arm is None else (joint.lever.start - arm) / joint.lever.travel)
        else:
            positions.append(roles.get(slot.role.replace("torque", "position")))
    # A deflection determines the missing one of the two positions.
    suffixes = [slot.role.removeprefix("motor_torque") for slot in slots if slot.role != "secondary_torque"]
    for i, suffix in enumerate(suffixes):
        phi, q, theta = roles.get(f"deflection{suffix}"), positions[0], positions[1 + i]
        if phi is not None and q is None and theta is not None:
            positions[0] = theta + phi
        elif phi is not None and theta is None and q is not None:
            positions[1 + i] = q - phi
    missing = [role for role, p in zip(_position_roles(slots), positions, strict=True) if p is None]
    if missing:
        raise SimulationError(
            f"joint '{name}': a replay begins with the measured state, but {' and '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} not recorded"
        )
    columns = [column for p in positions if p is not None for column in _smoothed(bridged(p), signals.period)]
    return np.stack(columns, axis=-1)


def _position_roles(slots: Sequence[MotorSlot]) -> list[str]:
    roles = [slot.role for slot in slots]
    names = ("setpoint" if role == "secondary_torque" else role.replace("torque", "position") for role in roles)
    return ["link_position", *names]


def _smoothed(values: Array, period: float) -> tuple[Array, Array]:
    """Return value and rate of a cubic fitted to a moving window; at the ends, of the last whole window's cubic."""
    half = SMOOTHING // 2
    weights = savgol_weights(SMOOTHING, 3, 3, period)
    fitted = np.stack([np.correlate(values, w, mode="valid") for w in weights])
    taylor = np.array([1.0, 1.0, 0.5, 1.0 / 6.0])
    found = np.empty((2, values.size))
    found[:, half : half + fitted.shape[1]] = fitted[:2]
    for edge, offsets in ((fitted[:, 0], np.arange(-half, 0)), (fitted[:, -1], np.arange(1, half + 1))):
        at = slice(0, half) if offsets[0] < 0 else slice(values.size - half, values.size)
        dt = offsets * period
        found[0, at] = sum(taylor[i] * edge[i] * dt**i for i in range(4))
        found[1, at] = edge[1] + edge[2] * dt + 0.5 * edge[3] * dt**2
    return found[0], found[1]
