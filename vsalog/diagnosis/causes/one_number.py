"""Causes that are one number of the rig: the rows of the effects' tables, at the parts of a joint where they may sit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

from msgspec.structs import replace

from vsalog.binding.joint import signal_of
from vsalog.core.errors import ExtensionError
from vsalog.diagnosis.causes.base import (
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    commanded,
    is_rigid,
    link_equation,
    moved_motors,
    one_clock,
    recorded,
    scale_of,
    suffix_of,
    transmissions_of,
)
from vsalog.diagnosis.causes.pneumatic import TWINS, filled, pulls
from vsalog.effects.base import OneNumber, Place, Sizes, valued
from vsalog.effects.drive import PositionServo
from vsalog.mechanics.links import link_weight
from vsalog.rig.schema import Link, Motor, PneumaticJoint, Signal
from vsalog.rig.tolerance import default_deviation

TORQUES = ("torque_sensor", "torque_sensor_1", "torque_sensor_2")
ANGLES = ("motor_position", "motor_position_1", "motor_position_2", "link_position")
ENCODERS = (*ANGLES, "deflection", "deflection_1", "deflection_2")
CLOCKED = (*ENCODERS, "pressure_1", "pressure_2", "valve_1", "valve_2")


class Found(NamedTuple):
    """A part of a joint, what the rig has there, and sizes as `Sizes` has them."""

    part: str
    there: Any
    torque: float = 0.0
    speed: float = 0.0
    deflection: float = 0.0
    range: float = 0.0


class OneNumberCause(Cause):
    """A cause that is one number of the rig."""

    def __init__(self, row: OneNumber) -> None:
        _require_known(row)
        self.row = row
        self.name, self.title, self.says, self.confirm = row.name, row.title, row.says, row.confirm
        self.reference, self.signature, self.order, self.exact = row.reference, row.signature, row.order, row.exact

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per part of its kind."""
        for part, there, torque, speed, deflection, span in PLACES[self.row.place](setting):
            suffix = suffix_of(part)
            seen = {f"deflection{suffix}", "link_position"} & set(setting.roles)
            sizes = Sizes(
                attrgetter(self.row.key)(there), torque, speed, deflection, span, setting.period, setting.duration,
                one_clock=one_clock(setting),
                one_body=link_equation(setting) == "motor",
                rotor=is_rigid(setting.joint) and setting.joint.motor.inertia is not None,
                commanded=commanded(setting),
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
                signal = with_number(signal_of(getattr(joint.signals, part)), row.key, float(values[0]))
                return replace(joint, signals=replace(joint.signals, **{part: signal}))
            changed = with_number(getattr(joint, part), row.key, max(float(values[0]), low))
            return replace(joint, **{part: changed})

        def starts(_: Remainder) -> list[tuple[float, ...]]:
            return [(valued(rule, sizes),) for rule in row.starts]

        doubles = row.doubles if row.doubled(sizes) else ()
        return Site(row.name, part, (parameter,), apply, starts if row.starts else None, doubles=doubles)


def _require_known(row: OneNumber) -> None:
    """Require that a row's key is a number of the part where it sits, and that its tolerance is known."""
    part, path = PARTS.get(row.place, (None, ""))
    try:
        if part is not None and not isinstance(attrgetter(row.key)(part), float):
            raise AttributeError
        default_deviation(f"{path}{row.key}", 0.0, 1.0)
    except (AttributeError, KeyError):
        raise ExtensionError(
            f"the cause '{row.name}' is of '{row.key}', which is no number of a {row.place}, or one without a tolerance"
        ) from None


def with_number(part: Any, key: str, number: float) -> Any:
    """Return a part of a rig with a number changed, which may be in a table of it, as ``drag.coefficient``."""
    name, _, rest = key.partition(".")
    return replace(part, **{name: with_number(getattr(part, name), rest, number) if rest else number})


def _motors(setting: Setting) -> Iterator[Found]:
    for name in moved_motors(setting):
        yield Found(name, getattr(setting.joint, name), *scale_of(setting, name))


def _drives(setting: Setting) -> Iterator[Found]:
    if "motor" in moved_motors(setting) and commanded(setting):
        yield Found("drive", setting.joint.drive, *scale_of(setting, "motor"))


def _transmissions(setting: Setting) -> Iterator[Found]:
    for name in transmissions_of(setting.joint):
        if suffix_of(name) in setting.deflections:
            deflection = setting.deflection_size(suffix_of(name))
            torque, speed = setting.torque_size(), setting.speed("link_position")
            yield Found(name, getattr(setting.joint, name), torque, speed, deflection)


def _link(setting: Setting) -> Iterator[Found]:
    if link_equation(setting) is not None:
        yield Found("link", setting.joint.link, setting.torque_size(), setting.speed("link_position"))


def _torque_sensors(setting: Setting) -> Iterator[Found]:
    for role, signal in recorded(setting, TORQUES):
        yield Found(role, signal, setting.torque_size(role))


def _encoders(setting: Setting) -> Iterator[Found]:
    for role, signal in recorded(setting, ENCODERS) if _has_places(setting) else ():
        yield Found(role, signal, deflection=setting.deflection_size(suffix_of(role)))


def _clocks(setting: Setting) -> Iterator[Found]:
    for role, signal in recorded(setting, CLOCKED):
        yield Found(role, signal)


def _has_places(setting: Setting) -> bool:
    """Return whether a shifted joint differs: a rigid one needs a second encoder or a torque over position for that."""
    joint = setting.joint
    if not is_rigid(joint) or "encoders" in setting.equations:
        return True
    bodies = [(joint.motor, joint.motor.gear_ratio), *([] if joint.link is None else [(joint.link, 1.0)])]
    over_position = any(torque.slopes(ratio)[0] for body, ratio in bodies for torque in body.torques)
    return over_position or (joint.link is not None and link_weight(joint.link) != 0.0)


def _valves(setting: Setting) -> Iterator[Found]:
    for twin in TWINS:
        if filled(setting, twin):
            valve = getattr(setting.joint, f"valve{twin}")
            yield Found(f"valve{twin}", valve, range=valve.voltage[-1] - valve.voltage[0])


def _filled_muscles(setting: Setting) -> Iterator[Found]:
    for twin in TWINS:
        if filled(setting, twin):
            valve = getattr(setting.joint, f"valve{twin}")
            most = max(valve.inflow_area, valve.outflow_area) * valve.area_scale or 1e-8
            yield Found(f"muscle{twin}", getattr(setting.joint, f"muscle{twin}"), range=most)


def _pulling_muscles(setting: Setting) -> Iterator[Found]:
    if isinstance(setting.joint, PneumaticJoint) and pulls(setting, "seesaw", "transmission"):
        for twin in TWINS:
            yield Found(f"muscle{twin}", getattr(setting.joint, f"muscle{twin}"))


PLACES: dict[Place, Callable[[Setting], Iterator[Found]]] = {
    "motor": _motors,
    "drive": _drives,
    "transmission": _transmissions,
    "link": _link,
    "torque sensor": _torque_sensors,
    "encoder": _encoders,
    "clock": _clocks,
    "valve": _valves,
    "filled muscle": _filled_muscles,
    "pulling muscle": _pulling_muscles,
}
SENSORS = frozenset({"torque sensor", "encoder", "clock"})
# In what the keys of rows are looked for, and where that is in the rig.
PARTS: dict[Place, tuple[Any, str]] = {
    "motor": (Motor(inertia=1.0), "motor."),
    "drive": (PositionServo(kp=1.0), "drive."),
    "link": (Link(inertia=1.0), "link."),
    "torque sensor": (Signal(), "signals.torque_sensor."),
    "encoder": (Signal(), "signals.link_position."),
    "clock": (Signal(), "signals.link_position."),
}
