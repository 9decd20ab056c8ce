"""What a log says of what truly happened: flaws, noise, steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from . import _plant
from .machines import Flaws, Machine, Sensors
from .motion import Truth


@dataclass
class Quality:
    """How good a channel is.

    Attributes
    ----------
    noise : standard deviation of white noise [SI]
    step : of the rounding [SI]; 0 for none
    """

    noise: float
    step: float

    @property
    def deviation(self) -> float:
        """Of noise and rounding together."""
        return float(np.hypot(self.noise, self.step / np.sqrt(12.0)))


POSITIONS = ("motor_position", "motor_position_1", "motor_position_2", "link_position", "setpoint", "deflection")


def random_qualities(machine: Machine, truth: Truth, rng: np.random.Generator) -> dict[str, Quality]:
    """Draw encoders of 14 to 19 bit on the joint's side and torque sensors of 0.1 to 0.5 % of what they see."""
    motor_bits, link_bits = rng.integers(14, 20), rng.integers(14, 20)
    sensor, drive = rng.uniform(0.001, 0.005), rng.uniform(0.0003, 0.0015)
    out = {}
    for role, values in truth.roles.items():
        span = float(np.ptp(values[truth.inside]))
        if role in POSITIONS:
            bits = link_bits if role == "link_position" else motor_bits
            out[role] = Quality(0.0, 2.0 * np.pi / 2.0 ** int(bits))
        else:
            noise = span * (sensor if role.startswith("torque_sensor") else drive)
            out[role] = Quality(noise, noise / 4.0)
    return out


def flawed(values: np.ndarray, time: np.ndarray, flaws: Flaws) -> np.ndarray:
    """Return what a sensor without noise says: gain · x(t − delay) + offset + drift t + amplitude sin(x(t − delay) + phase)."""
    x = values
    if flaws.delay:
        x = CubicSpline(time, values)(np.clip(time - flaws.delay, time[0], time[-1]))
    said = flaws.gain * x + flaws.offset + flaws.drift * time
    if flaws.amplitude:
        said = said + flaws.amplitude * np.sin(x + flaws.phase)
    return said


def ideal(truth: Truth, sensors: Sensors, nominal: Machine) -> dict[str, np.ndarray]:
    """Return what sensors with flaws, but without noise and steps, say: role → shape (N,)."""
    said = {role: flawed(v, truth.time, sensors.flaws.get(role, Flaws())) for role, v in truth.roles.items()}
    if sensors.jitter:
        # A value is taken for that of another moment.
        at = truth.time - stamp_errors(truth.time.size, sensors, truth.period, np.random.default_rng(truth.time.size))
        for role, values in said.items():
            if not role.startswith(("motor_torque", "secondary_torque")):
                said[role] = CubicSpline(truth.time, values)(at)
    for role in sensors.formula:
        said[role] = _formula(role, said, sensors, nominal)
    return said


def stamp_errors(count: int, sensors: Sensors, period: float, rng: np.random.Generator) -> np.ndarray:
    """Draw by how much stamps are off [s]; they stay in their order."""
    return np.clip(sensors.jitter * rng.standard_normal(count), -0.45 * period, 0.45 * period)


def recorded(
    truth: Truth, sensors: Sensors, nominal: Machine, qualities: dict[str, Quality], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Return what is in the log: role → shape (N,), the log's part only."""
    out = {}
    for role, values in truth.roles.items():
        said = flawed(values, truth.time, sensors.flaws.get(role, Flaws()))
        quality = qualities[role]
        said = said + quality.noise * rng.standard_normal(said.size)
        out[role] = np.round(said / quality.step) * quality.step if quality.step else said
    for role in sensors.formula:
        out[role] = _formula(role, out, sensors, nominal)
    return {role: values[truth.inside] for role, values in out.items()}


def _formula(role: str, said: dict[str, np.ndarray], sensors: Sensors, nominal: Machine) -> np.ndarray:
    """Make a torque channel of other channels, as a driver without a torque sensor may do."""
    how, gain, bend = sensors.formula[role]
    suffix = role.removeprefix("torque_sensor")
    if how == "command":
        return -gain * said[f"motor_torque{suffix}"]
    phi = said["link_position"] - said[f"motor_position{suffix}"]
    arm = nominal.lever[0] - nominal.lever[1] * said["setpoint"] if nominal.device == "serial" else 0.0
    x = phi / nominal.deflection
    return gain * (1.0 + bend * x**2) * spring_torques(nominal, suffix, phi, arm)


def spring_torques(machine: Machine, suffix: str, phi: np.ndarray, arm: np.ndarray | float) -> np.ndarray:
    """Return the torque of a machine's bare spring over a deflection."""
    spring = machine.springs[1 if suffix == "_2" else 0]
    arms = np.broadcast_to(np.asarray(arm, dtype=float), phi.shape)
    return np.array([_plant.spring_torque(spring, u, r) for u, r in zip(phi, arms, strict=True)])
