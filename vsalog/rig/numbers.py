"""The numbers of a joint: their keys, their units, and their possible values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec
from msgspec import inspect, structs

from vsalog.rig.decode import key_path

Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Number:
    """A number of a joint.

    Attributes
    ----------
    path : of its key below the joint
    value : SI
    unit : SI; empty where it has none
    low, high : bounds that the key has
    positive : whether it must be above `low`
    exact : whether it is chosen, so that no machine differs from it
    default : whether the rig leaves it at its default
    """

    path: Path
    value: float
    unit: str
    low: float
    high: float
    positive: bool
    exact: bool
    default: bool

    @property
    def key(self) -> str:
        """Its key's path as TOML writes it."""
        return key_path(self.path)


def numbers_of(joint: Any) -> list[Number]:
    """Return all numbers of a joint, in the order of its tables."""
    return list(_numbers(joint, ()))


def with_number(part: Any, path: Sequence[str], value: float) -> Any:
    """Return a joint, or a part of one, with one number changed.

    Parameters
    ----------
    part : joint, structure or tuple
    path : of the number below it
    value : SI
    """
    name, rest = path[0], path[1:]
    if isinstance(part, tuple):
        at = int(name.strip("[]"))
        own = value if not rest else with_number(part[at], rest, value)
        return (*part[:at], own, *part[at + 1 :])
    own = value if not rest else with_number(getattr(part, name), rest, value)
    return structs.replace(part, **{name: own})


def _numbers(part: Any, path: Path) -> Iterator[Number]:
    kind: Any = type(part)
    for field in _fields(kind):
        value, here = getattr(part, field.name), (*path, field.encode_name)
        if isinstance(value, msgspec.Struct):
            yield from _numbers(value, here)
        elif isinstance(value, tuple):
            for i, item in enumerate(value):
                if isinstance(item, msgspec.Struct):
                    yield from _numbers(item, (*here, f"[{i}]"))
                elif isinstance(item, float):
                    yield _number(_float_of(field.type), item, (*here, f"[{i}]"), default=False)
        elif isinstance(value, float):
            yield _number(_float_of(field.type), value, here, default=value == field.default)


@cache
def _fields(kind: Any) -> tuple[inspect.Field, ...]:
    info = inspect.type_info(kind)
    return info.fields if isinstance(info, inspect.StructType) else ()


def _float_of(kind: inspect.Type) -> tuple[inspect.FloatType, dict[str, Any]]:
    """Return the type of the number in a field, and its metadata."""
    extra: dict[str, Any] = {}
    while True:
        if isinstance(kind, inspect.Metadata):
            extra |= kind.extra or {}
            kind = kind.type
        elif isinstance(kind, inspect.UnionType):
            kind = next(t for t in kind.types if "float" in repr(t).lower())
        elif isinstance(kind, inspect.VarTupleType):
            kind = kind.item_type
        else:
            return (kind if isinstance(kind, inspect.FloatType) else inspect.FloatType()), extra


def _number(found: tuple[inspect.FloatType, dict[str, Any]], value: float, path: Path, default: bool) -> Number:
    kind, extra = found
    low = kind.gt if kind.gt is not None else kind.ge
    high = kind.lt if kind.lt is not None else kind.le
    return Number(
        path, value, str(extra.get("unit", "")), -float("inf") if low is None else float(low),
        float("inf") if high is None else float(high), kind.gt is not None, bool(extra.get("exact", False)), default,
    )  # fmt: skip
