"""Messages that are trees of named parts, as those in JSON and protobuf are → columns of numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from vsalog.core.printable import LONGEST_TEXT, MAX_DEPTH, printable
from vsalog.readers.element_names import BAD_NAMES, ELEMENT_NAME, are_bad, best_label_field, labels_of, naming_texts
from vsalog.readers.fields import LARGE_MESSAGES, LONG_NAMES, MAX_FIELDS, Fields
from vsalog.readers.header_frames import stated_frames
from vsalog.readers.limits import DECODED_BYTES, MAX_ARRAY
from vsalog.readers.messages import Decoded
from vsalog.readers.packets import Messages
from vsalog.readers.reach import Nanoseconds, Stamp

STAMPS: tuple[tuple[str, ...], ...] = (("header", "stamp"), ("timestamp",), ("stamp",), ("header", "timestamp"))
"""Where a message may have its time, best first."""
FRAMES: tuple[tuple[str, ...], ...] = (("header", "frame_id"), ("frame_id",))
"""Where a message may name its frame, best first."""


@dataclass(frozen=True, slots=True)
class NoSignal:
    """What a part of a message is that is no signal, in words."""

    reason: str


class TreeDecoder(ABC):
    """Decodes such messages: every number in them is a channel, named by its path.

    Parts are numbers, texts, arrays of parts, structures or `NoSignal`; what is nothing of these is passed over.

    Parameters
    ----------
    prefix : str
        Name of the stream, ahead of every channel's name.
    wanted : collection of str or None
        Channels to decode; None is all of them.
    """

    misfit: tuple[str, str]
    stamped = framed = True

    def __init__(self, prefix: str, wanted: Collection[str] | None) -> None:
        self.prefix = prefix
        self._fields = Fields(prefix, wanted)
        self.unread = self._fields.unread
        self._left = 0  # parts of the message that may still be looked at
        # Fields of a message's clock and frame are no signals; which they are follows from where its clock is.
        self._told_by: dict[tuple[str, ...], set[str]] = {
            clock: {".".join((prefix, *path)) for path in (*FRAMES, clock) if path} for clock in ((), *STAMPS)
        }
        self._passed_over = self._told_by[()]

    @abstractmethod
    def _loaded(self, raw: bytes) -> Any:
        """Return the structure that a message is; None for what is no such message."""

    @abstractmethod
    def _members(self, part: Any) -> Iterable[tuple[str, Any]] | None:
        """Return the names and parts of a structure; None for another part."""

    @abstractmethod
    def _member(self, part: Any, name: str) -> Any:
        """Return the part of a structure that has a name; None where there is none."""

    @abstractmethod
    def _stamp(self, message: Any) -> tuple[tuple[str, ...], int | None]:
        """Return where a message has its time stamp, () for nowhere, and that [ns], None where it cannot be one."""

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages; what is no such message counts as damaged."""
        result = Decoded(good=np.zeros(len(messages), dtype=bool))
        for row, raw in enumerate(messages):
            if len(raw) > DECODED_BYTES:
                self._fields.leave(self.prefix, LARGE_MESSAGES)
            elif (message := self._loaded(raw)) is not None:
                result.good[row] = True
                self._message(message, row, result)
        return result

    def frames(self, messages: Messages) -> Messages:
        """Return ``header.frame_id``, or else ``frame_id``, of messages, as text; length -1 where they have none."""
        return stated_frames([self._frame(raw) if len(raw) <= DECODED_BYTES else None for raw in messages])

    def _frame(self, raw: bytes) -> object:
        """Return the frame that a message names, or something that is no text."""
        message = self._loaded(raw)
        for *outer, name in FRAMES if message is not None else ():
            part = self._at(message, outer)
            if self._members(part) is not None:
                return self._member(part, name)
        return None

    def _at(self, part: Any, path: Iterable[str]) -> Any:
        """Return the part of a structure at a path; None where there is none."""
        for name in path:
            part = None if self._members(part) is None else self._member(part, name)
        return part

    def _message(self, message: Any, row: int, result: Decoded) -> None:
        path, stamp = self._stamp(message)
        if stamp is not None:
            result.put_stamps(row, stamp)
        self._passed_over = self._told_by[path]
        found: dict[str, float] = {}
        self._left = 2 * MAX_FIELDS  # as many numbers as there may be, each in a structure of its own
        self._flatten(message, self.prefix, found, 0)
        if self._left <= 0:
            self._fields.leave(
                self.prefix, f"more than {2 * MAX_FIELDS} parts in a message; those beyond were left out"
            )
        for name, value in found.items():
            if self._fields.take(name):
                result.put(name, row, value)

    def _flatten(self, part: Any, path: str, found: dict[str, float], depth: int) -> None:
        """Collect the numbers in a part in `found`, by path."""
        self._left -= 1
        if isinstance(part, int | float):
            try:
                found[path] = float(part)
            except OverflowError:
                self._fields.leave(path, "integer beyond the range of numbers")
        elif isinstance(part, str):
            self._fields.leave(path, "text")
        elif isinstance(part, NoSignal):
            self._fields.leave(path, part.reason)
        elif depth >= MAX_DEPTH:
            self._fields.leave(path, f"nested more than {MAX_DEPTH} deep")
        elif (members := self._members(part)) is not None:
            self._structure(islice(members, max(self._left, 0)), path, found, depth)
        elif isinstance(part, Sequence):
            self._array(part, path, None, found, depth)

    def _structure(self, members: Iterator[tuple[str, Any]], path: str, found: dict[str, float], depth: int) -> None:
        known = list(members)
        parts = {name: part for name, part in known if len(name) <= LONGEST_TEXT}
        if len(parts) < len(known):
            self._fields.leave(path, LONG_NAMES)
        arrays = {name: part for name, part in parts.items() if _is_array(part)}
        texts = naming_texts((name, part) for name, part in arrays.items() if _is_texts(part))
        counts = {len(part) for name, part in arrays.items() if name not in texts} if texts else ()
        naming = {count: best_label_field(texts, count) for count in counts}
        for name, part in parts.items():
            if self._left <= 0:
                return
            here = f"{path}.{printable(name)}"
            if here in self._passed_over:
                continue
            if name not in arrays:
                self._flatten(part, here, found, depth + 1)
            elif name not in texts:
                key = naming.get(len(part))
                self._array(part, here, labels_of(texts[key]) if key else None, found, depth)
            elif are_bad(name, texts):
                self._fields.leave(here, BAD_NAMES)
            elif name not in naming.values():
                self._fields.leave(here, "text")

    def _array(
        self, parts: Sequence[Any], path: str, labels: list[str] | None, found: dict[str, float], depth: int
    ) -> None:
        self._left -= 1
        labels = labels or self._own_names(parts)
        if labels is None and len(parts) > MAX_ARRAY:
            self._fields.leave(path, f"array of {len(parts)} values")
            return
        for i, part in enumerate(parts):
            if self._left <= 0:
                return
            self._flatten(part, f"{path}[{labels[i] if labels else i}]", found, depth + 1)

    def _own_names(self, parts: Sequence[Any]) -> list[str] | None:
        """Return the names that elements have themselves, None where these do not tell them apart."""
        if len(parts) > MAX_FIELDS:
            return None
        names = [self._at(part, (ELEMENT_NAME,)) for part in parts]
        texts = [printable(name) for name in names if isinstance(name, str)]
        return (labels_of(texts) if len(texts) == len(names) else []) or None


def stamp_of(seconds: int, fraction: int) -> int:
    """Return a time stamp [ns] of seconds and nanoseconds, `Stamp.NEVER` where they are out of range."""
    stamp = seconds * Nanoseconds.SECOND + fraction
    return stamp if 0 <= fraction < Nanoseconds.SECOND and abs(stamp) < Stamp.FARTHEST else Stamp.NEVER


def _is_array(part: Any) -> bool:
    # The first question is the fast one.
    return not isinstance(part, float | int | str | dict | bytes) and isinstance(part, Sequence)


def _is_texts(array: Sequence[Any]) -> bool:
    """Tell whether an array is one of texts, short enough to name something."""
    return 0 < len(array) <= MAX_FIELDS and all(isinstance(text, str) for text in array)
