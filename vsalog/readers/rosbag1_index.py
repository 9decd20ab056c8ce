"""What a ROS 1 bag's index tells about its messages, held against what was found."""

from __future__ import annotations

import numpy as np

from vsalog.readers.base import plural
from vsalog.readers.packets import Integers, Packet
from vsalog.readers.rosbag1_walk import CHUNK_INFO, INDEX, Header, number, op


class IndexCheck:
    """Counts the messages that the index knows and the walk has not found, and log times that differ.

    Parameters
    ----------
    wanted : int64 array, sorted
        Connections that are read.
    """

    def __init__(self, wanted: Integers) -> None:
        self._wanted = wanted
        self._last: Packet | None = None
        self._found = self._expected = self._differing = 0

    def chunk(self, packet: Packet) -> None:
        """Take note of the messages found in a chunk; its index follows."""
        self._last = packet
        self._found += len(packet.messages)

    def record(self, header: Header, data: bytes) -> None:
        """Take note of a record of the index."""
        if op(header) == INDEX and self._last is not None:
            connection = number(header, b"conn")
            if connection in self._wanted:
                own = self._last.log[self._last.connection == connection]
                self._differing += _differing(own, _times(data))
        elif op(header) == CHUNK_INFO:
            count = np.frombuffer(data, "<u4").reshape(-1, 2).astype(np.int64)
            self._expected += int(count[np.isin(count[:, 0], self._wanted), 1].sum())

    def notes(self) -> list[str]:
        """Return in words what differs."""
        notes = []
        if self._found < self._expected:
            missing = self._expected - self._found
            notes.append(f"{missing} of {plural(self._expected, 'message')} that the index counts were not found")
        if self._differing:
            notes.append(f"the log times of {plural(self._differing, 'message')} differ from those in the index")
        return notes


def _times(data: bytes) -> Integers:
    """Return the log times [ns] in a chunk's index of one connection."""
    words = np.frombuffer(data, "<u4").reshape(-1, 3).astype(np.int64)
    return words[:, 0] * 1_000_000_000 + words[:, 1]


def _differing(one: Integers, other: Integers) -> int:
    """Return how many times of either are not in the other."""
    if one.size == other.size and np.array_equal(np.sort(one), np.sort(other)):
        return 0
    return max(int((~np.isin(one, other)).sum()), int((~np.isin(other, one)).sum()))
