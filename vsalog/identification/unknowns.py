"""The numbers of a joint that a log is to determine, and how well each is known before."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles
from vsalog.binding.role_source import is_current
from vsalog.core.errors import DiagnosisError, did_you_mean
from vsalog.core.recording import Recording
from vsalog.core.units import shown
from vsalog.residuals.sensing import motors_of, torque_role
from vsalog.rig.numbers import Number, numbers_of, with_number
from vsalog.rig.tolerance import default_deviation

Array = NDArray[np.float64]


class Spread(NamedTuple):
    """How far a number may be off, and how far it is moved for its slope.

    Attributes
    ----------
    wider : times the default tolerance that a number may be off where the rig states none: a first fit presumes little
    step : part of its prior deviation, or of its value where that is less, by which it is moved; of its usual deviation at least
    """

    wider: float = 10.0
    step: float = 0.01


SPREAD = Spread()


@dataclass(frozen=True, slots=True)
class Unknown:
    """A number of a joint that is fitted.

    A positive one with a relative tolerance is fitted as its logarithm, others as they are; both in units of the prior deviation.

    Attributes
    ----------
    number : as the rig has it
    deviation : prior standard deviation, of the logarithm or of the value
    logarithmic : which
    stated : whether the rig states its tolerance
    scale : the value that would matter in the log, for a number that may be zero
    least_step : change below which a simulation does not respond smoothly [unit of the number]; 0 for none
    """

    number: Number
    deviation: float
    logarithmic: bool
    stated: bool
    scale: float
    least_step: float = 0.0

    def usual(self, unknown: float) -> float:
        """Return how well a rig usually knows such a number, or this one states it: one standard deviation of the unknown."""
        if self.stated:
            return 1.0
        value = self.value(unknown)
        return default_deviation(self.key, value, self.scale) / abs(self.slope(unknown))

    @property
    def key(self) -> str:
        """Its key's path below the joint."""
        return self.number.key

    def value(self, unknown: float) -> float:
        """Return the number at a distance from the rig's, in prior deviations."""
        if self.logarithmic:
            return float(self.number.value * np.exp(self.deviation * unknown))
        return float(self.number.value + self.deviation * unknown)

    def slope(self, unknown: float) -> float:
        """Return the change of the value with the unknown."""
        return self.value(unknown) * self.deviation if self.logarithmic else self.deviation

    @property
    def bounds(self) -> tuple[float, float]:
        """Return the least and the largest that the unknown may be."""
        if self.logarithmic:
            return -np.inf, np.inf
        number = self.number
        return (number.low - number.value) / self.deviation, (number.high - number.value) / self.deviation

    def step(self, unknown: float) -> float:
        """Return the step of the unknown for its slope."""
        slope = self.slope(unknown)
        # A number near zero has no size of its own.
        size = min(max(abs(self.value(unknown)) / slope, self.usual(unknown)) or 1.0, 1.0)
        step = max(SPREAD.step * size, self.least_step / slope)
        return -step if unknown + step > self.bounds[1] else step


@dataclass(frozen=True, slots=True)
class Scales:
    """Sizes that matter in a log, for numbers that may be zero.

    Attributes
    ----------
    torque : usual torque [N·m]
    speed : usual velocity [rad/s]
    period : of the grid [s]
    """

    torque: float
    speed: float
    period: float

    def of(self, unit: str, value: float) -> float:
        """Return the value of such a unit that would matter."""
        sizes = {"N*m": self.torque, "N*m*s/rad": self.torque / self.speed}
        return sizes.get(unit, abs(value))

    def of_part(self, part: Any) -> Scales:
        """Return the sizes at a part of the joint: those of a rotor are the other side of its gear's."""
        if getattr(part, "side", "joint") == "joint":
            return self
        return replace(self, torque=self.torque / part.gear_ratio, speed=self.speed * part.gear_ratio)


def unknowns_of(
    joint: Any,
    stated: Mapping[str, float],
    scales: Scales,
    free: Sequence[str] = (),
    fixed: Sequence[str] = (),
    moving: Collection[str] = (),
) -> list[Unknown]:
    """Return the numbers of a joint that are to be fitted.

    They are those that the rig gives and that machines of one make may differ in: a default tolerance of their kind is no zero.
    Of sensors only numbers count whose tolerance the rig states. Whatever moves is damped: that is fitted even where the rig
    does not give it.

    Parameters
    ----------
    joint : of the rig, as it is written
    stated : key's path below the joint → one standard deviation
    scales : of the log
    free : keys, or patterns as ``motor.*``, that are fitted, too, even where the rig leaves them at their default
    fixed : keys or patterns that are not
    moving : parts of the joint that torques move

    Raises
    ------
    DiagnosisError
        A pattern fits no number of the joint.
    """
    numbers, damped = numbers_of(joint), {f"{part}.damping" for part in moving}
    for pattern in (*free, *fixed):
        if not any(_fits(n.key, [pattern]) for n in numbers):
            hint = did_you_mean(pattern, [n.key for n in numbers])
            raise DiagnosisError(f"no number of the joint has the key '{shown(pattern)}'{hint or '.'}")
    found = []
    for number in numbers:
        asked, own = _fits(number.key, free), stated.get(number.key)
        sensor = number.path[0] == "signals"
        if _fits(number.key, fixed) or own == 0.0:
            continue
        given = number.key in damped or not (number.default or sensor)
        if not asked and (number.exact or (own is None and not given)):
            continue
        unknown = _unknown(joint, number, own, scales)
        if unknown is not None:
            found.append(unknown)
        elif asked:
            raise DiagnosisError(f"'{number.key}' is exact: its kind has no tolerance")
    return found


def unstated_frictions(
    joint: Any, stated: Mapping[str, float], scales: Scales, fixed: Sequence[str], moving: Collection[str]
) -> list[Unknown]:
    """Return the Coulomb frictions of moving parts of which the rig gives no dry friction: a machine may have them or not.

    Parameters
    ----------
    joint, stated, scales, fixed, moving : as of `unknowns_of`
    """
    keys = {f"{part}.friction.coulomb" for part in moving if not getattr(joint, part).friction.rubs}
    keys -= {key for key in keys if _fits(key, fixed) or key in stated}
    found = (_unknown(joint, number, None, scales) for number in numbers_of(joint) if number.key in keys)
    return [unknown for unknown in found if unknown is not None]


def _fits(key: str, patterns: Collection[str]) -> bool:
    return any(key == p or fnmatchcase(key, p) for p in patterns)


def _unknown(joint: Any, number: Number, stated: float | None, scales: Scales) -> Unknown | None:
    scale = scales.of_part(getattr(joint, number.path[0])).of(number.unit, number.value)
    deviation = stated
    if deviation is None:
        try:
            deviation = SPREAD.wider * default_deviation(number.key, number.value, scale)
        except KeyError:
            return None
    if not deviation > 0.0:
        return None
    least = 0.25 * scales.period if number.unit == "s" else 0.0
    if number.positive and number.value > 0.0 and number.low == 0.0:
        return Unknown(number, deviation / number.value, True, stated is not None, scale, least)
    return Unknown(number, deviation, False, stated is not None, scale, least)


def placed(joint: Any, unknowns: Sequence[Unknown], values: Array) -> Any:
    """Return a joint, as it is written, with other numbers.

    Parameters
    ----------
    joint : of the rig
    unknowns : p of them
    values : shape (p,), in prior deviations from the rig
    """
    for unknown, value in zip(unknowns, values, strict=True):
        joint = with_number(joint, unknown.number.path, unknown.value(float(value)))
    return joint


def torque_constants_without_effect(recording: Recording, joint: Any) -> Iterator[str]:
    """Yield the keys of torque constants that convert nothing of a recording, as no current is in it."""
    for name in motors_of(joint):
        signal = offered_roles(joint).get(torque_role(name))
        channel = None if signal is None or signal.channel is None else recording.channels.get(signal.channel)
        current = signal is not None and channel is not None and is_current(channel, signal)
        if getattr(joint, name).torque_constant is not None and not current:
            yield f"{name}.torque_constant"


def as_felt(joint: Any) -> Any:
    """Return a joint with all that its motors have as the joint feels it; its sensors stay as they are written."""
    return structs.replace(joint, **{name: getattr(joint, name).reflected for name in motors_of(joint)})


def felt(joint: Any, unknowns: Sequence[Unknown], values: Array) -> Any:
    """Return a joint with other numbers as it feels what was recorded; parameters as of `placed`.

    Recorded currents became torques by the rig's own torque constants: another one is a gain of these torques.
    """
    out = placed(joint, unknowns, values)
    for unknown, value in zip(unknowns, values, strict=True):
        name, key = unknown.number.path[0], unknown.number.path[-1]
        if key == "torque_constant":
            motor, ratio = getattr(out, name), unknown.value(float(value)) / unknown.number.value
            out = structs.replace(out, **{name: structs.replace(motor, torque_gain=motor.torque_gain * ratio)})
    return as_felt(out)
