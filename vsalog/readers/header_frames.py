"""The frame in messages' headers: it alone distinguishes two publishers that share a channel, as two IMUs on one topic."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from vsalog.core.printable import LONGEST_TEXT
from vsalog.readers.limits import MOST_PARTS
from vsalog.readers.message_definitions import Scalar, Struct, Text, Time
from vsalog.readers.packets import Bytes, Integers, Messages


class At(IntEnum):
    """Byte of a message at which a part of it begins (std_msgs/Header).

    Before the stamp is a sequence number (ROS 1) or the encapsulation header with the byte order (ROS 2).
    """

    FRAME = 4 + 8


def has_frame(root: Struct, cdr: bool) -> bool:
    """Return whether messages of a type begin with a header that names a frame."""
    first = root.fields[0][1] if root.fields else None
    kinds = [type(node) for _, node in first.fields] if isinstance(first, Struct) else []
    return kinds == ([Time, Text] if cdr else [Scalar, Time, Text])


def header_frames(messages: Messages, cdr: bool) -> Messages:
    """Return the frames in headers that messages, of ROS 2's encoding or ROS 1's, begin with; length -1 where none is clear."""
    place, length = messages.start + (At.FRAME + 4), np.full(len(messages), -1, np.int64)
    rows = np.flatnonzero(messages.length >= At.FRAME + 4)
    number = messages.data[place[rows, None] - np.arange(4, 0, -1)]
    size = number.view("<u4")[:, 0].astype(np.int64)
    if cdr and (big_endian := messages.data[messages.start[rows] + 1] == 0).any():
        size[big_endian] = number.view(">u4")[big_endian, 0]
    fits = size <= messages.start[rows] + messages.length[rows] - place[rows]
    rows, size = rows[fits], size[fits]
    some = np.flatnonzero(size)
    size[some] -= messages.data[place[rows[some]] + size[some] - 1] == 0  # the zero at the end of a text in ROS 2
    length[rows] = size
    return Messages(messages.data, place, length)


def stated_frames(frames: Sequence[object]) -> Messages:
    """Return frames as `header_frames` does; bytes that are no text are none."""
    texts = [frame.encode("utf-8", "surrogatepass") if isinstance(frame, str) else None for frame in frames]
    joined = Messages.of([text or b"" for text in texts])
    return Messages(joined.data, joined.start, np.where([text is None for text in texts], -1, joined.length))


class Frames:
    """The frames found in a channel so far.

    Parameters
    ----------
    known : sequence of str
        Frames that come first, of another one's `names`.
    """

    def __init__(self, known: Sequence[str] = ()) -> None:
        self._known = {name.encode("utf-8", "surrogateescape"): k for k, name in enumerate(known)}

    @property
    def names(self) -> list[str]:
        """The frames, by their numbers."""
        return [text.decode("utf-8", "surrogateescape") for text in self._known]

    def numbers(self, frames: Messages) -> Integers:
        """Return which frame each message has, shape (n,), of the texts of their frames; -1 where that is not clear."""
        found = np.full(len(frames), -1, np.int64)
        for rows in frames.by_length():
            size = int(frames.length[rows[0]])
            if 0 <= size <= LONGEST_TEXT:
                texts = frames.data[frames.start[rows, None] + np.arange(size)]
                found[rows] = self._number(texts[0]) if (texts == texts[0]).all() else self._several(texts)
        return found

    def _several(self, texts: Bytes) -> Integers:
        """Return the numbers of texts, shape (n, size), of one length."""
        different, which = np.unique(texts, axis=0, return_inverse=True)
        return np.array([self._number(text) for text in different])[which.ravel()]

    def _number(self, text: Bytes) -> int:
        raw = text.tobytes()
        if raw not in self._known and len(self._known) < MOST_PARTS:
            self._known[raw] = len(self._known)
        return self._known.get(raw, -1)
