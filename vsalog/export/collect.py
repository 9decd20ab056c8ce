"""What a rig's keys become in a model: effects say it of their own keys, and a key of which none says anything is lacking."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgspec

from vsalog.effects import effects
from vsalog.effects.counterpart import Counterpart, Dialect, Lack, Term
from vsalog.rig.decode import Path
from vsalog.rig.schema import TransmissionEffects

REASON: dict[Dialect, str] = {"mjcf": "MJCF has nothing like it", "urdf": "URDF has nothing like it"}
ONCE = ("joint", "inertial", "actuator", "spring", "rotor", "dynamics", "transmission")
"""Elements of which a part has one."""


@dataclass(frozen=True, slots=True)
class Parts:
    """What one or two parts of a joint become.

    Attributes
    ----------
    numbers : (element, attribute) → what terms of elements that a part has once add up to; a gain is their product
    terms : of further elements
    """

    numbers: dict[tuple[str, str], float] = field(default_factory=dict)
    terms: list[Term] = field(default_factory=list)

    def of(self, element: str, attribute: str) -> float:
        """Return a number, 0 where there is none; a gain is then 1."""
        return self.numbers.get((element, attribute), float(attribute == "gain"))

    def take(self, one: Term) -> None:
        """Add a term to what there is."""
        if one.element not in ONCE:
            self.terms.append(one)
            return
        for name, value in one.attributes.items():
            there = self.of(one.element, name)
            self.numbers[one.element, name] = there * value if name == "gain" else there + value

    def absorb(self, other: Parts) -> None:
        """Add what another part becomes that turns as one with this."""
        for (element, name), value in other.numbers.items():
            self.take(Term(element, {name: value}))
        self.terms.extend(other.terms)


Lacking = dict[Path, str]
"""Path of a key of the rig → why a model has nothing like it."""


def collect(
    dialect: Dialect, kind: str, part: Any, path: Path, into: Parts, lacking: Lacking, leave: tuple[str, ...] = ()
) -> None:
    """Add what a part of a rig becomes.

    Parameters
    ----------
    dialect : of the model
    kind : ``motor``, ``drive``, ``link`` or ``transmission``
    part : as the joint feels it
    path : of the part in the rig
    into, lacking : what is added to
    leave : keys that something else stands for
    """
    stated = {name for name in _stated(kind, part) if name not in leave}
    for told in _counterparts(kind):
        if stated.isdisjoint(told.keys):
            continue
        stated -= set(told.keys)
        say = told.mjcf if dialect == "mjcf" else told.urdf
        if say is None:
            lacking.update({(*path, key): REASON[dialect] for key in told.keys if key in _stated(kind, part)})
            continue
        for one in say(part):
            if isinstance(one, Lack):
                lacking[(*path, *one.key.split("."))] = one.reason
            else:
                into.take(one)
    lacking.update({(*path, key): REASON[dialect] for key in sorted(stated)})


def _counterparts(kind: str) -> Iterator[Counterpart]:
    return (told for effect in effects().values() for told in effect.counterparts if told.part == kind)


def _stated(kind: str, part: Any) -> list[str]:
    """Return the keys whose values are not their defaults; of a transmission those that any may have, not its spring's."""
    names = TransmissionEffects.__struct_fields__ if kind == "transmission" else part.__struct_fields__
    fields = [f for f in msgspec.structs.fields(part) if f.name in names]
    return [f.name for f in fields if f.required or getattr(part, f.name) != _default(f)]


def _default(field: msgspec.structs.FieldInfo) -> Any:
    return field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
