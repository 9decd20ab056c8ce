"""The drive model, from the recorded to the acting torque: gain, offset, delay and step of the motor in the rig."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import Bound
from vsalog.core.finding import Finding
from vsalog.core.resolution import resolution_of
from vsalog.effects.drive import delivered
from vsalog.rig.schema import Motor

Array = NDArray[np.float64]


def is_motor_torque(role: str) -> bool:
    """Return whether a role is the torque of a motor."""
    return role.startswith("motor_torque") or role == "secondary_torque"


def acting_torque(bound: Bound, motor: Motor) -> Bound:
    """Return torque_gain · τ(t − torque_delay) + torque_offset, the recorded τ rounded to torque_step."""
    motor, delay = motor.reflected, shift_of(motor)
    stamps = bound.stamps + delay if delay else bound.stamps
    if motor.torque_gain == 1.0 and motor.torque_offset == 0.0 and motor.torque_step == 0.0:
        return replace(bound, stamps=stamps)
    # The offset hides the steps of the recorded torque.
    step = resolution_of(bound.values) if bound.resolution is None else bound.resolution
    return replace(
        bound,
        stamps=stamps,
        values=made_of(bound.values, motor),
        resolution=max(step, motor.torque_step) * motor.torque_gain,
    )


def shift_of(motor: Motor) -> int:
    """Return the delay after which a recorded torque acts [ns]."""
    return round(motor.reflected.torque_delay * 1e9)


def made_of(recorded: Array, motor: Motor) -> Array:
    """Return a drive's torques for recorded ones, on the same side of the gear as `motor`; without its delay."""
    return delivered(recorded, motor.torque_gain, motor.torque_offset, motor.torque_step)


def acting_findings(joint: str, motors: Mapping[str, Motor]) -> Iterator[Finding]:
    """Yield how the rig's drive model changes each recorded motor torque, role → motor; nothing where it changes nothing."""
    for role, given in motors.items():
        motor = given.reflected
        made = [
            *([f"rounded to {motor.torque_step:.4g} N·m"] if motor.torque_step else []),
            *([f"times {motor.torque_gain:.6g}"] if motor.torque_gain != 1.0 else []),
            *([f"{motor.torque_offset:+.4g} N·m"] if motor.torque_offset else []),
            *([f"{1e3 * motor.torque_delay:.4g} ms later"] if motor.torque_delay else []),
        ]
        if made:
            evidence = {"made": ", ".join(made)}
            yield Finding(code="torque.drive_model", joint=joint, part=role, severity="info", evidence=evidence)
