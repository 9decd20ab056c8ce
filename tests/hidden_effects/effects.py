"""The effects that can be hidden, named as in the catalogue of causes, and those outside it.

An effect has a strength: a number, 0 for none, that is scaled until the effect is as visible as asked for. What it is scaled by
(`Scales`) comes from the nominal machine's own motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .machines import GRAVITY, Machine, Sensors
from .motion import Truth

Shape = dict[str, float]
Parameters = dict[str, float]


@dataclass
class Scales:
    """What is usual in a log: torques [N·m], speeds [rad/s], deflection [rad], duration [s]; by part."""

    torque: dict[str, float]
    speed: dict[str, float]
    fastest: dict[str, float]
    deflection: float
    deflecting: float
    duration: float
    turn: dict[str, tuple[float, float]] = field(default_factory=dict)


def scales_of(machine: Machine, truth: Truth) -> Scales:
    """Learn the scales from how the nominal machine moved."""
    inside = truth.inside
    roles = {role: values[inside] for role, values in truth.roles.items()}
    torque, speed, fastest, turn = {}, {}, {}, {}
    pairs = {f"motor{s}": (f"motor_position{s}", f"torque_sensor{s}") for s in machine.suffixes}
    pairs["link"] = ("link_position", f"torque_sensor{machine.suffixes[0]}")
    if machine.device == "serial":
        pairs["secondary_motor"] = ("setpoint", "secondary_torque")
    for part, (position, torques) in pairs.items():
        rate = np.gradient(roles[position], truth.period)
        torque[part] = float(np.std(roles[torques])) * 2.0
        speed[part], fastest[part] = float(np.std(rate)), float(np.max(np.abs(rate)))
        turn[part] = float(np.min(roles[position])), float(np.max(roles[position]))
    phi = roles["link_position"] - roles[f"motor_position{machine.suffixes[0]}"]
    most = float(np.max(np.abs(phi)))
    deflecting = float(np.std(np.gradient(phi, truth.period)))
    return Scales(torque, speed, fastest, most, deflecting, float(truth.time[inside][-1]), turn)


@dataclass(frozen=True)
class Effect:
    """An effect that can be hidden.

    Attributes
    ----------
    cause : its name
    parts : machine → parts of it that may have the effect
    bounds : machine, part, scales → least and largest strength
    shape : random generator, machine, part, scales → numbers that say how the effect looks, whatever its strength
    hide : strength, shape, machine, sensors, part, scales → parameters by which it is scored; changes machine or sensors
    """

    cause: str
    parts: Callable[[Machine], list[str]]
    bounds: Callable[[Machine, str, Scales], tuple[float, float]]
    shape: Callable[[np.random.Generator, Machine, str, Scales], Shape]
    hide: Callable[[float, Shape, Machine, Sensors, str, Scales], Parameters]


EFFECTS: dict[str, Effect] = {}
OUTSIDE: dict[str, Effect] = {}
SCORED_OUTSIDE: dict[str, dict[str, Any]] = {}


def motor_of(machine: Machine, part: str) -> np.void:
    return machine.motors[1 if part in ("motor_2", "secondary_motor") else 0]


def spring_of(machine: Machine, part: str) -> np.void:
    return machine.springs[1 if part.endswith("_2") else 0]


def _motors(machine: Machine) -> list[str]:
    own = [f"motor{s}" for s in machine.suffixes]
    return [*own, "secondary_motor"] if machine.device == "serial" else own


def main_motors(machine: Machine) -> list[str]:
    """Return the motors that move the joint."""
    return [f"motor{s}" for s in machine.suffixes]


def springs(machine: Machine) -> list[str]:
    """Return the transmissions."""
    return [f"transmission{s}" for s in machine.suffixes]


def link(machine: Machine) -> list[str]:
    """Return the link; a pneumatic joint has effects of its own."""
    return ["link"] if machine.suffixes else []


def _hanging_link(machine: Machine) -> list[str]:
    return ["link"] if machine.suffixes and machine.link[0]["gravity"] else []


def plain(*_: Any) -> Shape:
    """Return the shape of an effect that has none."""
    return {}


def within(low: float, high: float):
    """Return bounds that are always the same."""
    return lambda *_: (low, high)


def effect(cause: str, parts, bounds, shape=plain, table: dict[str, Effect] | None = None):
    """Register what hides an effect."""

    def register(hide):
        (EFFECTS if table is None else table)[cause] = Effect(cause, parts, bounds, shape, hide)
        return hide

    return register


# ── Motor ──────────────────────────────────────────────────────────────────────────────────────────────────────────────


@effect("motor.inertia", _motors, within(-0.4, 0.8))
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    row["inertia"] *= 1.0 + s
    return {"inertia": float(row["inertia"])}


def _damping_bounds(row_of):
    def bounds(machine, part, scales):
        nominal = row_of(machine, part)["damping"]
        usual = scales.torque[part] / scales.speed[part]
        return -0.9 * nominal / usual, 0.4

    return bounds


@effect("motor.viscous_friction", _motors, _damping_bounds(motor_of))
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    row["damping"] += s * scales.torque[part] / scales.speed[part]
    return {"damping": float(row["damping"])}


def presliding(scales: Scales, part: str) -> float:
    """Choose the travel of bristles: about that of a good gear, a fraction of a millimetre at a hand's length."""
    return max(5e-5 * scales.fastest[part], 1e-4)


def _kinetic(row, s: float, part: str, scales: Scales) -> float:
    row["level"] = row["breakaway"] = s * scales.torque[part]
    row["stribeck"], row["presliding"] = 1.0, presliding(scales, part)
    return float(row["level"])


def _falling(rng, machine, part, scales):
    return {"rise": rng.uniform(1.4, 2.2), "speed": rng.uniform(0.04, 0.2) * scales.speed[part]}


@effect("motor.coulomb_friction", _motors, within(0.0, 0.4))
def _(s, shape, machine, sensors, part, scales):
    return {"torque": _kinetic(motor_of(machine, part), s, part, scales)}


@effect("motor.stribeck_friction", _motors, within(0.0, 0.35), _falling)
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    torque = _kinetic(row, s, part, scales)
    row["breakaway"], row["stribeck"] = torque * shape["rise"], shape["speed"]
    return {"torque": torque, "static": float(row["breakaway"]), "velocity": shape["speed"]}


@effect("motor.load_dependent_friction", main_motors, within(0.0, 0.5))
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    row["load"], row["presliding"] = s, presliding(scales, part)
    return {"share": s}


def _teeth(rng, machine, part, scales):
    low, high = scales.turn[part]
    gear = float(motor_of(machine, part)["gear"])
    # At least one and a half periods are passed, and no more than about a hundred.
    possible = [n for n in (1, 2, 3, 4, 6, 7, 8, 12, 14, 24) if 9.0 < n * gear * (high - low) < 600.0]
    return {"order": float(rng.choice(possible or [1])), "phase": rng.uniform(-np.pi, np.pi)}


@effect("motor.cogging", _motors, within(0.0, 0.3), _teeth)
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    row["cogging"], row["order"], row["phase"] = s * scales.torque[part], shape["order"], shape["phase"]
    return {"torque": float(row["cogging"]), "order": shape["order"], "phase": shape["phase"]}


@effect("motor.torque_constant", _motors, within(-0.3, 0.4))
def _(s, shape, machine, sensors, part, scales):
    motor_of(machine, part)["gain"] = 1.0 + s
    return {"gain": 1.0 + s}


@effect("motor.torque_offset", _motors, within(-0.4, 0.4))
def _(s, shape, machine, sensors, part, scales):
    motor_of(machine, part)["offset"] = s * scales.torque[part]
    return {"torque": s * scales.torque[part]}


@effect("motor.torque_delay", _motors, within(0.0, 0.015))
def _(s, shape, machine, sensors, part, scales):
    motor_of(machine, part)["delay"] = s
    return {"delay": s}


# ── Transmission ───────────────────────────────────────────────────────────────────────────────────────────────────────


def spring_scale(machine: Machine, scales: Scales) -> float:
    """Return what the torque sensors see; a joint without springs has one sensor, at its link."""
    return float(np.mean([scales.torque[f"motor{s}"] for s in machine.suffixes] or [scales.torque["link"]]))


@effect("transmission.stiffness", springs, within(-0.3, 0.4))
def _(s, shape, machine, sensors, part, scales):
    spring_of(machine, part)["factor"] = 1.0 + s
    return {"factor": 1.0 + s}


@effect("transmission.nonlinearity", springs, within(-0.15, 0.8))
def _(s, shape, machine, sensors, part, scales):
    cubic = s * machine.torque / machine.deflection**3
    spring_of(machine, part)["added_cubic"] = cubic
    return {"cubic": cubic}


@effect("transmission.asymmetry", springs, within(-0.3, 0.3))
def _(s, shape, machine, sensors, part, scales):
    spring_of(machine, part)["asymmetry"] = s
    return {"asymmetry": s}


def _transmission_damping_bounds(machine, part, scales):
    usual = spring_scale(machine, scales) / scales.deflecting
    return -float(spring_of(machine, part)["damping"]) / usual, 0.3


@effect("transmission.damping", springs, _transmission_damping_bounds)
def _(s, shape, machine, sensors, part, scales):
    row = spring_of(machine, part)
    row["damping"] = max(float(row["damping"]) + s * spring_scale(machine, scales) / scales.deflecting, 0.0)
    return {"damping": float(row["damping"])}


def _loop(rng, machine, part, scales):
    return {"width": rng.uniform(0.05, 0.25) * scales.deflection, "slips": float(rng.random() < 0.5)}


@effect("transmission.hysteresis", springs, within(0.0, 0.3), _loop)
def _(s, shape, machine, sensors, part, scales):
    row, torque = spring_of(machine, part), s * spring_scale(machine, scales)
    if shape["slips"]:
        # Three springs that slip one after another: a loop whose width is no single number, so only its height is scored.
        row["slip_torque"], row["slip_width"] = torque, 2.0 * shape["width"]
        return {"torque": torque}
    row["loop"], row["width"] = torque, shape["width"]
    return {"torque": torque, "width": shape["width"]}


@effect("transmission.backlash", springs, within(0.0, 0.45))
def _(s, shape, machine, sensors, part, scales):
    row = spring_of(machine, part)
    row["gap"], row["wall"] = s * scales.deflection, 0.002 / scales.deflecting
    return {"gap": float(row["gap"])}


@effect("transmission.stiffness_drift", springs, within(-0.012, 0.012))
def _(s, shape, machine, sensors, part, scales):
    spring_of(machine, part)["drift"] = s
    return {"rate": s}


# ── Link ───────────────────────────────────────────────────────────────────────────────────────────────────────────────


def link_of(machine: Machine, _: str = "link") -> np.void:
    return machine.link[0]


@effect("link.inertia", link, within(-0.4, 0.8))
def _(s, shape, machine, sensors, part, scales):
    row = link_of(machine)
    row["inertia"] *= 1.0 + s
    return {"inertia": float(row["inertia"])}


def _arm(rng, machine, part, scales):
    # The length of a rod with the link's inertia and gravity: M = m L²/3, m g L/2.
    row = machine.link[0]
    return {"distance": rng.uniform(0.5, 1.3) * 1.5 * GRAVITY * float(row["inertia"] / row["gravity"])}


@effect("link.payload", _hanging_link, within(0.0, 0.6), _arm)
def _(s, shape, machine, sensors, part, scales):
    row, d = link_of(machine), shape["distance"]
    mass = s * float(row["inertia"]) / d**2
    row["inertia"] += mass * d**2
    row["gravity"] += mass * GRAVITY * d
    return {"mass": mass, "distance": d}


@effect("link.gravity", _hanging_link, within(-0.5, 0.6))
def _(s, shape, machine, sensors, part, scales):
    row = link_of(machine)
    row["gravity"] *= 1.0 + s
    return {"torque": float(row["gravity"])}


@effect("link.viscous_friction", link, _damping_bounds(link_of))
def _(s, shape, machine, sensors, part, scales):
    row = link_of(machine)
    row["damping"] += s * scales.torque["link"] / scales.speed["link"]
    return {"damping": float(row["damping"])}


@effect("link.coulomb_friction", link, within(0.0, 0.3))
def _(s, shape, machine, sensors, part, scales):
    return {"torque": _kinetic(link_of(machine), s, part, scales)}


def _when(rng, machine, part, scales):
    duration = rng.uniform(0.3, 1.5)
    # Early enough to be in every hold-out too: the same push comes at the same time again.
    return {"start": rng.uniform(3.0, 16.0), "duration": duration}


@effect("link.contact", link, within(-0.8, 0.8), _when)
def _(s, shape, machine, sensors, part, scales):
    row, torque = link_of(machine), s * scales.torque["link"]
    row["push"], row["push_at"], row["push_lasts"] = torque, shape["start"], shape["duration"]
    return {"start": shape["start"], "duration": shape["duration"], "torque": torque}
