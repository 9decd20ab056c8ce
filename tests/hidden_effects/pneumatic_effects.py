"""The effects that can be hidden in a pneumatic joint next to those of its sensors."""

from __future__ import annotations

import numpy as np

from .effects import OUTSIDE, SCORED_OUTSIDE, Scales, effect, within
from .motion import Truth


def scales_of(machine, truth: Truth) -> Scales:
    """Learn the scales from how the nominal machine moved; its only part is the link, the seesaw."""
    psi, torque = (truth.roles[r][truth.inside] for r in ("link_position", "torque_sensor"))
    rate = np.gradient(psi, truth.period)
    return Scales(
        torque={"link": 2.0 * float(np.std(torque))},
        speed={"link": float(np.std(rate))},
        fastest={"link": float(np.max(np.abs(rate)))},
        deflection=float(np.max(np.abs(psi))),
        deflecting=float(np.std(rate)),
        duration=float(truth.time[truth.inside][-1]),
        turn={"link": (float(np.min(psi)), float(np.max(psi)))},
    )


def _pneumatic(machine) -> bool:
    return machine.device == "pneumatic"


def _twins(name: str):
    return lambda machine: [f"{name}_1", f"{name}_2"] if _pneumatic(machine) else []


def _row(machine, part: str) -> np.void:
    return machine.muscles[int(part[-1]) - 1]


@effect("pneumatic.leak", _twins("muscle"), within(0.0, 0.3))
def _(s, shape, machine, sensors, part, scales):
    row = _row(machine, part)
    row["leak"] = s * row["inflow"]
    return {"area": float(row["leak"])}


@effect("pneumatic.orifice_area", _twins("valve"), within(-0.3, 0.4))
def _(s, shape, machine, sensors, part, scales):
    _row(machine, part)["scale"] = 1.0 + s
    return {"scale": 1.0 + s}


@effect("pneumatic.valve_offset", _twins("valve"), within(-0.5, 0.5))
def _(s, shape, machine, sensors, part, scales):
    _row(machine, part)["offset"] = s
    return {"offset": s}


@effect("pneumatic.pressure_offset", _twins("pressure"), within(-4e4, 4e4))
def _(s, shape, machine, sensors, part, scales):
    sensors.of(part).offset = s
    return {"offset": s}


@effect("pneumatic.force_gain", _twins("muscle"), within(-0.25, 0.3))
def _(s, shape, machine, sensors, part, scales):
    _row(machine, part)["gain"] = 1.0 + s
    return {"gain": 1.0 + s}


@effect("pneumatic.muscle_friction", lambda m: ["friction"] if _pneumatic(m) else [], within(-0.9, 8.0))
def _(s, shape, machine, sensors, part, scales):
    row = machine.seesaw[0]
    row["muscle"] *= 1.0 + s
    return {"muscle": float(row["muscle"])}


def _seesaw(machine) -> list[str]:
    return ["link"] if _pneumatic(machine) else []


def _place(rng, machine, part, scales):
    low, high = scales.turn["link"]
    return {"at": low + rng.uniform(0.35, 0.65) * (high - low), "width": rng.uniform(0.03, 0.06) * (high - low)}


@effect("seesaw's magnetic detent", _seesaw, within(-0.8, 0.8), _place, OUTSIDE)
def _(s, shape, machine, sensors, part, scales):
    row = machine.seesaw[0]
    row["bump"], row["bump_at"], row["bump_width"] = s * scales.torque["link"], shape["at"], shape["width"]
    return {"torque": float(row["bump"]), "angle": shape["at"], "width": shape["width"]}


def _warm_up(rng, machine, part, scales):
    return {"time": rng.uniform(0.4, 1.5) * scales.duration}


@effect("seesaw friction that grows", _seesaw, within(0.0, 0.8), _warm_up, OUTSIDE)
def _(s, shape, machine, sensors, part, scales):
    row = machine.seesaw[0]
    row["heating"], row["warm_up"] = s * scales.torque["link"], shape["time"]
    row["warm_speed"] = 0.7 * scales.speed["link"]
    return {"torque": float(row["heating"]), "time": shape["time"]}


SCORED_OUTSIDE["seesaw's magnetic detent"] = {"side": "link", "depends_on": ["link_position"]}
SCORED_OUTSIDE["seesaw friction that grows"] = {"side": "link", "depends_on": ["time", "link_velocity"]}
