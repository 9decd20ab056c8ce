"""Topics as ROS messages: all messages of a topic have the same length, so NumPy fills them in at once."""

from __future__ import annotations

import heapq
import struct
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.core.recording import Stamps, Values
from vsalog.readers.limits import BLOCK_ROWS
from vsalog.writers.recording_topics import FLOAT64, JOINT_FIELDS, JOINT_STATE, Topic

Bytes = NDArray[np.uint8]


_RULE = "=" * 80

# As rosbag2 writes them: the message first, then the definitions it needs.
ROS2_DEFINITIONS = {
    JOINT_STATE: f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""",
    FLOAT64: "float64 data\n",
}


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
    """The bytes that all messages of a topic share, and where the numbers go.

    CDR aligns a value to its size, counted from behind the four bytes that tell the encoding; ROS 1 packs without gaps.
    A text's length counts its closing NUL in CDR, which ROS 1 does not have.
    """

    def __init__(self, topic: Topic, cdr: bool) -> None:
        self._cdr = cdr
        self._raw = bytearray(b"\x00\x01\x00\x00" if cdr else b"")
        self._sequence_at = self._stamp_at = -1
        self._values_at: dict[tuple[str, str], int] = {}
        if topic.type == FLOAT64:
            self._values_at["data", ""] = self._number()
            return
        if not cdr:
            self._sequence_at = self._word(0)
        self._stamp_at = self._word(0)
        self._word(0)
        self._text("")
        self._word(len(topic.elements))
        for element in topic.elements:
            self._text(element)
        for field in JOINT_FIELDS:
            # A field that no joint has stays empty; one that some have is NaN for the others.
            present = any(f == field for f, _ in topic.columns)
            self._word(len(topic.elements) if present else 0)
            if present:
                for element in topic.elements:
                    self._values_at[field, element] = self._number()

    def fill(self, topic: Topic, first: int, stamps: Stamps) -> Bytes:
        """Return messages as rows, shape (len(stamps), length), of the samples from `first` on."""
        count = stamps.shape[0]
        rows = np.tile(np.frombuffer(bytes(self._raw), np.uint8), (count, 1))
        if self._sequence_at >= 0:
            _put(rows, self._sequence_at, np.arange(first, first + count).astype("<u4"))
        if self._stamp_at >= 0:
            _put(rows, self._stamp_at, (stamps // 10**9).astype("<u4"))
            _put(rows, self._stamp_at + 4, (stamps % 10**9).astype("<u4"))
        for key, at in self._values_at.items():
            if key in topic.columns:
                values: Values = topic.columns[key][first : first + count]
                _put(rows, at, values.astype("<f8"))
        return rows

    def _align(self, size: int) -> None:
        if self._cdr:
            self._raw += bytes(-(len(self._raw) - 4) % size)

    def _word(self, value: int) -> int:
        self._align(4)
        self._raw += struct.pack("<I", value)
        return len(self._raw) - 4

    def _number(self) -> int:
        self._align(8)
        self._raw += struct.pack("<d", np.nan)
        return len(self._raw) - 8

    def _text(self, text: str) -> None:
        raw = text.encode() + (b"\0" if self._cdr else b"")
        self._word(len(raw))
        self._raw += raw


def _put(rows: Bytes, at: int, values: NDArray[np.generic]) -> None:
    width = values.dtype.itemsize
    rows[:, at : at + width] = np.ascontiguousarray(values).view(np.uint8).reshape(-1, width)
