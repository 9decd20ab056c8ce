"""The frame in messages' headers: where two publishers share a channel, as two IMUs on one topic, it alone tells them apart."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from vsalog.core.compiled import compiled
from vsalog.core.printable import LONGEST_TEXT
from vsalog.readers.definitions import Scalar, Struct, Text, Time
from vsalog.readers.limits import MOST_PARTS
from vsalog.readers.packets import Bytes, Integers, Messages


class At(IntEnum):
    """Byte of a message at which a part of it begins (std_msgs/Header).

    Ahead of the stamp is a sequence number (ROS 1) or what tells the byte order (ROS 2).
    """

    FRAME = 4 + 8


def has_frame(root: Struct, cdr: bool) -> bool:
    """Tell whether messages of a type begin with a header that names a frame."""
    first = root.fields[0][1] if root.fields else None
    kinds = [type(node) for _, node in first.fields] if isinstance(first, Struct) else []
    return kinds == ([Time, Text] if cdr else [Scalar, Time, Text])


def header_frames(messages: Messages, cdr: bool) -> Messages:
    """Return the frames in headers that messages, of ROS 2's encoding or ROS 1's, begin with; length -1 where none is clear."""
    at, size = np.empty(len(messages), np.int64), np.empty(len(messages), np.int64)
    data = messages.data.view()
    data.flags.writeable = False  # always, so that the loops are compiled once
    _places(data, messages.start, messages.length, cdr, at, size)
    return Messages(data, at, size)


def stated_frames(frames: Sequence[object]) -> Messages:
    """Return frames as `header_frames` does; what is no text is none."""
    texts = [frame.encode("utf-8", "surrogatepass") if isinstance(frame, str) else None for frame in frames]
    joined = Messages.of([text or b"" for text in texts])
    length = np.where([text is None for text in texts], -1, joined.length)
    data = joined.data.view()
    data.flags.writeable = False
    return Messages(data, joined.start, length)


class Frames:
    """The frames met in a channel so far.

    Parameters
    ----------
    known : sequence of str
        Frames that come first, of another one's `names`.
    """

    def __init__(self, known: Sequence[str] = ()) -> None:
        self._pool, self._sizes, self._count = (
            np.zeros((1, LONGEST_TEXT), np.uint8),
            np.zeros(1, np.int64),
            len(known),
        )
        while self._count > len(self._sizes):
            self._grow()
        for k, name in enumerate(known):
            raw = np.frombuffer(name.encode("utf-8", "surrogateescape"), np.uint8)
            self._pool[k, : raw.size], self._sizes[k] = raw, raw.size

    @property
    def names(self) -> list[str]:
        """The frames, in the order in which they were met."""
        texts = (self._pool[k, : self._sizes[k]].tobytes() for k in range(self._count))
        return [text.decode("utf-8", "surrogateescape") for text in texts]

    def numbers(self, frames: Messages) -> Integers:
        """Return which frame each message has, shape (n,), of the texts of their frames; -1 where that is not clear."""
        found = np.full(len(frames), -1, np.int64)
        done = 0
        while True:
            done, self._count = _numbers(
                frames.data, frames.start, frames.length, self._pool, self._sizes, self._count, found, done
            )
            if done == found.size:
                return found
            self._grow()

    def _grow(self) -> None:
        more = 3 * len(self._sizes)
        self._pool = np.concatenate((self._pool, np.zeros((more, LONGEST_TEXT), np.uint8)))
        self._sizes = np.concatenate((self._sizes, np.zeros(more, np.int64)))


@compiled
def _places(data: Bytes, start: Integers, length: Integers, cdr: bool, place: Integers, sizes: Integers) -> None:
    """Write down where each message's frame begins and how long it is, -1 where that is not clear."""
    for k in range(start.size):
        at, place[k], sizes[k] = start[k] + At.FRAME, 0, -1
        if length[k] < At.FRAME + 4:
            continue
        size = 0
        for i in range(4):
            size = size * 256 + int(data[at + (i if cdr and data[start[k] + 1] == 0 else 3 - i)])
        at += 4
        if size > start[k] + length[k] - at:
            continue
        while size and data[at + size - 1] == 0:
            size -= 1
        place[k], sizes[k] = at, size


@compiled
def _numbers(
    data: Bytes, start: Integers, length: Integers, pool: Bytes, sizes: Integers, count: int, out: Integers, begin: int
) -> tuple[int, int]:
    """Write down which frame each message has, from one on; returns how far there was room for them, and how many are known."""
    for k in range(begin, start.size):
        at, size = start[k], length[k]
        if size < 0 or size > LONGEST_TEXT:
            continue
        for j in range(count):
            i = 0
            while sizes[j] == size and i < size and pool[j, i] == data[at + i]:
                i += 1
            if sizes[j] == size and i == size:
                out[k] = j
                break
        if out[k] >= 0 or count == MOST_PARTS:
            continue
        if count == sizes.size:
            return k, count
        for i in range(size):
            pool[count, i] = data[at + i]
        sizes[count], out[k] = size, count
        count += 1
    return start.size, count
