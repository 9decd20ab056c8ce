"""Serialised messages of one type → columns of numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.readers.definitions import Struct, Time
from vsalog.readers.layout import (
    MAX_FIELDS,
    Bytes,
    DamagedMessageError,
    Field,
    Integers,
    Layout,
    TooManyPartsError,
    column,
    doubles,
    learn,
    nanoseconds,
)
from vsalog.readers.packets import Messages
from vsalog.recording import Stamps, Values

MAX_LAYOUTS, MAX_NUMBERS = 64, 2**17
"""Shapes of one length, and numbers in all shapes, that are remembered per message type; beyond, messages of a new shape are
walked one by one."""


@dataclass(slots=True)
class Decoded:
    """The numbers of a batch of n messages.

    Attributes
    ----------
    good : bool array, shape (n,)
        Which messages could be decoded.
    stamps : int64 array, shape (n,), or None
        Header stamps [ns], 0 where a message has none; None where the type has none.
    columns : dict of str to float64 array, shape (n,)
        By channel name, NaN where a message has no such value.
    units : dict of str to str
        By channel name, where the message type implies one.
    """

    good: NDArray[np.bool_]
    stamps: Stamps | None = None
    columns: dict[str, Values] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)

    def put(self, row: int, numbers: Mapping[str, float], wanted: Collection[str] | None) -> bool:
        """Store the wanted ones of a message's numbers, by channel name; tells whether there was room for all."""
        room = True
        for name, value in numbers.items():
            if wanted is not None and name not in wanted:
                continue
            if name not in self.columns:
                if len(self.columns) >= MAX_FIELDS:
                    room = False
                    continue
                self.columns[name] = np.full(len(self.good), np.nan)
            self.columns[name][row] = value
        return room


class Decoder(Protocol):
    """Decodes the messages of one type.

    `unread` collects fields that are no signal, by full name, with the reason; `stamped` tells that messages may have a
    time stamp of their own.
    """

    unread: dict[str, str]
    stamped: bool

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages."""
        ...


@dataclass(frozen=True, slots=True)
class _Shape:
    """A layout, and what is wanted of it.

    Attributes
    ----------
    layout : Layout
        As learnt.
    fields : tuple of (str, Field, int)
        Channel, where it lies, and which of `doubles` it is, -1 for other types.
    doubles : int64 array
        Offsets of the numbers that need no conversion.
    """

    layout: Layout
    fields: tuple[tuple[str, Field, int], ...]
    doubles: Integers


class RosDecoder:
    """Decodes ROS messages, those of equal shape together.

    Parameters
    ----------
    root : Struct
        The definition of the message type.
    cdr : bool
        ROS 2's encoding, or ROS 1's.
    prefix : str
        Name of the stream, ahead of every channel's name.
    wanted : collection of str or None
        Channels to decode; None is all of them.
    remember : bool
        For tests: without, every message is walked on its own.
    """

    def __init__(
        self, root: Struct, cdr: bool, prefix: str, wanted: Collection[str] | None, remember: bool = True
    ) -> None:
        self.root = root
        self.cdr = cdr
        self.prefix = prefix
        self.wanted = wanted
        self.unread: dict[str, str] = {}
        self.stamped = _has_stamp(root)
        self._shapes: dict[int, list[_Shape]] = {}
        self._spare = MAX_NUMBERS if remember else 0
        self._patience = 3

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages."""
        result = Decoded(good=np.zeros(len(messages), dtype=bool))
        for rows in messages.by_length():
            self._decode_alike(messages.some(rows), rows, result)
        return result

    def _decode_alike(self, messages: Messages, rows: Integers, result: Decoded) -> None:
        """Decode messages of equal length; `rows` tells where they go in the result."""
        length, start = int(messages.length[0]), messages.start
        known = self._shapes.setdefault(length, [])
        for shape in known:
            start, rows = self._take_matching(shape, messages.data, start, rows, result)
        while len(rows):
            learnt = self._learn(messages.data[start[0] : start[0] + length].tobytes())
            if learnt is None:
                start, rows = start[1:], rows[1:]
            elif len(known) < MAX_LAYOUTS and self._spare > 0:
                self._spare -= 1 + len(learnt.layout.fields)
                known.append(learnt)
                start, rows = self._take_matching(learnt, messages.data, start, rows, result)
            else:
                self._store(learnt, messages.data, start[:1], rows[:1], result)
                start, rows = start[1:], rows[1:]

    def _learn(self, raw: bytes) -> _Shape | None:
        if not self._patience:
            return None
        try:
            layout = learn(raw, self.root, self.cdr)
        except TooManyPartsError:
            self._patience -= 1
            return None
        except DamagedMessageError:
            return None
        for path, reason in layout.unread.items():
            self.unread.setdefault(f"{self.prefix}.{path}", reason)
        fields: list[tuple[str, Field, int]] = []
        offsets: list[int] = []
        for one in layout.fields:
            name = f"{self.prefix}.{one.path}"
            if self.wanted is None or name in self.wanted:
                fields.append((name, one, len(offsets) if one.code == "<f8" else -1))
                if one.code == "<f8":
                    offsets.append(one.offset)
        return _Shape(layout, tuple(fields), np.array(offsets, dtype=np.int64))

    def _take_matching(
        self, shape: _Shape, data: Bytes, start: Integers, rows: Integers, result: Decoded
    ) -> tuple[Integers, Integers]:
        """Store the messages that have this shape; return where the others begin and go."""
        match = shape.layout.matches(data, start)
        if match.all():
            self._store(shape, data, start, rows, result)
            return start[:0], rows[:0]
        if match.any():
            self._store(shape, data, start[match], rows[match], result)
            return start[~match], rows[~match]
        return start, rows

    def _store(self, shape: _Shape, data: Bytes, start: Integers, rows: Integers, result: Decoded) -> None:
        count = len(result.good)
        result.good[rows] = True
        if shape.layout.stamp is not None:
            stamps = nanoseconds(data, start, shape.layout.stamp)
            if rows.size == count:
                result.stamps = stamps
            else:
                if result.stamps is None:
                    result.stamps = np.zeros(count, dtype=np.int64)
                result.stamps[rows] = stamps
        ready = doubles(data, start, shape.doubles)
        for name, one, number in shape.fields:
            if name not in result.columns:
                if len(result.columns) >= MAX_FIELDS:
                    self.unread.setdefault(self.prefix, f"more than {MAX_FIELDS} different fields")
                    continue
                if one.unit is not None:
                    result.units[name] = one.unit
                if rows.size < count:
                    result.columns[name] = np.full(count, np.nan)
            values = column(data, start, one) if number < 0 else ready[number]
            if rows.size == count:
                result.columns[name] = values
            else:
                result.columns[name][rows] = values


def _has_stamp(root: Struct) -> bool:
    fields = dict(root.fields)
    header = fields.get("header")
    inner = dict(header.fields) if isinstance(header, Struct) else {}
    return isinstance(fields.get("stamp"), Time) or isinstance(inner.get("stamp"), Time)
