"""The model's terms for a rig's keys: each effect exports its own keys; a key without an effect is not supported."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgspec

from vsalog.effects import effects
from vsalog.effects.counterpart import Counterpart, Dialect, Lack, Term
from vsalog.rig.decode import Path
from vsalog.rig.schema import TransmissionEffects

REASON: dict[Dialect, str] = {"mjcf": "MJCF does not support it", "urdf": "URDF does not support it"}
ONCE = ("joint", "inertial", "actuator", "spring", "rotor", "dynamics", "transmission")
"""Elements of which a part has one."""


@dataclass(frozen=True, slots=True)
class Parts:
    """The terms of one or two parts of a joint.

    Attributes
    ----------
    numbers : (element, attribute) → sum of the terms of elements that a part has once; of a gain their product
    terms : of further elements
    """

    numbers: dict[tuple[str, str], float] = field(default_factory=dict)
    terms: list[Term] = field(default_factory=list)

    def of(self, element: str, attribute: str) -> float:
        """Return a number, 0 where there is none; a gain is then 1."""
        return self.numbers.get((element, attribute), float(attribute == "gain"))

    def take(self, one: Term) -> None:
        """Add a term."""
        if one.element not in ONCE:
            self.terms.append(one)
            return
        for name, value in one.attributes.items():
            there = self.of(one.element, name)
            self.numbers[one.element, name] = there * value if name == "gain" else there + value

    def absorb(self, other: Parts) -> None:
        """Add the terms of another part that turns as one with this."""
        for (element, name), value in other.numbers.items():
            self.take(Term(element, {name: value}))
        self.terms.extend(other.terms)


Lacking = dict[Path, str]
"""Path of a key of the rig → why a model does not support it."""


def collect(
    dialect: Dialect, kind: str, part: Any, path: Path, into: Parts, lacking: Lacking, leave: tuple[str, ...] = ()
) -> None:
    """Add the terms of a part of a rig.

    Parameters
    ----------
    dialect : of the model
    kind : ``motor``, ``drive``, ``link`` or ``transmission``
    part : reduced to the joint
    path : of the part in the rig
    into, lacking : added to
    leave : keys that something else replaces
    """
    stated = {name for name in _stated(kind, part) if name not in leave}
    for counterpart in _counterparts(kind):
        if stated.isdisjoint(counterpart.keys):
            continue
        stated -= set(counterpart.keys)
        export = counterpart.mjcf if dialect == "mjcf" else counterpart.urdf
        if export is None:
            lacking.update({(*path, key): REASON[dialect] for key in counterpart.keys if key in _stated(kind, part)})
            continue
        for one in export(part):
            if isinstance(one, Lack):
                lacking[(*path, *one.key.split("."))] = one.reason
            else:
                into.take(one)
    lacking.update({(*path, key): REASON[dialect] for key in sorted(stated)})


def _counterparts(kind: str) -> Iterator[Counterpart]:
    return (
        counterpart for effect in effects().values() for counterpart in effect.counterparts if counterpart.part == kind
    )


def _stated(kind: str, part: Any) -> list[str]:
    """Return the keys whose values are not their defaults; of a transmission those that any may have, not its spring's."""
    names = TransmissionEffects.__struct_fields__ if kind == "transmission" else part.__struct_fields__
    fields = [f for f in msgspec.structs.fields(part) if f.name in names]
    return [f.name for f in fields if f.required or getattr(part, f.name) != _default(f)]


def _default(field: msgspec.structs.FieldInfo) -> Any:
    return field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
