"""The effects that can be hidden in sensors."""

from __future__ import annotations

import numpy as np

from .effects import effect, spring_scale, within
from .machines import Machine


def _spring_sensors(machine: Machine) -> list[str]:
    return [f"torque_sensor{s}" for s in machine.suffixes]


def _torque_sensors(machine: Machine) -> list[str]:
    return _spring_sensors(machine) or ["torque_sensor"]


def _encoders(machine: Machine) -> list[str]:
    return [*(f"motor_position{s}" for s in machine.suffixes), "link_position"]


def _turning_encoders(machine: Machine) -> list[str]:
    # A pneumatic joint turns too little for an eccentricity to be more than an offset and a gain.
    return _encoders(machine) if machine.suffixes else []


@effect("sensor.torque_gain", _torque_sensors, within(-0.3, 0.4))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).gain = 1.0 + s
    return {"gain": 1.0 + s}


@effect("sensor.torque_offset", _torque_sensors, within(-0.4, 0.4))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).offset = s * spring_scale(machine, scales)
    return {"offset": sensors.of(part).offset}


@effect("sensor.torque_drift", _torque_sensors, within(-0.02, 0.02))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).drift = s * spring_scale(machine, scales)
    return {"rate": sensors.of(part).drift}


@effect("sensor.torque_delay", _torque_sensors, within(0.0, 0.015))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).delay = s
    return {"delay": s}


def _dependence(rng, machine, part, scales):
    return {"command": float(rng.random() < 0.3), "bend": rng.uniform(-0.5, 0.5)}


@effect("sensor.torque_not_independent", _spring_sensors, within(-0.15, 0.15), _dependence)
def _(s, shape, machine, sensors, part, scales):
    how = "command" if shape["command"] else "deflection"
    sensors.formula[part] = (how, 1.0 + s, s * shape["bend"])
    return {}


@effect("sensor.encoder_offset", _encoders, within(-0.4, 0.4))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).offset = s * scales.deflection
    return {"offset": sensors.of(part).offset}


@effect("sensor.encoder_scale", _encoders, within(-0.1, 0.1))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).gain = 1.0 + s
    return {"gain": 1.0 + s}


@effect(
    "sensor.encoder_eccentricity",
    _turning_encoders,
    within(0.0, 0.4),
    lambda rng, *_: {"phase": rng.uniform(-np.pi, np.pi)},
)
def _(s, shape, machine, sensors, part, scales):
    flaws = sensors.of(part)
    flaws.amplitude, flaws.phase = s * scales.deflection, shape["phase"]
    return {"amplitude": flaws.amplitude, "phase": flaws.phase}


@effect("sensor.clock_skew", _encoders, within(-0.015, 0.015))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).delay = s
    return {"delay": s}
