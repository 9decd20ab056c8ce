"""Messages that are read one by one, as in JSON and protobuf → columns of numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from vsalog.readers.fields import LARGE_MESSAGES, Fields
from vsalog.readers.header_frames import stated_frames
from vsalog.readers.limits import DECODED_BYTES
from vsalog.readers.messages import Decoded
from vsalog.readers.nested import FRAMES, STAMPS, Numbers, part_at
from vsalog.readers.packets import Messages
from vsalog.readers.reach import Nanoseconds, Stamp


class TreeDecoder(ABC):
    """Decodes messages that are nested values; see `vsalog.readers.nested`.

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
        # Fields of a message's clock and frame are no signals; which they are follows from where its clock is.
        self._passed_over: dict[tuple[str, ...], set[str]] = {
            clock: {".".join((prefix, *path)) for path in (*FRAMES, clock) if path} for clock in ((), *STAMPS)
        }

    @abstractmethod
    def _loaded(self, raw: bytes) -> Mapping[str, Any] | None:
        """Return a message's structure; None for an invalid message."""

    @abstractmethod
    def _stamp(self, message: Mapping[str, Any]) -> tuple[tuple[str, ...], int | None]:
        """Return the path of a message's time stamp, () for none, and the stamp [ns], None where it is invalid."""

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
        for *outer, name in FRAMES:
            part = part_at(message, outer)
            if isinstance(part, Mapping):
                return part.get(name)
        return None

    def _message(self, message: Mapping[str, Any], row: int, result: Decoded) -> None:
        path, stamp = self._stamp(message)
        if stamp is not None:
            result.put_stamps(row, stamp)
        for name, number in Numbers(message, self._fields, self._passed_over[path]).found.items():
            try:
                value = float(number)
            except OverflowError:
                self._fields.leave(name, "integer beyond the range of numbers")
                continue
            if self._fields.take(name):
                result.put(name, row, value)


def stamp_of(seconds: int, fraction: int) -> int:
    """Return a time stamp [ns] of seconds and nanoseconds, `Stamp.NEVER` where they are out of range."""
    stamp = seconds * Nanoseconds.SECOND + fraction
    return stamp if 0 <= fraction < Nanoseconds.SECOND and abs(stamp) < Stamp.FARTHEST else Stamp.NEVER
