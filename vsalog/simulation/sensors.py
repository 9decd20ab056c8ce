"""What sensors make of the truth: encoder steps, noise, the steps of an analogue-to-digital converter."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vsalog.errors import SimulationError

Array = NDArray[np.float64]

# Noise streams are numbered by role, so that a sensor more or less does not change the noise of the others.
NOISE_STREAM = {
    "motor_torque": 0,
    "motor_torque_1": 1,
    "motor_torque_2": 2,
    "torque_sensor": 3,
    "torque_sensor_1": 4,
    "torque_sensor_2": 5,
}

# Roles whose truth goes by another name.
_SENSED = {
    "torque_sensor": "flexibility_torque",
    "torque_sensor_1": "flexibility_torque_1",
    "torque_sensor_2": "flexibility_torque_2",
    "setpoint": "secondary_position",
}


@dataclass(frozen=True, slots=True)
class Sensors:
    """The sensors of a joint; a zero switches an effect off.

    Attributes
    ----------
    motor_pulses, link_pulses, secondary_pulses : encoder pulses per turn
    rounding : ``round`` to the nearest pulse, or ``floor`` to the last one passed (half a pulse late on average)
    motor_torque_noise : gaussian noise of the recorded motor torque, on the joint's side [N·m rms] (Flacco 2012 eq. 42)
    torque_sensor_noise : gaussian noise of the torque sensor [N·m rms] (Flacco 2012 eq. 43)
    torque_step : least step of both recorded torques [N·m], an analogue-to-digital converter's
    """

    motor_pulses: int = 0
    link_pulses: int = 0
    secondary_pulses: int = 0
    rounding: Literal["round", "floor"] = "round"
    motor_torque_noise: float = 0.0
    torque_sensor_noise: float = 0.0
    torque_step: float = 0.0

    def __post_init__(self) -> None:
        numbers = (self.motor_pulses, self.link_pulses, self.secondary_pulses)
        levels = (self.motor_torque_noise, self.torque_sensor_noise, self.torque_step)
        if min(numbers) < 0 or not all(np.isfinite(v) and v >= 0.0 for v in levels):
            raise SimulationError("sensors: pulses, noise and steps must be zero or positive")


IDEAL = Sensors()


def encoder(angle: Array, pulses: int, rounding: Literal["round", "floor"] = "round") -> Array:
    """Return the angle [rad] as an encoder of `pulses` per turn counts it; unchanged for 0 pulses."""
    return angle.copy() if pulses == 0 else _stepped(angle, encoder_step(pulses), rounding)


def encoder_step(pulses: int) -> float:
    """Return the angle of one pulse [rad], 0 for an ideal encoder."""
    return 2.0 * np.pi / pulses if pulses else 0.0


def torque_reading(torque: Array, role: str, noise: float, step: float, seed: int) -> Array:
    """Return a torque [N·m] with gaussian noise [N·m rms], rounded to `step` [N·m].

    Parameters
    ----------
    torque : true values
    role : which torque it is, one of `NOISE_STREAM`; picks the stream of random numbers
    noise, step : 0 for none
    seed : of the experiment
    """
    reading = torque.copy()
    if noise > 0.0:
        generator = np.random.default_rng([seed, NOISE_STREAM[role]])
        reading += noise * generator.standard_normal(torque.shape)
    return _stepped(reading, step, "round") if step > 0.0 else reading


def sense(
    truth: Mapping[str, Array], sensors: Sensors, seed: int, roles: Collection[str]
) -> tuple[dict[str, Array], dict[str, float]]:
    """Return role → reading and role → least step, in SI on the joint's side.

    Parameters
    ----------
    truth : as in `Experiment`
    sensors : what they make of it
    seed : of the noise
    roles : those wanted; ``setpoint`` is the secondary motor's angle θ_c
    """
    measured, resolution = {}, {}
    for role in sorted(roles):
        quantity = _SENSED.get(role, role)
        if role == "torque_sensor" and "flexibility_torque_total" in truth:
            quantity = "flexibility_torque_total"
        if quantity not in truth:
            continue
        if "torque" in role:
            noise = sensors.motor_torque_noise if role.startswith("motor") else sensors.torque_sensor_noise
            measured[role] = torque_reading(truth[quantity], role, noise, sensors.torque_step, seed)
            resolution[role] = sensors.torque_step
        elif role.startswith("deflection"):
            # The difference of two encoders, as a controller would log it.
            motor = role.replace("deflection", "motor_position")
            measured[role] = encoder(truth["link_position"], sensors.link_pulses, sensors.rounding) - encoder(
                truth[motor], sensors.motor_pulses, sensors.rounding
            )
            resolution[role] = encoder_step(sensors.link_pulses)
        else:
            pulses = sensors.motor_pulses if role.startswith("motor") else sensors.link_pulses
            pulses = sensors.secondary_pulses if role == "setpoint" else pulses
            measured[role] = encoder(truth[quantity], pulses, sensors.rounding)
            resolution[role] = encoder_step(pulses)
    return measured, resolution


def _stepped(values: Array, step: float, rounding: Literal["round", "floor"]) -> Array:
    counts = np.round(values / step) if rounding == "round" else np.floor(values / step)
    # The sum turns −0 into 0.
    return np.asarray(counts * step + 0.0)
