"""The parts of a variable in a MATLAB v5 file → arrays, structures and cells.

Not by scipy, whose compiled reader believes the lengths and types that stand in a file: a damaged one ends the process. Here
every length is held against what is there, and nothing is read that could be no signal.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from enum import IntEnum
from math import prod
from typing import Any

import numpy as np

from vsalog.readers.limits import MAX_ARRAY, MAX_DEPTH


class Class(IntEnum):
    """Classes of arrays (MAT-File Format, Table 1-3); those from DOUBLE on are numbers."""

    CELL, STRUCT, OBJECT, CHAR, SPARSE, DOUBLE = range(1, 7)
    UINT64 = 15


class DataType(IntEnum):
    """Types of data elements (MAT-File Format, Table 1-1)."""

    INT32 = 5
    MATRIX, COMPRESSED = 14, 15


class Flag(IntEnum):
    """Of an array (MAT-File Format, Figure 1-3)."""

    COMPLEX = 0x0800


_NUMBERS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip


def variable(data: memoryview, order: str) -> tuple[str, Any]:
    """Return name and value of a matrix element's content.

    Parameters
    ----------
    data : bytes
        Behind the element's tag.
    order : str
        ``<`` or ``>``: which byte of a number comes first.

    Returns
    -------
    str
        The name.
    array, dict, list, str, ValueError or None
        Numbers; a structure; a cell array or an array of structures, of which the first elements; a text, which is left empty;
        within a structure or cell array what is damaged, the last one there is where it is cut off; what is none of these.

    Raises
    ------
    ValueError
        What is told of the parts does not fit together.
    """
    return _matrix(data, order, 0)


def _matrix(data: memoryview, order: str, depth: int) -> tuple[str, Any]:
    if depth > MAX_DEPTH:
        raise ValueError("it is nested too deeply")
    if not data:
        return "", np.zeros((0, 0))
    parts = _parts(data, order)
    flags, kind = _flags(parts, order)
    if not (kind in (Class.CELL, Class.STRUCT, Class.CHAR) or Class.DOUBLE <= kind <= Class.UINT64):
        return _name_of_other(parts), None
    shape = tuple(_numbers(*_next(parts), order, DataType.INT32).tolist())
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError("its dimensions are none")
    name = _text(_next(parts)[1])
    if kind == Class.CHAR:
        return name, ""
    if kind == Class.CELL:
        return name, list(_inner_ones(parts, order, depth, min(prod(shape), MAX_ARRAY)))
    if kind == Class.STRUCT:
        return name, _structures(parts, order, depth, prod(shape))
    values = _numbers(*_next(parts), order)
    if flags & Flag.COMPLEX:
        values = values + 1j * _numbers(*_next(parts), order)
    if values.size != prod(shape):
        raise ValueError(f"it holds {values.size} values where {prod(shape)} are announced")
    return name, values.reshape(shape, order="F")


def _structures(parts: Iterator[tuple[int, memoryview]], order: str, depth: int, count: int) -> Any:
    """Return a structure, or the first structures of an array."""
    (width,) = _numbers(*_next(parts), order, DataType.INT32).tolist()
    names = bytes(_next(parts)[1])
    if width < 1 or len(names) % width:
        raise ValueError("the names of its fields are damaged")
    keys = [_text(names[i : i + width]) for i in range(0, len(names), width)]
    if len(set(keys)) < len(keys):
        raise ValueError("two of its fields have one name")
    values = list(_inner_ones(parts, order, depth, len(keys) * min(count, MAX_ARRAY)))
    if count == 1:
        return dict(zip(keys, values, strict=False))
    return [dict(zip(keys, values[i:], strict=False)) for i in range(0, len(values), len(keys) or 1)]


def _inner_ones(parts: Iterator[tuple[int, memoryview]], order: str, depth: int, count: int) -> Iterator[Any]:
    """Yield so many fields or cells; the last one says why where the others are missing.

    Raises
    ------
    ValueError
        There are none, or something else is there.
    """
    for number in range(count):
        try:
            kind, content = _next(parts)
        except ValueError as error:
            if not number:
                raise
            yield error  # cut off: what is ahead is whole
            return
        if kind != DataType.MATRIX:
            raise ValueError(f"it holds an element of type {kind} where an array should be")
        try:
            yield _matrix(content, order, depth + 1)[1]
        except ValueError as error:  # it takes none of its neighbours along
            yield error


def _flags(parts: Iterator[tuple[int, memoryview]], order: str) -> tuple[int, int]:
    """Return an array's flags and its class."""
    _, content = _next(parts)
    if len(content) != 8:
        raise ValueError("it does not say what kind of array it is")
    (word,) = struct.unpack_from(order + "I", content)
    return int(word), int(word) & 0xFF


def _name_of_other(parts: Iterator[tuple[int, memoryview]]) -> str:
    """Return the name of an object, a function or a sparse array; those of classes have it first."""
    kind, content = _next(parts)
    return _text(content) if kind == 1 else _text(_next(parts)[1])


def _numbers(kind: int, content: memoryview, order: str, wanted: int | None = None) -> np.ndarray[Any, Any]:
    """Return an element's numbers."""
    if kind not in _NUMBERS or (wanted is not None and kind not in (wanted, wanted + 1)):  # some write unsigned ones
        raise ValueError(f"it holds an element of type {kind} where numbers should be")
    dtype = np.dtype(order + _NUMBERS[kind])
    if len(content) % dtype.itemsize:
        raise ValueError("its lengths contradict one another")
    return np.frombuffer(content, dtype)


def _text(raw: bytes | memoryview) -> str:
    return bytes(raw).partition(b"\0")[0].decode("utf-8", "replace")


def _next(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    part = next(parts, None)
    if part is None:
        raise ValueError("a part of it is missing")
    return part


def _parts(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of the elements that lie one behind the other.

    Raises
    ------
    ValueError
        One is longer than what is left.
    """
    at, tag = 0, struct.Struct(order + "II")
    while at + tag.size <= len(data):
        kind, length = tag.unpack_from(data, at)
        if kind >> 16:  # up to four bytes lie in the tag itself
            kind, length, begin = kind & 0xFFFF, kind >> 16, at + 4
            if length > 4:
                raise ValueError("its lengths contradict one another")
            following = at + tag.size
        else:
            begin = at + tag.size
            following = begin + -(-length // 8) * 8
        if begin + length > len(data):
            raise ValueError("its lengths contradict one another")
        yield kind, data[begin : begin + length]
        at = following
