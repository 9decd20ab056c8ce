"""Serialised messages of one type → columns of numbers."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import ABSENT
from vsalog.core.recording import Stamps, Values
from vsalog.readers.fields import Fields
from vsalog.readers.header_frames import has_frame, header_frames
from vsalog.readers.limits import MOST_PARTS, MOST_STEPS
from vsalog.readers.message_definitions import Struct, Time
from vsalog.readers.message_layout import (
    Bytes,
    DamagedMessageError,
    EncodingError,
    Integers,
    Layout,
    PlacedText,
    TooManyPartsError,
    places_in,
)
from vsalog.readers.message_values import stamps, values
from vsalog.readers.nested import FRAMES, STAMPS, Numbers, Place, part_at
from vsalog.readers.packets import Messages


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

    def put(self, name: str, rows: Integers | slice | int, numbers: Values | float) -> None:
        """Put numbers of some messages, or of one, into a column."""
        if name not in self.columns:
            self.columns[name] = np.full(len(self.good), ABSENT)
        self.columns[name][rows] = numbers

    def put_stamps(self, rows: Integers | slice | int, stamps: Stamps | int) -> None:
        """Put header stamps [ns] of some messages, or of one, in place."""
        if self.stamps is None:
            self.stamps = np.zeros(len(self.good), dtype=np.int64)
        self.stamps[rows] = stamps


MISFIT = ("do not fit the definition in the log", "fits the definition in the log")


class Decoder(Protocol):
    """Decodes the messages of one type.

    `unread` collects fields that are no signal, by full name, with the reason; `stamped` is whether messages may have a
    time stamp of their own, `framed` whether they may name a frame. `misfit` describes messages that cannot be
    decoded, and one that can.
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

    misfit = MISFIT

    def __init__(
        self,
        root: Struct,
        cdr: bool,
        prefix: str,
        wanted: Collection[str] | None,
        remember: bool = True,
    ) -> None:
        self.root = root
        self.cdr = cdr
        self.prefix = prefix
        self.wanted = wanted
        self._fields = Fields(prefix, wanted)
        self.unread = self._fields.unread
        self.stamped, self.framed = _has_stamp(root), has_frame(root, cdr)
        self._layouts: dict[int, list[Layout]] = {}
        self._spare = MOST_STEPS if remember else 0
        self._patience = 3

    def frames(self, messages: Messages) -> Messages:
        """Return the frames in the headers of messages, which begin with one, as text; length -1 where that is not clear."""
        return header_frames(messages, self.cdr)

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages."""
        result = Decoded(good=np.zeros(len(messages), dtype=bool))
        for rows in messages.by_length():
            self._decode_alike(messages.some(rows), rows, result)
        return result

    def _decode_alike(self, messages: Messages, rows: Integers, result: Decoded) -> None:
        """Decode messages of equal length; `rows` are their places in the result."""
        length, start, data = int(messages.length[0]), messages.start, messages.data
        known = self._layouts.setdefault(length, [])
        for layout in known:
            if len(rows):
                start, rows = self._take_matching(layout, data, start, rows, result)
        while len(rows):
            new = self._learn(data[start[0] : start[0] + length].tobytes())
            if new is not None and len(known) < MOST_PARTS and self._spare > 0:
                self._spare -= 1 + len(new.names)
                known.append(new)
                start, rows = self._take_matching(new, data, start, rows, result)
                continue
            if new is not None:
                self._store(new, data, start[:1], rows[:1], result)
            start, rows = start[1:], rows[1:]

    def _learn(self, raw: bytes) -> Layout | None:
        if not self._patience:
            return None
        try:
            message, guards = places_in(raw, self.root, self.cdr)
        except TooManyPartsError:
            self._patience -= 1
            return None
        except EncodingError as error:
            self._fields.leave(self.prefix, str(error))
            return None
        except DamagedMessageError:
            return None
        clocks = {path: place for path in STAMPS if isinstance(place := part_at(message, path), Place)}
        stamp = next((path for path, place in clocks.items() if path[-1] == "stamp" and "," in place.code), ())
        frames = [path for path in FRAMES if isinstance(part_at(message, path), str)]
        numbers = Numbers(message, self._fields, {".".join((self.prefix, *path)) for path in (stamp, *frames) if path})
        guards += [text.bytes for text in numbers.names if isinstance(text, PlacedText)]
        found = {name: one for name, one in numbers.found.items() if self.wanted is None or name in self.wanted}
        return Layout.of(raw, guards, clocks.get(stamp), found)

    def _take_matching(
        self, layout: Layout, data: Bytes, start: Integers, rows: Integers, result: Decoded
    ) -> tuple[Integers, Integers]:
        """Store the messages that have this shape; return where the others begin and go."""
        match = layout.matches(data, start)
        if match.all():
            self._store(layout, data, start, rows, result)
            return start[:0], rows[:0]
        if match.any():
            self._store(layout, data, start[match], rows[match], result)
            return start[~match], rows[~match]
        return start, rows

    def _store(self, layout: Layout, data: Bytes, start: Integers, rows: Integers, result: Decoded) -> None:
        result.good[rows] = True
        result.whole = rows.size == len(result.good)
        # Much the faster way to put one.
        some = slice(int(rows[0]), int(rows[0]) + 1) if rows.size == 1 else rows
        if layout.stamp is not None:
            result.put_stamps(some, stamps(data, start, layout.stamp))
        columns: dict[int, Values] = {}
        for code, (which, offsets) in layout.places.items():
            columns |= zip(which, values(data, start, offsets, code), strict=True)
        for k, (name, unit) in enumerate(layout.names):
            if not self._fields.take(name):
                continue
            if unit is not None:
                result.units[name] = unit
            if result.whole:
                result.columns[name] = columns[k]
            else:
                result.put(name, some, columns[k])


def _has_stamp(root: Struct) -> bool:
    fields = dict(root.fields)
    header = fields.get("header")
    inner = dict(header.fields) if isinstance(header, Struct) else {}
    return isinstance(fields.get("stamp"), Time) or isinstance(inner.get("stamp"), Time)
