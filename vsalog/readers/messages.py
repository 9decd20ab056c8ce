"""Serialised messages of one type → columns of numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.recording import Stamps, Values
from vsalog.core.spool import ABSENT
from vsalog.readers.definitions import Struct, Time
from vsalog.readers.fields import Fields
from vsalog.readers.frames import has_frame, header_frames
from vsalog.readers.irregular import IrregularDecoder
from vsalog.readers.layout import (
    Bytes,
    DamagedMessageError,
    EncodingError,
    Field,
    Integers,
    Layout,
    TooManyPartsError,
    learn,
)
from vsalog.readers.layout_values import column, doubles, stamps
from vsalog.readers.packets import Messages

MAX_LAYOUTS, MAX_NUMBERS = 64, 2**17
"""Shapes of one length, and numbers in all shapes, that are remembered per message type; beyond, messages of a new shape are
walked one by one."""

FEW, LONELY, MOST_MISSES = 32, 16, 1
"""A shape that so few messages of a batch have is not worth its while. After so many of these, messages that few others
resemble are walked one by one, and no more than so many others in a row are tried among the messages of one length."""


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
        By channel name, ABSENT where a message has no such value.
    units : dict of str to str
        By channel name, where the message type implies one.
    whole : bool
        Each message surely has every one of the columns.
    """

    good: NDArray[np.bool_]
    stamps: Stamps | None = None
    columns: dict[str, Values] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    whole: bool = False

    def put(self, row: int, numbers: Mapping[str, float], fields: Fields) -> None:
        """Store those of a message's numbers that become channels, by name."""
        for name, value in numbers.items():
            if not fields.take(name):
                continue
            if name not in self.columns:
                self.columns[name] = np.full(len(self.good), ABSENT)
            self.columns[name][row] = value


MISFIT = ("do not fit the definition in the log", "fits the definition in the log")


class Decoder(Protocol):
    """Decodes the messages of one type.

    `unread` collects fields that are no signal, by full name, with the reason; `stamped` tells that messages may have a
    time stamp of their own, `framed` that they may name a frame. `misfit` says of messages that cannot be
    decoded what they are not, and of one what it should be.
    """

    unread: dict[str, str]
    stamped: bool
    framed: bool

    @property
    def misfit(self) -> tuple[str, str]: ...  # noqa: D102

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages."""
        ...

    def frames(self, messages: Messages) -> Messages:
        """Return the frames that messages name, as text; length -1 where that is not clear."""
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
    one_by_one : bool
        For tests: every message is walked by compiled loops.
    """

    misfit = MISFIT

    def __init__(
        self,
        root: Struct,
        cdr: bool,
        prefix: str,
        wanted: Collection[str] | None,
        remember: bool = True,
        one_by_one: bool = False,
    ) -> None:
        self.root = root
        self.cdr = cdr
        self.prefix = prefix
        self.wanted = wanted
        self._fields = Fields(prefix, wanted)
        self.unread = self._fields.unread
        self.stamped, self.framed = _has_stamp(root), has_frame(root, cdr)
        self._shapes: dict[int, list[_Shape]] = {}
        self._spare = MAX_NUMBERS if remember else 0
        self._patience = 3
        self._lonely = LONELY if one_by_one else 0
        self._few = 2**62 if one_by_one else FEW
        self._remember = remember
        self._irregular: IrregularDecoder | None = None

    def frames(self, messages: Messages) -> Messages:
        """Return the frames in the headers of messages, which begin with one, as text; length -1 where that is not clear."""
        return header_frames(messages, self.cdr)

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages."""
        result = Decoded(good=np.zeros(len(messages), dtype=bool))
        left = []
        for rows in messages.by_length():
            unlike = rows.size < self._few and self._one_by_one()
            left.append(rows if unlike else self._decode_alike(messages.some(rows), rows, result))
        rest = np.sort(np.concatenate(left)) if left else np.arange(0)
        if rest.size:
            odd = self._decode_unlike(messages.some(rest), rest, result)
            for part in messages.some(odd).by_length():
                self._decode_alike(messages.some(odd[part]), odd[part], result, odd=True)
        return result

    def _one_by_one(self) -> bool:
        """Tell whether messages differ so much in shape that they are better walked one by one, by compiled loops."""
        if self._irregular is None and self._lonely >= LONELY and self._remember:
            self._irregular = IrregularDecoder(self.root, self.cdr, self._is_wanted)
            self._shapes.clear()  # those that are worth their while are soon learnt again
        return self._irregular is not None and self._irregular.able

    def _is_wanted(self, path: str) -> bool:
        return self.wanted is None or f"{self.prefix}.{path}" in self.wanted

    def _decode_unlike(self, messages: Messages, rows: Integers, result: Decoded) -> Integers:
        """Decode messages of any shapes; `rows` tells where they go in the result. Returns the rows of those that are odd."""
        assert self._irregular is not None
        for found in self._irregular.decode(messages):
            own = rows[found.rows]
            result.good[own] = True
            if found.stamps is not None:
                _put_stamps(found.stamps, own, result)
            for path, values in found.columns.items():
                name = f"{self.prefix}.{path}"
                if self._has_room(name, found.units.get(path), result):
                    _put(name, values, own, result)
        for path, reason in self._irregular.unread.items():
            self._fields.leave(f"{self.prefix}.{path}", reason)
        return rows[~result.good[rows]]

    def _decode_alike(self, messages: Messages, rows: Integers, result: Decoded, odd: bool = False) -> Integers:
        """Decode messages of equal length; `rows` tells where they go in the result.

        Returns the rows of those that are better walked one by one; none where they are `odd`.
        """
        length, start, data, misses = int(messages.length[0]), messages.start, messages.data, 0
        known = self._shapes.get(length, [])
        for shape in known:
            if len(rows):
                start, rows = self._take_matching(shape, data, start, rows, result)
        while len(rows):
            if misses > MOST_MISSES and not odd and self._one_by_one():
                return rows
            learnt = self._learn(data[start[0] : start[0] + length].tobytes())
            if learnt is None:
                start, rows, misses = start[1:], rows[1:], misses + 1
                continue
            if len(known) >= MAX_LAYOUTS or self._spare <= 0:
                self._store(learnt, data, start[:1], rows[:1], result)
                start, rows, misses = start[1:], rows[1:], misses + 1
                continue
            before = len(rows)
            start, rows = self._take_matching(learnt, data, start, rows, result)
            lonely = before - len(rows) < self._few
            self._lonely += lonely
            misses += lonely
            if not lonely or not self._one_by_one():
                self._spare -= 1 + len(learnt.layout.fields)
                known = self._shapes.setdefault(length, [])
                known.append(learnt)
        return rows

    def _learn(self, raw: bytes) -> _Shape | None:
        if not self._patience:
            return None
        try:
            layout = learn(raw, self.root, self.cdr)
        except TooManyPartsError:
            self._patience -= 1
            return None
        except EncodingError as error:
            self._fields.leave(self.prefix, str(error))
            return None
        except DamagedMessageError:
            return None
        for path, reason in layout.unread.items():
            self._fields.leave(f"{self.prefix}.{path}", reason)
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
        result.good[rows] = True
        result.whole = rows.size == len(result.good)
        if shape.layout.stamp is not None:
            _put_stamps(stamps(data, start, shape.layout.stamp), rows, result)
        ready = doubles(data, start, shape.doubles)
        for name, one, number in shape.fields:
            if self._has_room(name, one.unit, result):
                _put(name, column(data, start, one) if number < 0 else ready[number], rows, result)

    def _has_room(self, name: str, unit: str | None, result: Decoded) -> bool:
        """Tell whether a column can be in the result, and keep its unit; that there are too many is noted."""
        if not self._fields.take(name):
            return False
        if unit is not None:
            result.units[name] = unit
        return True


def _put(name: str, values: Values, rows: Integers, result: Decoded) -> None:
    """Put some messages' numbers into a column of the result."""
    if rows.size == len(result.good):
        result.columns[name] = values
        return
    if name not in result.columns:
        result.columns[name] = np.full(len(result.good), ABSENT)
    result.columns[name][rows] = values


def _put_stamps(stamps: Stamps, rows: Integers, result: Decoded) -> None:
    if rows.size == len(result.good):
        result.stamps = stamps
        return
    if result.stamps is None:
        result.stamps = np.zeros(len(result.good), dtype=np.int64)
    result.stamps[rows] = stamps


def _has_stamp(root: Struct) -> bool:
    fields = dict(root.fields)
    header = fields.get("header")
    inner = dict(header.fields) if isinstance(header, Struct) else {}
    return isinstance(fields.get("stamp"), Time) or isinstance(inner.get("stamp"), Time)
