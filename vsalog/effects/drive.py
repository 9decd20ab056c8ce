"""A motor's drive: the torque that acts, torque_gain · τ + torque_offset, of the recorded τ rounded to its least step.

Where a position is commanded instead, the drive has a loop of its own, whose torque is τ.
"""

from __future__ import annotations

from math import copysign, inf, sqrt

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING
from vsalog.core.quantities import (
    AngleWidth,
    AngularAcceleration,
    Base,
    Damping,
    Duration,
    IntegralGain,
    Speed,
    Stiffness,
    TimeSpan,
    TorqueLimit,
)
from vsalog.effects.base import Default, Effect, OneNumber
from vsalog.effects.counterpart import Counterpart, term
from vsalog.effects.quantisation import rounded

Array = NDArray[np.float64]


class PositionServo(Base, frozen=True, tag="position-servo", tag_field="kind"):
    """A drive that turns its motor to a commanded position: τ = kp (r − θ) + kd (ṙ − θ̇) + ki ∫(r − θ) dt, within ± torque_limit.

    r is the command `delay` late, held from sample to sample, and ṙ the velocity that is commanded, 0 where none is; where a
    velocity alone is, r is its integral. Where speed or acceleration are limited, r moves to the command
    as fast as they let it, from rest to rest, as most servos plan their motion.

    Attributes
    ----------
    kp : proportional gain [N·m/rad]
    kd : gain of the velocity's error [N·m·s/rad]
    ki : gain of the error's integral, frozen while the torque is at its limit [N·m/(rad·s)]
    torque_limit : largest torque; none when absent [N·m]
    delay : how long after it is recorded a command arrives [s]
    speed_limit : of r; none when absent [rad/s]
    acceleration_limit : of r; none when absent [rad/s²]
    resolution : step of the encoder that it reads [rad]
    period : of the loop [s]
    """

    kp: Stiffness
    kd: Damping = 0.0
    ki: IntegralGain = 0.0
    torque_limit: TorqueLimit | None = None
    delay: TimeSpan = 0.0
    speed_limit: Speed | None = None
    acceleration_limit: AngularAcceleration | None = None
    resolution: AngleWidth = 0.0
    period: Duration = 1e-3

    @property
    def plans(self) -> bool:
        """Whether it moves to a command by a motion of its own."""
        return self.speed_limit is not None or self.acceleration_limit is not None


def planned(command: Array, period: float, speed_limit: float, acceleration_limit: float) -> tuple[Array, Array]:
    """Return the position [rad] and velocity [rad/s] by which a servo moves to its command; it begins there, at rest.

    It accelerates and brakes with all that it may, and brakes in time to come to rest at the present command.

    Parameters
    ----------
    command : shape (N,), held for a period each [rad]
    period : of the loop [s]
    speed_limit, acceleration_limit : infinite where there is none [rad/s], [rad/s²]
    """
    position, velocity = np.empty(command.size), np.empty(command.size)
    r, v = command[0], 0.0
    for k in range(command.size):
        position[k], velocity[k] = r, v
        left, braking = command[k] - r, acceleration_limit * period
        wanted = abs(left) / period
        if braking < inf:  # the speed from which it still stops there when it brakes in steps
            wanted = min(wanted, sqrt(2.0 * acceleration_limit * abs(left) + 0.25 * braking**2) - 0.5 * braking)
        wanted = copysign(min(wanted, speed_limit), left)
        v += min(max(wanted - v, -braking), braking)
        r += v * period
    return position, velocity


def late_command(command: Array, samples: float, looks: int) -> Array:
    """Return the command that a drive has each time it looks, shape (N · looks,): held from sample to sample.

    Where it changes between two looks its mean acts, so that a delay need not be a number of looks.

    Parameters
    ----------
    command : shape (N,) [rad]
    samples : by which it arrives late
    looks : in a sample's period
    """
    begin = np.arange(command.size * looks) / looks - samples
    index = np.floor(begin + ROUNDING).astype(np.int64)
    share = np.clip((begin + 1.0 / looks - index - 1.0) * looks, 0.0, 1.0)  # of the look, with the next sample
    here, following = (command[np.clip(k, 0, command.size - 1)] for k in (index, index + 1))
    return np.asarray(here + np.where(share > ROUNDING * looks, share, 0.0) * (following - here))


def delivered(commanded: Array, gain: float, offset: float, step: float = 0.0) -> Array:
    """Return the torque that acts [N·m], its delay aside; a perfect drive gives back the same array.

    Parameters
    ----------
    commanded : shape (N,), as recorded [N·m]
    gain : torque made per torque recorded
    offset : torque made when none is recorded [N·m]
    step : least step of a command [N·m]; none when 0
    """
    made: Array = rounded(commanded, step)
    if gain != 1.0:
        made = gain * made
    return made + offset if offset else made


def commanded_for(torque: Array, gain: float, offset: float) -> Array:
    """Return what a drive has to be commanded for a torque to act [N·m], its resolution aside."""
    return (torque - offset) / gain


EFFECT = Effect(
    counterparts=(
        Counterpart("motor", ("torque_gain",), lambda m: term("actuator", gain=m.torque_gain)),
        Counterpart("motor", ("torque_offset",), lambda m: term("actuator", bias=m.torque_offset)),
        Counterpart("motor", ("torque_constant",), lambda m: term("actuator", current=m.torque_constant * m.gear_ratio)),
        Counterpart("drive", ("kp", "kd"), lambda d: term("actuator", kp=d.kp, kd=d.kd)),
        Counterpart("drive", ("torque_limit",), lambda d: term("actuator", limit=d.torque_limit)),
        Counterpart("drive", ("delay",), lambda d: term("actuator", delay=d.delay)),
        # What a part is as the joint feels it has the ratio in its numbers already.
        Counterpart(
            "motor", ("gear_ratio", "side"), lambda m: (), lambda m: term("transmission", mechanicalReduction=m.gear_ratio)
        ),
    ),
    tolerances=(
        Default(
            ("torque_constant", "torque_gain", "motor_torque.gain", "secondary_torque.gain"),
            "data sheets allow ± 10 %, and warm magnets are weaker",
            share=0.1,
        ),
        Default(("torque_offset",), "offset of a drive's current measurement", share_of_scale=0.05),
        Default(("drive.kp", "drive.kd", "drive.ki"), "firmware has gains in units of its own", share=0.5),
        Default(("drive.delay",), "a bus and a loop or two", least="20 ms"),
        Default(
            ("drive.torque_limit", "drive.speed_limit", "drive.acceleration_limit"),
            "data sheets; registers have units of their own, and a limit may be forgotten",
            share=0.2,
            share_of_scale=1.0,
        ),
    ),
    causes=(
        OneNumber(
            name="motor.torque_constant", place="motor", key="torque_gain", number="gain", unit="1", step=0.01,
            low=0.05, high=20.0, where=lambda s: not s.commanded,
            title="The {part} makes another torque than is recorded: its torque constant is off",
            says="its motor equation is off in proportion to the motor's torque",
            confirm="Hold the link against a force gauge and command several torques: compare.",
            reference="Flacco 2012 eq. 4, τ",
            signature="motor equation: τ",
        ),
        OneNumber(
            name="motor.torque_offset", place="motor", key="torque_offset", number="torque", unit="N*m",
            step=lambda s: 1e-3 * s.torque, scale=lambda s: s.torque, where=lambda s: not s.commanded,
            title="The {part} makes a torque when none is recorded: its drive has an offset",
            says="its motor equation is off by a constant",
            confirm="Command no torque and see on which side the joint comes to rest, or which torque holds it still.",
            reference="Flacco 2012 eq. 4, τ",
            signature="motor equation: 1",
        ),
        OneNumber(
            name="drive.proportional_gain", place="drive", key="kp", number="kp", unit="N*m/rad",
            step=lambda s: 0.01 * s.value, low=lambda s: 0.05 * s.value, high=lambda s: 20.0 * s.value, scale=lambda s: s.value,
            title="The drive's torque for a position error differs from the rig: its proportional gain is off",
            says="the motor equation is off in proportion to the error of the position",
            confirm="Hold the command and push the link with a force gauge: compare torque and angle.",
            reference="a drive's position loop",
            signature="motor equation: r − θ",
        ),
        OneNumber(
            name="drive.derivative_gain", place="drive", key="kd", number="kd", unit="N*m*s/rad",
            step=lambda s: 1e-3 * s.torque / s.speed, low=0.0, scale=lambda s: s.torque / s.speed,
            title="The drive's damping differs from the rig: its derivative gain is off",
            says="the motor equation is off in proportion to the error of the velocity",
            confirm="Command ramps of several speeds: an error that grows with the speed is damping that is not the drive's own.",
            reference="a drive's position loop",
            signature="motor equation: ṙ − θ̇",
        ),
        OneNumber(
            name="drive.delay", place="drive", key="delay", number="delay", unit="s",
            step=lambda s: 0.25 * s.period,  low=0.0, scale=lambda s: s.period, doubles=("sensor.clock_skew",),
            title="The command arrives later than it is recorded",
            says="the motor equation is off in proportion to the command's rate",
            confirm="Command a step and look at when the joint begins to move.",
            reference="a bus, and a loop that looks at it",
            signature="motor equation: ṙ",
        ),
    ),
)  # fmt: skip
