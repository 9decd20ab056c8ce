"""The frame in messages' headers: where two publishers share a channel, as two IMUs on one topic, it alone tells them apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from vsalog.readers.definitions import Scalar, Struct, Text, Time
from vsalog.readers.packets import Bytes, Integers, Messages

MOST, LONGEST = 16, 256
"""Frames of a channel that are told apart, and bytes of one; more are a counter."""

_AT = (
    12  # behind the time stamp, and what is ahead of it: a sequence number in ROS 1, what tells the byte order in ROS 2
)


def has_frame(root: Struct, cdr: bool) -> bool:
    """Tell whether messages of a type begin with a header that names a frame."""
    first = root.fields[0][1] if root.fields else None
    kinds = [type(node) for _, node in first.fields] if isinstance(first, Struct) else []
    return kinds == ([Time, Text] if cdr else [Scalar, Time, Text])


class Frames:
    """The frames met in a channel so far.

    Parameters
    ----------
    known : sequence of str
        Frames that come first, of another one's `names`.
    """

    def __init__(self, known: Sequence[str] = ()) -> None:
        self._pool, self._sizes, self._count = np.zeros((MOST, LONGEST), np.uint8), np.zeros(MOST, np.int64), len(known)
        for k, name in enumerate(known):
            raw = np.frombuffer(name.encode("utf-8", "surrogateescape"), np.uint8)
            self._pool[k, : raw.size], self._sizes[k] = raw, raw.size

    @property
    def names(self) -> list[str]:
        """The frames, in the order in which they were met."""
        texts = (self._pool[k, : self._sizes[k]].tobytes() for k in range(self._count))
        return [text.decode("utf-8", "surrogateescape") for text in texts]

    def numbers(self, messages: Messages, cdr: bool) -> Integers:
        """Return which frame each message, of ROS 2's encoding or ROS 1's, has, shape (n,); -1 where that is not clear."""
        found = np.empty(len(messages), np.int64)
        data = messages.data.view()
        data.flags.writeable = False  # always, so that the loop is compiled once
        self._count = int(
            _numbers(data, messages.start, messages.length, cdr, self._pool, self._sizes, self._count, found)
        )
        return found


@njit(cache=True, nogil=True)
def _numbers(
    data: Bytes, start: Integers, length: Integers, cdr: bool, pool: Bytes, sizes: Integers, count: int, out: Integers
) -> int:
    """Write down which frame each message has; returns how many are known then."""
    for k in range(start.size):
        at, out[k] = start[k] + _AT, -1
        if length[k] < _AT + 4:
            continue
        size = 0
        for i in range(4):
            size = size * 256 + int(data[at + (i if cdr and data[start[k] + 1] == 0 else 3 - i)])
        at += 4
        if size > start[k] + length[k] - at:
            continue
        while size and data[at + size - 1] == 0:
            size -= 1
        if size > LONGEST:
            continue
        for j in range(count):
            same = sizes[j] == size
            for i in range(size):
                same = same and pool[j, i] == data[at + i]
            if same:
                out[k] = j
                break
        if out[k] < 0 and count < sizes.size:
            pool[count, :size] = data[at : at + size]
            sizes[count], out[k] = size, count
            count += 1
    return count
