"""Topics as ROS messages: all messages of a topic have the same length, so NumPy fills them in at once."""

from __future__ import annotations

import heapq
import math
import struct
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from vsalog.core.recording import Stamps
from vsalog.readers.limits import BLOCK_ROWS
from vsalog.writers.recording_topics import FLOAT64, JOINT_FIELDS, JOINT_STATE, Topic

Bytes = NDArray[np.uint8]


@cache
def typestore(cdr: bool) -> Typestore:
    """Return the types of ROS 2, whose encoding is CDR, else those of ROS 1."""
    return get_typestore(Stores.ROS2_HUMBLE if cdr else Stores.ROS1_NOETIC)


def merged_messages(topics: Sequence[Topic], cdr: bool) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield (stamp [ns], index of the topic, count within the topic, message) of all topics, in the order of time.

    Parameters
    ----------
    topics : at equal stamps, the one that comes first here comes first
    cdr : ROS 2's encoding (CDR, little endian), else ROS 1's
    """
    yield from heapq.merge(*(_messages(i, topic, cdr) for i, topic in enumerate(topics)), key=lambda m: m[:2])


def _messages(index: int, topic: Topic, cdr: bool) -> Iterator[tuple[int, int, int, bytes]]:
    template = _Template(topic, cdr)
    for first in range(0, topic.stamps.shape[0], BLOCK_ROWS):
        stamps = topic.stamps[first : first + BLOCK_ROWS]
        rows = template.fill(topic, first, stamps)
        for i, stamp in enumerate(stamps.tolist()):
            yield stamp, index, first + i, rows[i].tobytes()


class _Template:
    """The bytes that all messages of a topic share, and where the numbers go."""

    def __init__(self, topic: Topic, cdr: bool) -> None:
        self._cdr = cdr
        # A field that no joint has stays empty; one that some have is NaN for the others.
        fields = [field for field in JOINT_FIELDS if any(f == field for f, _ in topic.columns)]
        keys = [*topic.columns] if topic.type == FLOAT64 else [*product(fields, topic.elements)]
        marks = {key: k + math.pi for k, key in enumerate(keys)}  # to find their places
        raw = bytearray(_serialised(topic, cdr, marks))
        self._values_at = {key: raw.index(struct.pack("<d", mark)) for key, mark in marks.items()}
        for at in self._values_at.values():
            struct.pack_into("<d", raw, at, np.nan)
        self._row = np.frombuffer(raw, np.uint8)

    def fill(self, topic: Topic, first: int, stamps: Stamps) -> Bytes:
        """Return messages as rows, shape (len(stamps), length), of the samples from `first` on."""
        count = stamps.shape[0]
        rows = np.tile(self._row, (count, 1))
        if topic.type == JOINT_STATE:
            if not self._cdr:
                _put(rows, 0, np.arange(first, first + count).astype("<u4"))
            # After ROS 1's sequence number, or the four bytes of ROS 2's encoding.
            _put(rows, 4, (stamps // 10**9).astype("<u4"))
            _put(rows, 8, (stamps % 10**9).astype("<u4"))
        for key, values in topic.columns.items():
            _put(rows, self._values_at[key], values[first : first + count].astype("<f8"))
        return rows


def _serialised(topic: Topic, cdr: bool, values: dict[tuple[str, str], float]) -> bytes:
    """Return a message with some values."""
    store = typestore(cdr)
    kinds = store.types
    if topic.type == FLOAT64:
        message = kinds[FLOAT64](*values.values())
    else:
        time = kinds["builtin_interfaces/msg/Time"](0, 0)
        header = kinds["std_msgs/msg/Header"](*(() if cdr else (0,)), time, "")
        numbers = (np.array([values[key] for key in values if key[0] == field]) for field in JOINT_FIELDS)
        message = kinds[JOINT_STATE](header, [*topic.elements], *numbers)
    return bytes((store.serialize_cdr if cdr else store.serialize_ros1)(message, topic.type))


def _put(rows: Bytes, at: int, values: NDArray[np.generic]) -> None:
    width = values.dtype.itemsize
    rows[:, at : at + width] = np.ascontiguousarray(values).view(np.uint8).reshape(-1, width)
