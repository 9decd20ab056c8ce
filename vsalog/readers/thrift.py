"""Thrift's compact protocol, in which Parquet writes its footer and the headers of its pages."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from vsalog.readers.limits import MAX_DEPTH


class Type(IntEnum):
    """Types of fields (thrift-compact-protocol.md)."""

    TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)


Fields = dict[int, Any]
"""A structure by the numbers of its fields: integers, bytes, lists, structures; None for what nobody needs."""


def integer(fields: Fields, number: int, otherwise: int = -1) -> int:
    """Return a field that is an integer, another number where it is missing or something else."""
    value = fields.get(number)
    return value if isinstance(value, int) else otherwise


def structure(fields: Fields, number: int) -> Fields:
    """Return a field that is a structure, an empty one where it is missing or something else."""
    value = fields.get(number)
    return value if isinstance(value, dict) else {}


def structures(fields: Fields, number: int) -> list[Fields]:
    """Return a field that is a list of structures, an empty list where it is missing or something else."""
    value = fields.get(number)
    return value if isinstance(value, list) and all(isinstance(one, dict) for one in value) else []


class Compact:
    """Reads from bytes, of which `at` is the next.

    Raises IndexError where it goes on behind the end, ValueError where it is something else.
    """

    def __init__(self, raw: bytes) -> None:
        self.raw, self.at = raw, 0

    def struct(self, depth: int = 0) -> Fields:
        """Return a structure."""
        if depth > MAX_DEPTH:
            raise ValueError("structures too deep within each other")
        found: Fields = {}
        field = 0
        while head := self._byte():
            step, kind = head >> 4, head & 15
            field = field + step if step else self._integer()
            # A boolean is told by its kind.
            found[field] = int(kind == Type.TRUE) if kind in (Type.TRUE, Type.FALSE) else self._value(kind, depth)
        return found

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (Type.I16, Type.I32, Type.I64):
            return self._integer()
        if kind == Type.STRUCT:
            return self.struct(depth + 1)
        if kind == Type.BINARY:
            return self._bytes(self._varint())
        if kind in (Type.LIST, Type.SET):
            return self._list(depth + 1)
        if kind == Type.DOUBLE:
            self._bytes(8)
        elif kind in (Type.BYTE, Type.TRUE, Type.FALSE):
            self._byte()
        else:
            raise ValueError(f"there is no kind {kind}")
        return None

    def _list(self, depth: int) -> list[Any]:
        if depth > MAX_DEPTH:
            raise ValueError("lists too deep within each other")
        head = self._byte()
        count = self._varint() if head >> 4 == 15 else head >> 4
        return [self._value(head & 15, depth) for _ in range(count)]

    def _byte(self) -> int:
        self.at += 1
        return self.raw[self.at - 1]

    def _bytes(self, count: int) -> bytes:
        self.at += count
        if self.at > len(self.raw):
            raise IndexError
        return self.raw[self.at - count : self.at]

    def _varint(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
            if shift > 63:
                raise ValueError("no number of 64 bits")

    def _integer(self) -> int:
        value = self._varint()
        return (value >> 1) ^ -(value & 1)
