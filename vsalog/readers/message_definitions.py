"""ROS message definitions → a tree of types that the decoder can walk.

The definitions in a log are text from elsewhere: they are parsed, never turned into code.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum
from functools import cache, lru_cache
from typing import Any

from vsalog.core.printable import LONGEST_TEXT, MAX_DEPTH
from vsalog.readers.fields import LONG_NAMES
from vsalog.readers.limits import MOST_STEPS

# Seconds and nanoseconds in ROS 1, where a date is unsigned and a duration signed, and in ROS 2.
TIMES = {
    "builtin_interfaces/msg/Time": (("u4", "u4"), ("i4", "u4")),
    "builtin_interfaces/msg/Duration": (("i4", "i4"), ("i4", "u4")),
}

# Name in a definition → NumPy type code without the byte order.
SCALARS = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "int16": "i2",
    "int32": "i4",
    "int64": "i8",
    "uint8": "u1",
    "uint16": "u2",
    "uint32": "u4",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}


class Kind(IntEnum):
    """Kinds of field that a parsed definition distinguishes; anything else is an array of varying length."""

    BASIC, MESSAGE, FIXED_ARRAY = range(1, 4)


# Text that the parser skips or misunderstands, and where it has no meaning.
_REMARK = {
    "msg": re.compile(r"#[^\n]*|\"[^\"\n]*\"|'[^'\n]*'"),
    "idl": re.compile(r"//[^\n]*|/\*.*?\*/|\"(?:[^\"\\]|\\.)*\"", re.DOTALL),
}
_WIDE = {"msg": re.compile(r"^[ \t]*(wstring)\b", re.MULTILINE), "idl": re.compile(r"\b(wstring|wchar)\b")}
_OPTIONAL = re.compile(r"@optional\b(?!\s*\(\s*(?:value\s*=\s*)?FALSE)")

_PLACEHOLDER = "structure_needs_at_least_one_member"
_RULE = "=" * 80


class DefinitionError(Exception):
    """A message definition cannot be understood; the message has the reason."""


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number of NumPy type `code` (without byte order) that takes `size` bytes."""

    code: str
    size: int


@dataclass(frozen=True, slots=True)
class Text:
    """A string."""


@dataclass(frozen=True, slots=True)
class Time:
    """Seconds and nanoseconds, four bytes each, of NumPy types `seconds` and `fraction` (without the byte order)."""

    seconds: str
    fraction: str

    def code(self, order: str) -> str:
        """Return both types with a byte order, ``<i4,<u4``."""
        return f"{order}{self.seconds},{order}{self.fraction}"


@dataclass(frozen=True, slots=True)
class Array:
    """`count` elements, or as many as the message states (None)."""

    element: Node
    count: int | None


@dataclass(frozen=True, slots=True)
class Struct:
    """Named fields in order; `named` is whether it has an array of strings next to another array."""

    name: str
    fields: tuple[tuple[str, Node], ...]
    named: bool


Node = Scalar | Text | Time | Array | Struct


def normal_type(name: str) -> str:
    """Return a ROS type name with its middle part, ``sensor_msgs/msg/Imu`` for ``sensor_msgs/Imu``."""
    parts = [part for part in name.replace("::", "/").split("/") if part]
    if len(parts) == 2:
        return f"{parts[0]}/msg/{parts[1]}"
    return "/".join(parts)


@lru_cache
def parse_definition(name: str, text: str, language: str, ros1: bool) -> Struct:
    """Return the tree of a message type.

    Parameters
    ----------
    name : str
        Type name as the log gives it.
    text : str
        Definition with those of the types it contains; "" means the type is one of ROS itself.
    language : str
        ``msg`` or ``idl``.
    ros1 : bool
        Which ROS the built-in types are taken from: ROS 1 headers have a sequence number.

    Raises
    ------
    DefinitionError
        The text does not parse, or a type is missing, recursive or of a kind that is no number.
    """
    name = normal_type(name)
    table = dict(_builtin_types(ros1))
    if text.strip():
        table.update(_parse_text(name, text.replace("\r\n", "\n"), language))
    elif language and name not in table:
        table[name] = ([], [])  # a message without fields
    return _Builder(table, ros1).struct(name, ())


def ros1_checksum(name: str, text: str) -> str:
    """Return the MD5 sum that ROS 1 identifies a message type by.

    Parameters
    ----------
    name : str
        Type name as the log gives it.
    text : str
        Definition with those of the types it contains.

    Raises
    ------
    DefinitionError
        The text does not parse, or a type is missing.
    """
    from rosbags.typesys import Stores, get_typestore

    name = normal_type(name)
    types = _parse_text(name, text.replace("\r\n", "\n"), "msg")
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(types)
        return str(store.generate_msgdef(name, ros_version=1)[1])
    except Exception as error:  # whatever a foreign text provokes in the library
        raise DefinitionError(f"the definition of {name} is not complete") from error


def _parse_text(name: str, text: str, language: str) -> dict[str, Any]:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if len(text) > MOST_STEPS:
        raise DefinitionError(f"the definition of {name} has {len(text)} characters; larger ones are not read")
    code = _REMARK[language].sub("", text)
    if wide := _WIDE[language].search(code):
        # Vendors disagree on how many bytes a character has.
        raise DefinitionError(f"fields of type {wide[1]} are not supported")
    if language == "idl" and _OPTIONAL.search(code):
        raise DefinitionError("optional fields are not supported")  # the parser would take them for there always
    try:
        if language == "msg":
            return dict(get_types_from_msg(text, name))
        types: dict[str, Any] = {}
        for part in _idl_parts(text):
            types.update(get_types_from_idl(part))
        return types
    except RecursionError:
        raise DefinitionError(f"the definition of {name} is nested too deeply") from None
    except Exception as error:  # whatever a foreign text provokes in the parser, the message type is unreadable
        first_line = (str(error).splitlines() or [type(error).__name__])[0]
        raise DefinitionError(f"the definition of {name} is not understood ({first_line.rstrip(':')})") from error


def _idl_parts(text: str) -> list[str]:
    """Split concatenated IDL files at their ``=====`` rules; each part starts with an ``IDL: name`` line."""
    if not text.lstrip().startswith(_RULE):
        return [text]
    parts = []
    for part in text.split(_RULE + "\n"):
        head, _, body = part.lstrip().partition("\n")
        if head.startswith("IDL: "):
            parts.append(body)
        elif part.strip():
            parts.append(part)
    return parts


@cache
def _builtin_types(ros1: bool) -> dict[str, Any]:
    from rosbags.typesys import Stores, get_typestore

    return dict(get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE).fielddefs)


class _Builder:
    """Builds each type once, so that a type used a thousand times is one object."""

    def __init__(self, table: dict[str, Any], ros1: bool) -> None:
        self.table = table
        self.ros1 = ros1
        self.built: dict[str, Struct] = {}

    def struct(self, name: str, outer: tuple[str, ...]) -> Struct:
        if name in self.built:
            return self.built[name]
        if name in outer:
            raise DefinitionError(f"{name} contains itself")
        if len(outer) > MAX_DEPTH:
            raise DefinitionError(f"{outer[0]} is nested too deeply")
        if name not in self.table:
            raise DefinitionError(f"the log lacks the definition of {name or 'its messages'}")
        if any(len(field) > LONGEST_TEXT for field, _ in self.table[name][1]):
            raise DefinitionError(f"{name} has field {LONG_NAMES}")
        fields = [
            (field, self.node(description, (*outer, name)))
            for field, description in self.table[name][1]
            if field != _PLACEHOLDER
        ]
        if not fields and not self.ros1:
            fields = [(_PLACEHOLDER, Scalar("u1", 1))]  # CDR has no empty structure: it has one byte
        strings = sum(isinstance(node, Array) and isinstance(node.element, Text) for _, node in fields)
        arrays = sum(isinstance(node, Array) for _, node in fields)
        found = self.built[name] = Struct(name, tuple(fields), named=strings > 0 and arrays > 1)
        return found

    def node(self, description: Any, outer: tuple[str, ...]) -> Node:
        kind, detail = int(description[0]), description[1]
        if kind == Kind.BASIC:
            return self.basic(detail[0])
        if kind == Kind.MESSAGE:
            return Time(*TIMES[detail][0 if self.ros1 else 1]) if detail in TIMES else self.struct(detail, outer)
        return Array(self.node(detail[0], outer), detail[1] if kind == Kind.FIXED_ARRAY else None)

    def basic(self, name: str) -> Node:
        if name == "string":
            return Text()
        if name not in SCALARS:
            raise DefinitionError(f"fields of type {name} are not supported")
        code = "i1" if name == "byte" and self.ros1 else SCALARS[name]
        return Scalar(code, int(code[1]))


def is_placeholder(field: str) -> bool:
    """Return whether a field is the placeholder of an empty structure."""
    return field == _PLACEHOLDER
