"""The channel of each role of a joint in a log, and the model of its sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

from vsalog.core.quantities import (
    Base,
    CountsPerTurn,
    Fraction,
    Ratio,
    RoleRate,
    RoleSpread,
    RoleStep,
    RoleValue,
    Stiffness,
    Time,
    TimeSpan,
)
from vsalog.rig.effect_tables import Sensor, composed

# The quantities a role may be measured as, before torque constant and lever convert a current or an angle.
ROLE_UNITS: dict[str, tuple[str, ...]] = {
    "motor_position": ("rad",),
    "link_position": ("rad",),
    "motor_velocity": ("rad/s",),
    "link_velocity": ("rad/s",),
    "link_acceleration": ("rad/s^2",),
    "deflection": ("rad",),
    "commanded_position": ("rad",),
    "commanded_velocity": ("rad/s",),
    "motor_torque": ("N*m", "A"),
    "torque_sensor": ("N*m",),
    "external_torque": ("N*m",),
    "setpoint": ("rad", "m"),
    "secondary_torque": ("N*m", "A"),
    "accelerometer_x": ("m/s^2",),
    "accelerometer_y": ("m/s^2",),
    "accelerometer_z": ("m/s^2",),
    "pressure": ("Pa",),
    "valve": ("V",),
}


def role_units(role: str) -> tuple[str, ...]:
    """Return the SI units that a role may be measured in; ``motor_position_1`` is a ``motor_position``."""
    return ROLE_UNITS[role.removesuffix("_1").removesuffix("_2")]


class SignalCore(Sensor, frozen=True):
    """The source of a role in the log, and its conversion to SI on the joint's side.

    With m = sign × (recorded, in SI, divided or multiplied by the gear ratio when `side` is rotor), the sensor's reading is
    m(t) = gain · x(t − delay) + offset + drift · t + errors of tables + noise, and vsalog uses x.

    Attributes
    ----------
    channel : name as `vsalog inspect` prints it; ``{run}`` is replaced by the run's name
    constant : a value instead of a channel (a set-point that does not move)
    unit : of the channel; by default that of the log, else SI
    counts_per_turn : of an encoder that is recorded in counts; a loaded rig has it as the unit, ``rev/4096``
    side : ``rotor`` when it was measured on the rotor's side of the gear: positions are divided, torques multiplied by its ratio
    sign : −1 when the recording has the opposite sign
    offset : the sensor's reading at zero, in SI; subtracted
    gain : the sensor's reading per unit; divided by
    drift : change of the offset per second from the log's start, in SI
    delay : of the sensor, or lead of its clock [s]; a negative one is early
    series_stiffness : of a part in series whose deflection is measured too, such as the dynamometer's own; the torque sensor's
        torque over it is subtracted from a `deflection` [N·m/rad]
    resolution : least step of the sensor, in SI; taken from the data when absent; the simulation rounds to it
    noise : standard deviation of gaussian noise, in SI; for the simulation
    jitter : standard deviation of the stamps [s]; for the simulation
    dropped : share of the samples that are missing; for the simulation
    """

    channel: str | None = None
    constant: RoleValue | None = None
    unit: str | None = None
    counts_per_turn: CountsPerTurn | None = None
    side: Literal["joint", "rotor"] = "joint"
    sign: Literal[1, -1] = 1
    offset: RoleValue = 0.0
    gain: Ratio = 1.0
    drift: RoleRate = 0.0
    delay: Time = 0.0
    series_stiffness: Stiffness | None = None
    resolution: RoleStep | None = None
    noise: RoleSpread = 0.0
    jitter: TimeSpan = 0.0
    dropped: Fraction = 0.0


if TYPE_CHECKING:
    Signal: TypeAlias = SignalCore
else:
    Signal = composed(SignalCore, "signal")

# A role may be given in short, as a channel's name or as a number, or in full, as a table.
SignalSpec = str | float | Signal


VELOCITIES = ("motor_velocity", "link_velocity")
"""A driver's velocities from its encoders, which positions are compared with."""

COMMANDS = ("commanded_position", "commanded_velocity")
"""Commands of a drive."""


class SingleSignals(Base, frozen=True):
    """The roles of a joint with one transmission.

    `commanded_position` and `commanded_velocity` are those of the drive, on the joint's side; `external_torque` is a
    push on the link; `motor_velocity` and `link_velocity` are those that a driver reports along with its positions;
    `link_acceleration` is that of the joint, q̈; `accelerometer_x`, `accelerometer_y` and `accelerometer_z` are the axes of an
    accelerometer on the link, mounted as the chain says.
    """

    motor_position: SignalSpec | None = None
    motor_torque: SignalSpec | None = None
    commanded_position: SignalSpec | None = None
    commanded_velocity: SignalSpec | None = None
    link_position: SignalSpec | None = None
    motor_velocity: SignalSpec | None = None
    link_velocity: SignalSpec | None = None
    link_acceleration: SignalSpec | None = None
    deflection: SignalSpec | None = None
    torque_sensor: SignalSpec | None = None
    external_torque: SignalSpec | None = None
    accelerometer_x: SignalSpec | None = None
    accelerometer_y: SignalSpec | None = None
    accelerometer_z: SignalSpec | None = None


class SerialSignals(SingleSignals, frozen=True):
    """The roles of a serial variable stiffness joint: those of one transmission and the set-point (θ_c, or lever arm r).

    `secondary_torque` is that of the motor that moves the set-point.
    """

    setpoint: SignalSpec | None = None
    secondary_torque: SignalSpec | None = None


class AntagonisticSignals(Base, frozen=True):
    """The roles of an antagonistic joint: one link, two motors, two transmissions.

    `torque_sensor` is one sensor for the whole joint, `torque_sensor_1` and `torque_sensor_2` are one per transmission.
    """

    motor_position_1: SignalSpec | None = None
    motor_position_2: SignalSpec | None = None
    motor_torque_1: SignalSpec | None = None
    motor_torque_2: SignalSpec | None = None
    link_position: SignalSpec | None = None
    motor_velocity_1: SignalSpec | None = None
    motor_velocity_2: SignalSpec | None = None
    link_velocity: SignalSpec | None = None
    link_acceleration: SignalSpec | None = None
    deflection_1: SignalSpec | None = None
    deflection_2: SignalSpec | None = None
    torque_sensor: SignalSpec | None = None
    torque_sensor_1: SignalSpec | None = None
    torque_sensor_2: SignalSpec | None = None
    external_torque: SignalSpec | None = None
    accelerometer_x: SignalSpec | None = None
    accelerometer_y: SignalSpec | None = None
    accelerometer_z: SignalSpec | None = None


class Run(Base, frozen=True):
    """One stretch of data under a fixed set-point, when a log or a set of logs holds several.

    `name` replaces ``{run}`` in the signals' channels (a group inside a file); `file` is a pattern that the
    log's name must match for the run to apply.
    """

    name: str = ""
    file: str = "*"
    setpoint: str | float | None = None
