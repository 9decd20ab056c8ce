"""The measured roles of a joint as the channels of a log: binding, the other way round."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.core.units import matching, si_factor
from vsalog.rig.schema import (
    AntagonisticJoint,
    Joint,
    Motor,
    PneumaticJoint,
    SerialJoint,
    Signal,
    SignalSpec,
    role_units,
)

Array = NDArray[np.float64]

JOINT_STATE = "sensor_msgs/msg/JointState"

# Where a role is recorded when the rig names no channel at all.
DEFAULT_CHANNELS = {
    "motor_position": "/joint_states.position[motor]",
    "motor_position_1": "/joint_states.position[motor_1]",
    "motor_position_2": "/joint_states.position[motor_2]",
    "link_position": "/joint_states.position[link]",
    "setpoint": "/joint_states.position[secondary_motor]",
    "commanded_position": "/joint_commands.position[motor]",
    "commanded_velocity": "/joint_commands.velocity[motor]",
    "motor_torque": "/joint_states.effort[motor]",
    "motor_torque_1": "/joint_states.effort[motor_1]",
    "motor_torque_2": "/joint_states.effort[motor_2]",
    "torque_sensor": "/joint_torque.effort[transmission]",
    "torque_sensor_1": "/joint_torque.effort[transmission_1]",
    "torque_sensor_2": "/joint_torque.effort[transmission_2]",
    "pressure_1": "/muscle_1/pressure.data",
    "pressure_2": "/muscle_2/pressure.data",
    "valve_1": "/valve_1/voltage.data",
    "valve_2": "/valve_2/voltage.data",
}


@dataclass(frozen=True, slots=True)
class RecordedColumn:
    """One channel to write: its role and full name, values as recorded, unit, stream (topic) and message type."""

    role: str
    name: str
    values: Array
    unit: str | None
    stream: str
    type: str


def named_signals(joint: Joint) -> dict[str, Signal]:
    """Return role → where it is recorded, for the roles that the rig names; usual names where it names none."""
    specs: dict[str, SignalSpec | None] = msgspec.structs.asdict(joint.signals)
    named = {role: _in_full(spec) for role, spec in specs.items() if spec is not None}
    if not named:
        named = {role: Signal(channel=name) for role, name in DEFAULT_CHANNELS.items() if role in specs}
    return named


def topic_parts(joints: Collection[str]) -> dict[str, str]:
    """Return joint → what it is called in a topic's name, with a number where two joints would have the same name."""
    plain = {name: re.sub(r"[^A-Za-z0-9_]", "_", name) or "_" for name in joints}
    plain = {name: f"_{part}" if part[0].isdigit() else part for name, part in plain.items()}
    several = Counter(plain.values())
    return {name: part if several[part] == 1 else f"{part}_{i}" for i, (name, part) in enumerate(plain.items())}


def is_lever_arm(role: str, signal: Signal) -> bool:
    """Return whether a role is a set-point that is recorded as a lever arm, not as the secondary motor's angle."""
    return role == "setpoint" and signal.unit is not None and matching(signal.unit, ("rad", "m")) == "m"


def recorded_columns(joint: Joint, measured: Mapping[str, Array]) -> list[RecordedColumn]:
    """Turn measured roles into channels: unit, side and sign as the rig's signals describe them.

    Parameters
    ----------
    joint : of the rig
    measured : role → shape (N,), the sensors' readings, SI, on the joint's side, see `JointRecord`

    Raises
    ------
    SimulationError
        A channel has a place-holder for runs, or two roles share a channel.
    """
    columns: dict[str, RecordedColumn] = {}
    for role, signal in named_signals(joint).items():
        if role not in measured or signal.channel is None:
            continue
        if "{run}" in signal.channel:
            raise SimulationError(f"role '{role}': a channel with a '{{run}}' cannot be simulated")
        if signal.channel in columns:
            raise SimulationError(f"role '{role}': another role is recorded as {signal.channel} already")
        columns[signal.channel] = _column(joint, role, signal, measured[role])
    return list(columns.values())


def _in_full(spec: SignalSpec) -> Signal:
    if isinstance(spec, Signal):
        return spec
    return Signal(channel=spec) if isinstance(spec, str) else Signal(constant=spec)


def _column(joint: Joint, role: str, signal: Signal, values: Array) -> RecordedColumn:
    name, ratio, unit = signal.channel or "", _motor(joint, role).gear_ratio, signal.unit
    kind = JOINT_STATE if name.endswith("]") else "std_msgs/msg/Float64"
    usual = role_units(role)[0]
    if is_lever_arm(role, signal):
        usual = "m"
    recorded = values * signal.sign
    if unit is not None and usual == "N*m" and matching(unit, ("N*m", "A")) == "A":
        # A current drives the rotor, whatever side is named.
        usual, recorded = "A", recorded / (ratio * _torque_constant(joint, role))
    elif signal.side == "rotor":
        # As binding undoes it: only a motor's quantities may be on either side of a gear.
        if role.startswith(("motor_torque", "secondary_torque")):
            recorded = recorded / ratio
        elif role.startswith(("motor_position", "motor_velocity")) or (role == "setpoint" and usual == "rad"):
            recorded = recorded * ratio
    if unit is not None and unit != usual:
        recorded = recorded / si_factor(unit, usual)
    return RecordedColumn(role, name, recorded, unit or usual, name.partition(".")[0], kind)


def _motor(joint: Joint, role: str) -> Motor:
    if isinstance(joint, AntagonisticJoint):
        return joint.motor_2 if role.endswith("_2") else joint.motor_1
    if isinstance(joint, SerialJoint) and role in ("setpoint", "secondary_torque"):
        return joint.secondary_motor or Motor()
    if isinstance(joint, PneumaticJoint):
        return Motor()
    return joint.motor


def _torque_constant(joint: Joint, role: str) -> float:
    constant = _motor(joint, role).torque_constant
    if constant is None:
        raise SimulationError(f"role '{role}' is recorded as a current: give the motor's 'torque_constant' in the rig")
    return constant
