"""Causes that are one number of the rig: the rows of the effects' tables, at the parts of a joint where they may sit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from vsalog.diagnosis.causes.base import (
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    is_rigid,
    link_equation,
    moved_motors,
    one_clock,
    recorded,
    scale_of,
    suffix_of,
    transmissions_of,
    with_part,
    with_signal,
)
from vsalog.effects.base import OneNumber, Place, Sizes, valued
from vsalog.mechanics.links import link_weight

TORQUES = ("torque_sensor", "torque_sensor_1", "torque_sensor_2")
ANGLES = ("motor_position", "motor_position_1", "motor_position_2", "link_position")
ENCODERS = (*ANGLES, "deflection", "deflection_1", "deflection_2")
CLOCKED = (*ENCODERS, "pressure_1", "pressure_2", "valve_1", "valve_2")

# A part, what the rig has there, and the sizes of torque, velocity and deflection.
Found = tuple[str, Any, float, float, float]


class OneNumberCause(Cause):
    """A cause that is one number of the rig."""

    def __init__(self, row: OneNumber) -> None:
        self.row = row
        self.name, self.title, self.says, self.confirm = row.name, row.title, row.says, row.confirm
        self.reference, self.signature, self.order, self.exact = row.reference, row.signature, row.order, row.exact

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per part of its kind."""
        for part, there, torque, speed, deflection in PLACES[self.row.place](setting):
            suffix = suffix_of(part)
            seen = {f"deflection{suffix}", "link_position"} & set(setting.roles)
            sizes = Sizes(
                getattr(there, self.row.key), torque, speed, deflection, setting.period, setting.duration,
                one_clock=one_clock(setting),
                one_body=link_equation(setting) == "motor",
                rotor=is_rigid(setting.joint) and setting.joint.motor.inertia is not None,
                computable=not seen and f"transmission{suffix}" in transmissions_of(setting.joint),
            )  # fmt: skip
            if self.row.where(sizes):
                yield self._site(part, sizes)

    def _site(self, part: str, sizes: Sizes) -> Site:
        row = self.row
        step, low, high, reach, blur, scale = (
            valued(rule, sizes) for rule in (row.step, row.low, row.high, row.reach, row.blur, row.scale)
        )
        parameter = Parameter(
            row.number, row.unit, sizes.value, step, low, high, reach, blur=blur, key=row.key, scale=scale
        )

        def apply(joint: Any, values: Sequence[float]) -> Any:
            if row.place in SENSORS:
                return with_signal(joint, part, **{row.key: float(values[0])})
            return with_part(joint, part, **{row.key: max(float(values[0]), low)})

        def starts(_: Remainder) -> list[tuple[float, ...]]:
            return [(valued(rule, sizes),) for rule in row.starts]

        doubles = row.doubles if row.doubled(sizes) else ()
        return Site(row.name, part, (parameter,), apply, starts if row.starts else None, doubles=doubles)


def _motors(setting: Setting) -> Iterator[Found]:
    for name in moved_motors(setting):
        yield name, getattr(setting.joint, name), *scale_of(setting, name), 0.0


def _transmissions(setting: Setting) -> Iterator[Found]:
    for name in transmissions_of(setting.joint):
        if suffix_of(name) in setting.deflections:
            deflection = setting.deflection_size(suffix_of(name))
            torque, speed = setting.torque_size(), setting.speed("link_position")
            yield name, getattr(setting.joint, name), torque, speed, deflection


def _link(setting: Setting) -> Iterator[Found]:
    if link_equation(setting) is not None:
        yield "link", setting.joint.link, setting.torque_size(), setting.speed("link_position"), 0.0


def _torque_sensors(setting: Setting) -> Iterator[Found]:
    for role, signal in recorded(setting, TORQUES):
        yield role, signal, setting.torque_size(role), 0.0, 0.0


def _encoders(setting: Setting) -> Iterator[Found]:
    for role, signal in recorded(setting, ENCODERS) if _has_places(setting) else ():
        yield role, signal, 0.0, 0.0, setting.deflection_size(suffix_of(role))


def _clocks(setting: Setting) -> Iterator[Found]:
    for role, signal in recorded(setting, CLOCKED):
        yield role, signal, 0.0, 0.0, 0.0


def _has_places(setting: Setting) -> bool:
    """Tell whether a joint is elsewhere another one: a rigid one is where neither weight nor cogging nor a second encoder is."""
    joint = setting.joint
    if not is_rigid(joint) or "encoders" in setting.equations:
        return True
    return bool(joint.motor.cogging) or (joint.link is not None and link_weight(joint.link) != 0.0)


PLACES: dict[Place, Callable[[Setting], Iterator[Found]]] = {
    "motor": _motors,
    "transmission": _transmissions,
    "link": _link,
    "torque sensor": _torque_sensors,
    "encoder": _encoders,
    "clock": _clocks,
}
SENSORS = frozenset({"torque sensor", "encoder", "clock"})
