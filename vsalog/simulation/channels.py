"""The measured roles of a joint as the channels of a log: binding, the other way round."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.errors import SimulationError
from vsalog.rig.schema import AntagonisticJoint, Joint, Motor, SerialJoint, Signal

Array = NDArray[np.float64]

JOINT_STATE = "sensor_msgs/msg/JointState"

# Where a role is recorded when the rig does not say.
DEFAULT_CHANNELS = {
    "motor_position": "/joint_states.position[motor]",
    "motor_position_1": "/joint_states.position[motor_1]",
    "motor_position_2": "/joint_states.position[motor_2]",
    "link_position": "/joint_states.position[link]",
    "setpoint": "/joint_states.position[secondary_motor]",
    "motor_torque": "/joint_states.effort[motor]",
    "motor_torque_1": "/joint_states.effort[motor_1]",
    "motor_torque_2": "/joint_states.effort[motor_2]",
    "torque_sensor": "/joint_torque.effort[transmission]",
    "torque_sensor_1": "/joint_torque.effort[transmission_1]",
    "torque_sensor_2": "/joint_torque.effort[transmission_2]",
}


@dataclass(frozen=True, slots=True)
class RecordedColumn:
    """One channel to be: its full name, values as recorded, unit, stream (topic) and message type."""

    name: str
    values: Array
    unit: str | None
    stream: str
    type: str


def recorded_columns(joint: Joint, measured: Mapping[str, Array]) -> list[RecordedColumn]:
    """Turn measured roles into channels, as the rig's signals describe them.

    Parameters
    ----------
    joint : its signals name the channel, side, sign and offset of each role; roles it does not name are recorded under
        their usual names
    measured : role → shape (N,), SI, on the joint's side; a serial joint's ``setpoint`` is the secondary motor's angle θ_c

    Returns
    -------
    positions first, so that a log's columns come in the usual order
    """
    columns = []
    for role in DEFAULT_CHANNELS:
        if role in measured:
            signal = signal_of(joint, role)
            if signal.channel is not None:
                columns.append(_column(joint, role, signal, measured[role]))
    return columns


def signal_of(joint: Joint, role: str) -> Signal:
    """Return where a role is recorded, in full."""
    spec = getattr(joint.signals, role, None)
    if spec is None:
        return Signal(channel=DEFAULT_CHANNELS[role])
    if isinstance(spec, Signal):
        return spec
    return Signal(channel=spec) if isinstance(spec, str) else Signal(constant=spec)


def _column(joint: Joint, role: str, signal: Signal, values: Array) -> RecordedColumn:
    name = signal.channel or ""
    if "{run}" in name:
        raise SimulationError(f"role '{role}': a channel with a '{{run}}' cannot be simulated")
    recorded = (values + signal.offset) * signal.sign
    if signal.side == "rotor":
        ratio = _gear_ratio(joint, role)
        recorded = recorded / ratio if "torque" in role else recorded * ratio
    stream = name.partition(".")[0] or name
    kind = JOINT_STATE if name.endswith("]") else "std_msgs/msg/Float64"
    return RecordedColumn(name, recorded, "N*m" if "torque" in role else "rad", stream, kind)


def _gear_ratio(joint: Joint, role: str) -> float:
    motor: Motor | None
    if isinstance(joint, AntagonisticJoint):
        motor = joint.motor_2 if role.endswith("_2") else joint.motor_1
    elif isinstance(joint, SerialJoint) and role == "setpoint":
        motor = joint.secondary_motor
    else:
        motor = joint.motor
    return 1.0 if motor is None else motor.gear_ratio
