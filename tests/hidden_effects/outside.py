"""Effects that can be hidden and are not in the catalogue: a diagnosis should say that it cannot name them."""

from __future__ import annotations

from .effects import (
    OUTSIDE,
    SCORED_OUTSIDE,
    effect,
    link,
    link_of,
    main_motors,
    motor_of,
    plain,
    presliding,
    spring_of,
    springs,
    within,
)


def _outside(name: str, parts, bounds, shape, side: str, depends_on: list[str]):
    SCORED_OUTSIDE[name] = {"side": side, "depends_on": depends_on}
    return effect(name, parts, bounds, shape, OUTSIDE)


def _place(rng, machine, part, scales):
    low, high = scales.turn[part]
    return {"at": low + rng.uniform(0.35, 0.65) * (high - low), "width": rng.uniform(0.02, 0.05) * (high - low)}


@_outside("magnetic detent", main_motors, within(-0.8, 0.8), _place, "motor", ["motor_position"])
def _(s, shape, machine, sensors, part, scales):
    row = motor_of(machine, part)
    row["detent"], row["detent_at"], row["detent_width"] = s * scales.torque[part], shape["at"], shape["width"]
    return {"torque": float(row["detent"]), "angle": shape["at"], "width": shape["width"]}


def _warm_up(rng, machine, part, scales):
    return {"time": rng.uniform(0.4, 1.5) * scales.duration}


def _warm(row, s, shape, part, scales):
    row["heating"], row["warm_up"] = s * scales.torque[part], shape["time"]
    row["warm_speed"], row["presliding"] = 0.7 * scales.speed[part], presliding(scales, part)
    return {"torque": float(row["heating"]), "time": shape["time"]}


@_outside("motor friction that grows", main_motors, within(0.0, 0.8), _warm_up, "motor", ["time", "motor_velocity"])
def _(s, shape, machine, sensors, part, scales):
    return _warm(motor_of(machine, part), s, shape, part, scales)


@_outside("link friction that grows", link, within(0.0, 0.8), _warm_up, "link", ["time", "link_velocity"])
def _(s, shape, machine, sensors, part, scales):
    return _warm(link_of(machine), s, shape, part, scales)


def _moment(rng, machine, part, scales):
    return {"at": rng.uniform(0.3, 0.7) * scales.duration}


@_outside("spring that yields", springs, within(-0.5, 0.5), _moment, "transmission", ["time"])
def _(s, shape, machine, sensors, part, scales):
    row = spring_of(machine, part)
    row["yields"], row["yields_at"] = s * scales.deflection, shape["at"]
    return {"angle": float(row["yields"]), "time": shape["at"]}


@_outside("drag of the air", link, within(0.0, 0.6), plain, "link", ["link_velocity"])
def _(s, shape, machine, sensors, part, scales):
    row = link_of(machine)
    row["drag"] = s * scales.torque[part] / scales.speed[part] ** 2
    return {"drag": float(row["drag"])}
