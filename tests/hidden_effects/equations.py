"""How visible an effect is: what the nominal machine's equations leave over, next to their noise.

Every equation is averaged with a Hann window of 25 ms; derivatives go onto the window. Its noise is that of the channels,
carried through inertias, dampings and stiffnesses. Of channels without noise, the residual is the effect alone.

    motor         B θ̈ + D θ̇ − τ_e − τ
    transmission  τ_sensor − τ_e(φ)
    link          M q̈ + D q̇ + g(q) + Σ τ_e

τ_e is the torque sensor's; where there is none, it is the nominal spring's. Where q is not measured, it is θ and the
deflection that the nominal spring has under the sensor's torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import oaconvolve

from . import _plant
from .machines import Machine
from .sensors import Quality

WINDOW = 0.025


@dataclass
class Windows:
    """The Hann window and its derivatives as weights of samples: value, first and second derivative [1, 1/s, 1/s²]."""

    value: np.ndarray
    rate: np.ndarray
    curve: np.ndarray

    @staticmethod
    def of(period: float) -> Windows:
        count = max(5, round(WINDOW / period))
        bell = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
        bell /= bell.sum()
        padded = np.concatenate([[0.0], bell, [0.0]])
        rate = np.convolve(bell, [0.5, 0.0, -0.5]) / period
        curve = np.convolve(bell, [1.0, -2.0, 1.0]) / period**2
        return Windows(padded, rate, curve)


@dataclass
class LeftOver:
    """Of one equation: the residual, averaged, shape (n,), and the standard deviation of its noise."""

    values: np.ndarray
    noise: float

    @property
    def ratio(self) -> float:
        """Rms of the residual in multiples of the noise."""
        return float(np.sqrt(np.mean(self.values**2)) / self.noise)


class Sum:
    """Adds up an equation's terms with their noise; each channel's weights are collected before they are squared."""

    def __init__(self, windows: Windows, inside: slice) -> None:
        self.windows, self.inside = windows, inside
        self.total: np.ndarray | float = 0.0
        self.weights: dict[str, np.ndarray] = {}

    def add(self, values: np.ndarray, kernel: np.ndarray) -> None:
        self.total = self.total + oaconvolve(values, kernel, mode="same")

    def noisy(self, role: str, factor: float, kernel: np.ndarray) -> None:
        # Kernels of one channel may differ in length: they are centred, or begin together.
        before = self.weights.get(role, np.zeros(1))
        both = np.zeros(max(before.size, kernel.size))
        both[: before.size] += before
        both[: kernel.size] += factor * kernel
        self.weights[role] = both

    def done(self, qualities: dict[str, Quality]) -> LeftOver:
        noise = sum(float(np.sum(w**2)) * qualities[r].deviation ** 2 for r, w in self.weights.items())
        values = np.asarray(self.total)[self.inside]
        return LeftOver(values, float(np.sqrt(noise)))


def _held(command: np.ndarray) -> np.ndarray:
    """What a held command is on average about each sample."""
    return 0.5 * (command + np.concatenate([command[:1], command[:-1]]))


@dataclass
class _Spring:
    """Of one transmission: deflection, the nominal spring's torque, its stiffness and compliance (rms), its damper's lag [s]."""

    suffix: str
    phi: np.ndarray
    torque: np.ndarray
    stiffness: float
    compliance: float
    lag: float

    def under(self, kernel: np.ndarray, period: float) -> np.ndarray:
        """Return what a kernel of the deflection is to the torque that tells it: the spring's damper makes it lag."""
        if self.lag <= 0.0:
            return self.compliance * kernel
        decay = np.exp(-period / self.lag)
        steps = np.arange(max(3, round(6.0 * self.lag / period)))
        return self.compliance * np.convolve(kernel, (1.0 - decay) * decay**steps)


def left_over(
    nominal: Machine, said: dict[str, np.ndarray], qualities: dict[str, Quality], inside: slice, period: float
) -> dict[str, LeftOver]:
    """Form the nominal machine's equations of channels.

    Parameters
    ----------
    nominal : what the rig states
    said : role → shape (N,), what the sensors say without noise; those that are not recorded are left out
    qualities : role → of its sensor
    inside : the log's part of the samples
    period : [s]
    """
    windows = Windows.of(period)
    w0, w1, w2 = windows.value, windows.rate, windows.curve
    arm = np.zeros_like(said["motor_torque" + nominal.suffixes[0]])
    if nominal.device == "serial":
        arm = nominal.lever[0] - nominal.lever[1] * said["setpoint"]
    springs = [_spring(nominal, i, suffix, said, arm, period) for i, suffix in enumerate(nominal.suffixes)]
    out = {}
    link = Sum(windows, inside)
    for i, spring in enumerate(springs):
        suffix, motor = spring.suffix, nominal.motors[i]
        theta_role = f"motor_position{suffix}"
        theta, sensor = said[theta_role], f"torque_sensor{suffix}"
        equation = Sum(windows, inside)
        equation.add(theta, motor["inertia"] * w2 + motor["damping"] * w1)
        equation.noisy(theta_role, 1.0, motor["inertia"] * w2 + motor["damping"] * w1)
        equation.add(-_held(said[f"motor_torque{suffix}"]), w0)
        equation.noisy(f"motor_torque{suffix}", -1.0, w0)
        _transmit(equation, -1.0, spring, nominal, i, said, sensor, w0, w1)
        out[f"motor{suffix}"] = equation.done(qualities)
        _transmit(link, 1.0, spring, nominal, i, said, sensor, w0, w1)
        if sensor in said and "link_position" in said:
            equation = Sum(windows, inside)
            equation.add(said[sensor], w0)
            equation.noisy(sensor, 1.0, w0)
            _formula(equation, -1.0, spring, nominal, i, w0, w1)
            out[f"transmission{suffix}"] = equation.done(qualities)
    if nominal.device == "serial":
        out["secondary_motor"] = _secondary(nominal, said, springs[0], arm, qualities, period, Sum(windows, inside))
    rig = nominal.link[0]
    kernel = rig["inertia"] * w2 + rig["damping"] * w1
    if "link_position" in said:
        q = said["link_position"]
        link.noisy("link_position", 1.0, kernel)
        link.noisy("link_position", float(rig["gravity"]), w0)
    else:
        q = said[f"motor_position{springs[0].suffix}"] + springs[0].phi
        link.noisy(f"motor_position{springs[0].suffix}", 1.0, kernel)
        link.noisy(f"torque_sensor{springs[0].suffix}", 1.0, springs[0].under(kernel, period))
    link.add(q, kernel)
    link.add(rig["gravity"] * np.sin(q - rig["hangs_at"]), w0)
    out["link"] = link.done(qualities)
    if len(springs) == 2 and "link_position" not in said:
        out["deflections"] = _twice(said, springs, qualities, period, Sum(windows, inside))
    return out


def _spring(
    nominal: Machine, i: int, suffix: str, said: dict[str, np.ndarray], arm: np.ndarray, period: float
) -> _Spring:
    theta, row = said[f"motor_position{suffix}"], nominal.springs[i]
    if "link_position" in said:
        phi = said["link_position"] - theta
    else:
        phi = _plant.deflections_under(row, said[f"torque_sensor{suffix}"], arm, period)
    torque, stiffness = curve(row, phi, arm)
    stiff, soft = (float(np.sqrt(np.mean(x**2))) for x in (stiffness, 1.0 / stiffness))
    return _Spring(suffix, phi, torque, stiff, soft, float(row["damping"]) * soft)


def curve(row: np.void, phi: np.ndarray, arm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return torque and stiffness of a bare nominal spring."""
    k1, k3 = float(row["k1"]), float(row["k3"])
    if row["law"] == _plant.CUBIC:
        return (k1 + k3 * phi**2) * phi, k1 + 3.0 * k3 * phi**2
    if row["law"] == _plant.LEVER:
        return k1 * arm**2 * np.sin(2.0 * phi), 2.0 * k1 * arm**2 * np.cos(2.0 * phi)
    s = np.clip(k3 * np.sin(0.5 * phi), -0.999999, 0.999999)
    root = np.sqrt(1.0 - s**2)
    beta, slope = np.arcsin(s) - 0.5 * phi, 0.5 * (k3 * np.cos(0.5 * phi) / root - 1.0)
    bend = 0.25 * s * (k3**2 - 1.0) / root**3
    return 2.0 * k1 * beta * slope, 2.0 * k1 * (slope**2 + beta * bend)


def _transmit(equation, sign, spring, nominal, i, said, sensor, w0, w1) -> None:
    """Add the transmitted torque, as the sensor says it or, without a sensor, as the nominal spring has it."""
    if sensor in said:
        equation.add(sign * said[sensor], w0)
        equation.noisy(sensor, sign, w0)
    else:
        _formula(equation, sign, spring, nominal, i, w0, w1)


def _formula(equation, sign, spring, nominal, i, w0, w1) -> None:
    equation.add(sign * spring.torque, w0)
    equation.add(sign * spring.phi, nominal.springs[i]["damping"] * w1)
    kernel = sign * (spring.stiffness * w0 + nominal.springs[i]["damping"] * w1)
    equation.noisy("link_position", 1.0, kernel)
    equation.noisy(f"motor_position{spring.suffix}", -1.0, kernel)


def _secondary(nominal, said, spring, arm, qualities, period, equation) -> LeftOver:
    """B_c θ̈_c + D_c θ̇_c + ψ_e − τ_c with ψ_e = −2 k b r sin²φ."""
    w0, w1, w2 = equation.windows.value, equation.windows.rate, equation.windows.curve
    motor = nominal.motors[1]
    kernel = motor["inertia"] * w2 + motor["damping"] * w1
    equation.add(said["setpoint"], kernel)
    equation.noisy("setpoint", 1.0, kernel)
    factor = -2.0 * nominal.springs[0]["k1"] * nominal.lever[1]
    equation.add(factor * arm * np.sin(spring.phi) ** 2, w0)
    slope = float(np.sqrt(np.mean((factor * arm * np.sin(2.0 * spring.phi)) ** 2)))
    if "link_position" in said:
        equation.noisy("link_position", slope, w0)
        equation.noisy("motor_position", -slope, w0)
    else:
        equation.noisy("torque_sensor", slope, spring.under(w0, period))
    equation.add(-_held(said["secondary_torque"]), w0)
    equation.noisy("secondary_torque", -1.0, w0)
    return equation.done(qualities)


def _twice(said, springs, qualities, period, equation) -> LeftOver:
    """Say where the link is twice: from either transmission."""
    w0 = equation.windows.value
    for sign, spring in zip((1.0, -1.0), springs, strict=True):
        equation.add(sign * (said[f"motor_position{spring.suffix}"] + spring.phi), w0)
        equation.noisy(f"motor_position{spring.suffix}", sign, w0)
        equation.noisy(f"torque_sensor{spring.suffix}", sign, spring.under(w0, period))
    return equation.done(qualities)


def visibility(
    nominal: Machine, said: dict[str, np.ndarray], qualities: dict[str, Quality], inside: slice, period: float
) -> float:
    """Return how visible what differs from the nominal machine is: the largest ratio of all its equations."""
    parts = left_over(nominal, said, qualities, inside, period)
    return max(part.ratio for part in parts.values())
