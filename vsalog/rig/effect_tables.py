"""Parts of a rig and the tables that effects add to them: `vsalog.effects` has the effects."""

from __future__ import annotations

import inspect
from functools import cache
from types import GenericAlias
from typing import Any, ClassVar

import msgspec

from vsalog.core.errors import ExtensionError
from vsalog.core.quantities import Base
from vsalog.effects import effects
from vsalog.effects.base import Key
from vsalog.effects.body_torque import BodyTorque
from vsalog.effects.reading_error import ReadingError


class Part(Base, frozen=True):
    """A part of a rig to which effects add keys."""

    KEYS: ClassVar[tuple[Key, ...]] = ()

    def tables(self, key: Key) -> tuple[Any, ...]:
        """Return the tables under a key, without one that does nothing."""
        there = getattr(self, key.name)
        if key.many:
            return tuple(there)
        return () if there == _absent(key) else (there,)


class Body(Part, frozen=True):
    """The common base of motors and links."""

    @property
    def torques(self) -> tuple[BodyTorque, ...]:
        """The tables of effects."""
        return tuple(torque for key in self.KEYS for torque in self.tables(key))

    def geared_torques(self, ratio: float) -> dict[str, Any]:
        """Return key → tables of effects, reduced to the output of a gear of that ratio."""
        geared = {key: tuple(torque.geared(ratio) for torque in self.tables(key)) for key in self.KEYS}
        return {key.name: _value(key, tables) for key, tables in geared.items()}


class Sensor(Part, frozen=True):
    """The common base of signals of all kinds."""

    @property
    def errors(self) -> tuple[ReadingError, ...]:
        """The tables of effects on a reading."""
        return tuple(error for key in self.KEYS for error in self.tables(key))

    def scaled_errors(self, factor: float) -> dict[str, Any]:
        """Return key → tables of effects on a reading that is multiplied."""
        scaled = {key: tuple(error.scaled(factor) for error in self.tables(key)) for key in self.KEYS}
        return {key.name: _value(key, tables) for key, tables in scaled.items()}

    def no_errors(self) -> dict[str, Any]:
        """Return key → value for no error."""
        return {key.name: _absent(key) for key in self.KEYS}


def composed(core: type[Part], part: str) -> type[msgspec.Struct]:
    """Return a part of the rig with the keys that effects add to it.

    Raises
    ------
    ExtensionError
        An effect of a third party adds a key that the part has.
    """
    keys = tuple(key for effect in effects().values() for key in effect.keys if key.part == part)
    for key in keys:
        if hasattr(core, key.name):
            raise ExtensionError(
                f"the key '{key.name}' that an effect adds to each {part} exists already; choose another name"
            )
    fields: list[tuple[str, Any, Any]] = [(key.name, _kind(key), _absent(key)) for key in keys]
    words = inspect.cleandoc(core.__doc__ or "") + "".join(f"\n{key.name} : {key.says}" for key in keys)
    names = {"__doc__": words, "__module__": core.__module__, "KEYS": keys}
    return msgspec.defstruct(core.__name__.removesuffix("Core"), fields, bases=(core,), namespace=names, frozen=True)


def _kind(key: Key) -> Any:
    if key.many:
        return GenericAlias(tuple, (key.table, ...))
    return key.table if _absent(key) is not None else key.table | None


@cache
def _absent(key: Key) -> Any:
    """Return the value for no effect: no tables, a table whose defaults do nothing, or none where a key has no default."""
    if key.many:
        return ()
    return None if any(field.required for field in msgspec.structs.fields(key.table)) else key.table()


def _value(key: Key, tables: tuple[Any, ...]) -> Any:
    return tables if key.many else tables[0] if tables else _absent(key)
