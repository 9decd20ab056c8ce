"""Compares a ROS 1 bag's index with the messages that were found."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from rosbags.rosbag1.reader import RecordType

from vsalog.core.errors import ReadError
from vsalog.core.finding import Evidence, Finding
from vsalog.readers.container import Chunk, Part
from vsalog.readers.packets import Integers, Packet
from vsalog.readers.record_walk import Damage, Header
from vsalog.readers.rosbag1_walk import number, op

_TIME = _COUNT = struct.Struct("<II")


class IndexCheck:
    """Counts the messages of the index that the walk has not found, and log times that differ.

    Parameters
    ----------
    wanted : int64 array, sorted
        Connections that are read.
    part : Part or None
        Of the log that is read, without chunks that are outside of it by the index.
    whole : bool
        All of the log is read.
    """

    def __init__(self, wanted: Integers, part: Part | None, whole: bool) -> None:
        self._wanted, self._part, self._whole = wanted, part, whole
        self._last: Packet | None = None
        self._found = self._expected = self._differing = self._damaged = 0
        self._told: dict[int, int] = {}
        self._announced = 0

    def announced(self, header: Header) -> None:
        """Record how many chunks the bag's header counts, if it does."""
        self._announced = number(header, b"chunk_count") if len(header.get(b"chunk_count", b"")) == 4 else 0

    def chunk(self, packet: Packet) -> None:
        """Record the messages found in a chunk; its index follows."""
        self._last = packet
        self._found += len(packet.messages)

    def damaged(self, damage: Sequence[Damage]) -> None:
        """Record the chunks that could not be read so far: the index of the last is not of what was found."""
        if len(damage) > self._damaged:
            self._last, self._damaged = None, len(damage)

    def record(self, header: Header, data: bytes) -> None:
        """Record a record of the index."""
        if op(header) == RecordType.IDXDATA and self._last is not None:
            connection = number(header, b"conn")
            if connection in self._wanted:
                own = self._last.log[self._last.connection == connection]
                self._differing += _differing(own, _times(data))
        elif op(header) == RecordType.CHUNK_INFO:
            count = np.frombuffer(data, "<u4").reshape(-1, 2).astype(np.int64)
            position = int.from_bytes(header[b"chunk_pos"], "little")
            self._told[position] = int(count[np.isin(count[:, 0], self._wanted), 1].sum())
            self._expected += self._told[position]

    def passed(self, header: Header, data: bytes) -> None:
        """Record a record of the index of a chunk that was passed by.

        Raises
        ------
        ReadError
            A message that is not to be passed by is in it.
        """
        if op(header) != RecordType.IDXDATA or self._part is None:
            return
        connection, times = number(header, b"conn"), _times(data)
        own = Chunk(int(times.min()), int(times.max()), frozenset([connection])) if times.size else None
        if own is not None and connection in self._wanted and not self._part.leaves_out(own):
            raise ReadError("the bag's index contradicts itself")

    def findings(self, damage: Sequence[Damage], chunks: int) -> list[Finding]:
        """Return what is missing and what differs; `chunks` is their number, `damage` the faults of some."""
        lost = sum(max(self._told.get(one.position, 0) - one.read, 0) for one in damage)
        found = []
        if damage:
            told = all(one.position in self._told for one in damage)
            lost_ones = Finding(code="recording.messages_lost", value=lost)
            found.append(lost_ones if told else Finding(code="recording.loss_unknown"))
        missing = self._expected - self._found - lost
        if missing > 0 and self._whole:
            counted: Evidence = {"expected": self._expected, "counted_by": "index"}
            found.append(Finding(code="recording.messages_missing", value=missing, evidence=counted))
        elif chunks < self._announced and self._whole and not damage:
            gone: Evidence = {"chunks": self._announced}
            found.append(Finding(code="recording.chunks_missing", value=self._announced - chunks, evidence=gone))
        if self._differing:
            found.append(Finding(code="recording.index_times_differ", value=self._differing))
        return found


def chunk_told(header: Header, data: bytes) -> tuple[int, Chunk] | None:
    """Return the position of the chunk of an index record, and its data; None where the record is invalid."""
    times = [header.get(name, b"") for name in (b"start_time", b"end_time")]
    if any(len(time) != 8 for time in times):
        return None
    first, last = (seconds * 1_000_000_000 + fraction for seconds, fraction in map(_TIME.unpack, times))
    position = int.from_bytes(header[b"chunk_pos"], "little")
    connections = frozenset(connection for connection, count in _COUNT.iter_unpack(data) if count)
    return (position, Chunk(first, last, connections)) if 0 < first <= last else None


def _times(data: bytes) -> Integers:
    """Return the log times [ns] in a chunk's index of one connection."""
    words = np.frombuffer(data, "<u4").reshape(-1, 3).astype(np.int64)
    return words[:, 0] * 1_000_000_000 + words[:, 1]


def _differing(one: Integers, other: Integers) -> int:
    """Return how many times of either are not in the other."""
    if one.size == other.size and np.array_equal(np.sort(one), np.sort(other)):
        return 0
    return max(int((~np.isin(one, other)).sum()), int((~np.isin(other, one)).sum()))
