"""The source of a role of a joint, and the conversion of its numbers to SI on the joint's side of the gear."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import Bound
from vsalog.binding.sensor_model import seen_by
from vsalog.core.errors import BindingError, UnitError
from vsalog.core.finding_texts import sentence
from vsalog.core.recording import Channel, Recording
from vsalog.core.units import si_factor
from vsalog.rig.parts import Lever
from vsalog.rig.schema import Joint, Motor, PneumaticJoint, Run, SerialJoint, Signal, role_units

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

# Roles that no command makes jump; a push or a blow seen by an accelerometer may be very short.
SMOOTH = ("motor_position", "link_position", "deflection", "torque_sensor", "pressure")


@dataclass(frozen=True, slots=True)
class Source:
    """A role's channel, and the conversion of its numbers to SI on the joint's side of the gear.

    Attributes
    ----------
    channel : its name in the log
    where : the log, the channel and the role, for messages
    signal : the rig's entry for the sensor
    factor : from recorded values to SI on the joint's side, with the sign
    turn : after which an encoder may wrap, as it is recorded; None for other sensors
    joint_turn : whether a turn of the sensor is a turn of the joint
    may_stand_alone : whether a single deviating sample is no motion
    lever : from a set-point's angle to a length
    origin : the log's first stamp [ns]
    """

    channel: str
    where: str
    signal: Signal
    factor: float
    turn: float | None
    joint_turn: bool
    may_stand_alone: bool
    lever: Lever | None
    origin: int

    def bound(self, stamps: Stamps, recorded: Array, period: int) -> Bound:
        """Return samples as the role's, in SI.

        Parameters
        ----------
        stamps : shape (n,) [ns]
        recorded : shape (n,), NaN for outliers, without an encoder's jumps
        period : of the channel [ns]

        Raises
        ------
        BindingError
            A number is too large.
        """
        signal = self.signal
        # A long log's columns are not copied when there is nothing to change.
        values = recorded if self.factor == 1.0 else recorded * self.factor
        if not np.isfinite(values).all():
            values = np.where(np.isfinite(values), values, np.nan)
        seconds = (stamps - self.origin).astype(np.float64) * 1e-9 if signal.drift else None
        values, resolution = seen_by(values, signal, seconds)
        if self.lever is not None:
            values = self.lever.arm(values)
            resolution = None if resolution is None else resolution * abs(self.lever.travel)
        greatest = float(np.fmax.reduce(np.abs(values)))
        if greatest > float(np.finfo(np.float32).max):  # of which squares and their products are finite
            raise BindingError(
                f"{self.where} reaches {greatest:.3g} in SI: is its unit, its offset or the gear ratio in the rig right?"
            )
        return Bound(stamps + self.shift if self.shift else stamps, values, period, resolution)

    @property
    def shift(self) -> int:
        """The delay of a sample after its stamp [ns]."""
        return -round(self.signal.delay * 1e9)

    def for_parts(self) -> Source:
        """Return the same for parts of a channel, without the sensor's step."""
        return replace(self, signal=msgspec.structs.replace(self.signal, resolution=self.signal.resolution or 1.0))


def constant_of(recording: Recording, run: Run, role: str, signal: Signal, fixed: float | None) -> float | None:
    """Return the value of a role that is a constant; None for one that has a channel.

    Raises
    ------
    BindingError
        It should be one, but no value is given.
    """
    constant: float | str | None = signal.constant
    if role == "setpoint":
        constant = fixed if fixed is not None else run.setpoint if run.setpoint is not None else constant
    if constant is None or (role == "setpoint" and signal.channel is not None and fixed is None):
        return None
    if not np.isfinite(float(constant)):
        raise BindingError(
            f"{recording.path.name}: run '{run.name}' has no set-point; give it one in the rig or with"
            " --set setpoint=VALUE"
        )
    return float(constant)


def source_of(recording: Recording, run: Run, role: str, signal: Signal, joint: Joint) -> Source:
    """Return where a role comes from.

    Raises
    ------
    BindingError
        The channel is missing, is text, is empty or has no clock, or its unit does not fit.
    """
    assert signal.channel is not None
    channel = recording.channel(signal.channel.replace("{run}", run.name))
    _check(recording, channel, role)
    lever = joint.lever if role == "setpoint" and isinstance(joint, SerialJoint) else None
    return Source(
        channel=channel.name,
        where=f"{recording.path.name}: channel '{channel.name}' ({role})",
        signal=signal,
        factor=_factor(recording, channel, role, signal, joint),
        turn=_turn(channel, signal, role),
        # A turn of the rotor is no turn of the joint.
        joint_turn=signal.side == "joint" or role == "link_position" or motor_of(joint, role).gear_ratio == 1.0,
        may_stand_alone=role.startswith(SMOOTH),
        lever=lever if lever is not None and is_angle(channel, signal) else None,
        origin=origin_of(recording),
    )


def origin_of(recording: Recording) -> int:
    """Return the log's first stamp."""
    return min(int(c.stamps[0]) for c in recording.channels.values() if c.stamps.size)


def _turn(channel: Channel, signal: Signal, role: str) -> float | None:
    """Return the turn after which an encoder may wrap, as it is recorded; None for other sensors."""
    unit = _unit(channel, signal) or "rad"
    if not role.startswith(("motor_position", "link_position")) or not _converts(unit, "rad"):
        return None
    return math.tau / si_factor(unit, "rad")


def _check(recording: Recording, channel: Channel, role: str) -> None:
    where = f"{recording.path.name}: channel '{channel.name}' ({role})"
    stream = recording.streams.get(channel.stream)
    if stream is not None and stream.time_source == "none":
        if stream.time_finding is not None:
            raise BindingError(
                f"{where} has no time: {sentence(stream.time_finding)} Put the rows in order, or give their sample rate with"
                " --rate HZ"
            )
        raise BindingError(f"{where} has no time column; give its sample rate with --rate HZ")
    if channel.values.size < 2:
        raise BindingError(
            f"{where} has {'one sample' if channel.values.size else 'no samples'}; at least two are needed"
        )
    finite = np.isfinite(channel.values)
    if not finite.any():
        raise BindingError(f"{where} contains no finite number")


def motor_of(joint: Joint, role: str) -> Motor:
    """Return the motor that a role belongs to."""
    if isinstance(joint, PneumaticJoint):
        return Motor()
    name = "motor_2" if role.endswith("_2") else "motor_1"
    motor: Motor = getattr(joint, name) if hasattr(joint, name) else joint.motor  # type: ignore[union-attr]
    if role in ("setpoint", "secondary_torque"):
        return getattr(joint, "secondary_motor", None) or Motor()
    return motor


def _unit(channel: Channel, signal: Signal) -> str | None:
    return signal.unit if signal.unit is not None else channel.unit


def is_angle(channel: Channel, signal: Signal) -> bool:
    """Return whether a channel contains an angle, according to it and the rig."""
    unit = _unit(channel, signal)
    return unit is None or _converts(unit, "rad")


def is_current(channel: Channel, signal: Signal) -> bool:
    """Return whether a channel contains a current, according to it and the rig."""
    unit = _unit(channel, signal)
    return unit is not None and _converts(unit, "A")


def _converts(unit: str, like: str) -> bool:
    try:
        si_factor(unit, like)
    except UnitError:
        return False
    return True


def _factor(recording: Recording, channel: Channel, role: str, signal: Signal, joint: Joint) -> float:
    """The factor from a recorded number to SI on the joint's side of the gear, with the sign."""
    base, motor, unit = role.removesuffix("_1").removesuffix("_2"), motor_of(joint, role), _unit(channel, signal)
    gear = motor.gear_ratio if signal.side == "rotor" else 1.0
    if signal.side == "rotor" and gear == 1.0:
        raise BindingError(
            f"{recording.path.name}: channel '{channel.name}' ({role}) is on the rotor's side, and the rig has no gear: write the"
            " motor's gear_ratio, such as gear_ratio = 50, or leave out side where there is no gear"
        )
    like = role_units(role)[0]
    factor = float(signal.sign)
    if base in ("motor_torque", "secondary_torque"):
        factor *= gear
        if unit is not None and is_current(channel, signal):
            if motor.torque_constant is None:
                raise BindingError(
                    f"{recording.path.name}: channel '{channel.name}' ({role}) is a current [{unit}]: give the motor's"
                    " torque_constant in the rig"
                )
            # The torque constant is the rotor's, whichever side the rig gives for the signal.
            return float(signal.sign) * si_factor(unit, "A") * motor.torque_constant * motor.gear_ratio
    elif base in ("motor_position", "motor_velocity", "setpoint"):
        factor /= gear
    if base == "setpoint" and unit is not None and _converts(unit, "m"):
        return float(signal.sign) * si_factor(unit, "m")
    if unit is None:
        return factor
    try:
        return factor * si_factor(unit, like)
    except UnitError as error:
        raise BindingError(
            f"{recording.path.name}: channel '{channel.name}' ({role}): {error}. If the log has the unit wrong, put the"
            ' right one into the rig: { channel = "…", unit = "…" }'
        ) from error
