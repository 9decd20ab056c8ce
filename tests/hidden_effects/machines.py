"""Random machines: elastic, antagonistic (VSA-II) and serial (AwAS) joints as numbers for `_plant`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import _plant

DEVICES = {"elastic": _plant.ELASTIC, "antagonistic": _plant.ANTAGONISTIC, "serial": _plant.SERIAL}
JOINTS = {"elastic": "knee", "antagonistic": "elbow", "serial": "hip", "rigid": "wrist", "bench": "spring"}
GRAVITY = 9.81


@dataclass
class Machine:
    """A machine, as it is or as its rig states it is.

    Attributes
    ----------
    device : elastic, antagonistic or serial
    motors, springs, servos : two rows each, an elastic joint uses the first; a serial joint's second motor sets the lever
    link : one row
    lever : r₀ [m] and b [m/rad]; zeros but for a serial joint
    torque : what the joint is made for [N·m], deflection : what its spring then gives [rad]
    """

    device: str
    motors: np.ndarray
    springs: np.ndarray
    link: np.ndarray
    lever: np.ndarray
    servos: np.ndarray
    torque: float
    deflection: float

    def copy(self) -> Machine:
        arrays = (self.motors, self.springs, self.link, self.lever, self.servos)
        return Machine(self.device, *(a.copy() for a in arrays), self.torque, self.deflection)

    @property
    def code(self) -> int:
        return DEVICES[self.device]

    @property
    def joint(self) -> str:
        return JOINTS[self.device]

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Of the transmissions."""
        return ("_1", "_2") if self.device == "antagonistic" else ("",)


@dataclass
class Flaws:
    """What a sensor does to x: gain · x(t − delay) + offset + drift t + amplitude sin(x(t − delay) + phase)."""

    gain: float = 1.0
    offset: float = 0.0
    drift: float = 0.0
    delay: float = 0.0
    amplitude: float = 0.0
    phase: float = 0.0


@dataclass
class Sensors:
    """What is wrong with the sensors of a machine.

    `formula` makes a torque channel of other channels: (how, size); `jitter` is the standard deviation of the stamps [s].
    """

    flaws: dict[str, Flaws] = field(default_factory=dict)
    formula: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    jitter: float = 0.0

    def of(self, role: str) -> Flaws:
        return self.flaws.setdefault(role, Flaws())


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_machine(device: str, rng: np.random.Generator) -> Machine:
    """Draw a plausible machine without any effect."""
    motors, springs, link = np.zeros(2, _plant.MOTOR), np.zeros(2, _plant.SPRING), np.zeros(1, _plant.LINK)
    servos, lever = np.zeros(2, _plant.SERVO), np.zeros(2)
    motors["gain"], motors["gear"] = 1.0, 1.0
    springs["factor"] = 1.0
    if device == "antagonistic":
        torque, deflection = _antagonistic_springs(springs, rng)
        resonance = rng.uniform(2.5, 5.0)
        stiffness = 2.0 * torque / deflection
    elif device == "serial":
        torque, deflection = _log(rng, 4.0, 40.0), rng.uniform(0.05, 0.15)
        lever[:] = rng.uniform(0.08, 0.12), 2.5e-3 / (2.0 * np.pi) * rng.uniform(0.7, 1.5)
        stiffness = torque / deflection
        springs["law"] = _plant.LEVER
        springs["k1"] = stiffness / (2.0 * (0.75 * lever[0]) ** 2)
        resonance = rng.uniform(2.0, 4.5)
    else:
        torque, deflection = _log(rng, 1.0, 40.0), rng.uniform(0.05, 0.2)
        stiffness = torque / deflection
        hardening = rng.uniform(0.2, 0.7) if rng.random() < 0.5 else 0.0
        springs["law"] = _plant.CUBIC
        springs["k1"], springs["k3"] = stiffness * (1.0 - hardening), stiffness * hardening / deflection**2
        resonance = rng.uniform(2.0, 4.5)
    inertia = stiffness / (2.0 * np.pi * resonance) ** 2
    link["inertia"] = inertia
    # The four-bar mechanism is soft about its middle: without more damping a link would swing there all the time.
    link["damping"] = inertia * (rng.uniform(3.0, 10.0) if device == "antagonistic" else rng.uniform(0.5, 2.5))
    hanging = device == "antagonistic" or (device == "elastic" and rng.random() < 0.6)
    if hanging:
        link["gravity"] = torque * rng.uniform(0.25, 0.6)
        link["hangs_at"] = rng.uniform(-0.5, 0.5)
    for i, motor in enumerate(motors):
        motor["inertia"] = inertia * _log(rng, 0.4, 2.0) * (0.6 if device == "antagonistic" else 1.0)
        motor["gear"] = rng.choice([1.0, 5.0, 10.0, 30.0])
        if device == "antagonistic" and i == 1:
            motor["gear"] = motors[0]["gear"]
        motor["damping"] = motor["inertia"] * _log(rng, 1.0, 10.0)
        bandwidth = 2.0 * np.pi * rng.uniform(4.0, 9.0)
        servos[i]["stiffness"] = motor["inertia"] * bandwidth**2 + stiffness
        servos[i]["damping"] = 1.4 * motor["inertia"] * bandwidth
        servos[i]["limit"] = 20.0 * torque
    if device == "serial":
        _setting_motor(motors[1], servos[1], springs[0], lever, deflection, rng)
    if rng.random() < 0.6:
        springs["damping"] = springs_damping = stiffness / (2.0 * np.pi * resonance) * rng.uniform(0.02, 0.1)
        if device == "antagonistic":
            springs["damping"] = 0.5 * springs_damping
    return Machine(device, motors, springs, link, lever, servos, torque, deflection)


def _antagonistic_springs(springs: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """Fill in two four-bar springs; return the torque of one at the deflection it is used to, and that deflection."""
    springs["law"] = _plant.FOUR_BAR
    size = _log(rng, 0.3, 20.0)
    geometry = rng.uniform(1.6, 2.0)
    for spring in springs:
        spring["k1"], spring["k3"] = size * rng.uniform(0.9, 1.1), geometry
    deflection = 0.65 * 2.0 * float(np.arcsin(1.0 / geometry))
    return float(_plant.spring_torque(springs[0], deflection, 0.0)), deflection


def _setting_motor(motor, servo, spring, lever, deflection: float, rng: np.random.Generator) -> None:
    """Fill in the motor that moves the lever: small, and strongly geared."""
    reaction = 2.0 * float(spring["k1"] * lever[1] * lever[0]) * float(np.sin(deflection)) ** 2
    turns = 2.0 * np.pi * 3.0  # what it moves [rad], within some 2 s
    motor["inertia"] = (reaction / turns * 0.5 + 1e-6) * rng.uniform(0.5, 2.0)
    motor["gear"] = rng.choice([1.0, 5.0, 10.0])
    motor["damping"] = motor["inertia"] * rng.uniform(3.0, 15.0)
    bandwidth = 2.0 * np.pi * rng.uniform(2.0, 4.0)
    servo["stiffness"], servo["damping"] = motor["inertia"] * bandwidth**2, 1.4 * motor["inertia"] * bandwidth
    servo["limit"] = 1e9
