"""The messages in a chunk of a ROS 1 bag, found by compiled loops.

After an invalid record, the walk continues at the next valid message that is followed by another record.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numba import njit
from rosbags.rosbag1.reader import RecordType

from vsalog.readers.packets import Bytes, Integers, Messages, Packet


class Least(IntEnum):
    """Bytes that records take at least: lengths of header and data, and the header's fields, of a message op, conn and time."""

    HEADER = (4 + 4) + (4 + 9) + (4 + 13)
    MESSAGE = 4 + 4 + HEADER
    CONNECTION = 4 + (4 + 4) + 4


_OP, _CONN, _TIME = (np.frombuffer(name, np.uint8) for name in (b"op=", b"conn=", b"time="))


def messages_in(data: Bytes, wanted: Integers) -> tuple[Packet, bool, Integers]:
    """Return the messages in a chunk's records, whether all records are sound, and where its connection records are.

    These are rows of three: where the header starts and stops, and where the data end.

    Parameters
    ----------
    data : uint8 array
        The records, decompressed.
    wanted : int64 array, sorted
        Connections.
    """
    most = data.size // Least.MESSAGE + 1
    connection, log, start, length = (np.empty(most, dtype=np.int64) for _ in range(4))
    told = np.empty((data.size // Least.CONNECTION + 1, 3), dtype=np.int64)
    count, whole, connections = _walk(data, wanted, connection, log, start, length, told)
    messages = Messages(data, start[:count], length[:count])
    found = Packet(connection[:count], log[:count], np.zeros(count, dtype=np.int64), messages, compressed=False)
    return found, bool(whole), told[:connections]


@njit(cache=True, nogil=True)
def _word(data: Bytes, at: int) -> int:
    """Read an unsigned number of four bytes, least byte first."""
    value = 0
    for i in range(3, -1, -1):
        value = value * 256 + int(data[at + i])
    return value


@njit(cache=True, nogil=True)
def _begins(data: Bytes, at: int, name: Bytes) -> bool:
    same = True
    for i in range(name.size):
        same = same and data[at + i] == name[i]
    return same


@njit(cache=True, nogil=True)
def _fields(data: Bytes, at: int, end: int) -> tuple[bool, int, int, int]:
    """Read a record's header: whether it is sound, its op, its connection, its time [ns]; -1 for what it has not."""
    op, connection, time = -1, -1, -1
    while at < end:
        if at + 4 > end:
            return False, op, connection, time
        length = _word(data, at)
        at += 4
        if at + length > end:
            return False, op, connection, time
        named = False
        for i in range(length):
            if data[at + i] == 61:  # an equals sign
                named = True
                break
        if not named:
            return False, op, connection, time
        if length == 4 and _begins(data, at, _OP):
            op = int(data[at + 3])
        elif length == 9 and _begins(data, at, _CONN):
            connection = _word(data, at + 5)
        elif length == 13 and _begins(data, at, _TIME):
            time = _word(data, at + 5) * 1_000_000_000 + _word(data, at + 9)
        at += length
    return True, op, connection, time


@njit(cache=True, nogil=True)
def _record(data: Bytes, at: int) -> tuple[int, int, int, int, int]:
    """Read the head of the record at a place: where its data start, where they end, its op, its connection, its time [ns].

    The end is -1 where no record can be.
    """
    if at + 8 > data.size:
        return 0, -1, -1, -1, -1
    stop = at + 4 + _word(data, at)
    if stop + 4 > data.size:
        return 0, -1, -1, -1, -1
    sound, op, connection, time = _fields(data, at + 4, stop)
    end = stop + 4 + _word(data, stop)
    known = op == RecordType.CONNECTION or (op == RecordType.MSGDATA and connection >= 0 and time >= 0)
    if not sound or not known or end > data.size:
        return 0, -1, -1, -1, -1
    return stop + 4, end, op, connection, time


@njit(cache=True, nogil=True)
def _resume(data: Bytes, at: int) -> int:
    """Return where the next message surely begins, which is followed by another record or the chunk's end; the end for none."""
    for place in range(at, data.size - Least.MESSAGE + 1):
        if not Least.HEADER <= _word(data, place) <= 2 * Least.HEADER:  # hardly longer than need be
            continue
        _, end, op, _, _ = _record(data, place)
        if end >= 0 and op == RecordType.MSGDATA and (end == data.size or _record(data, end)[1] >= 0):
            return place
    return int(data.size)


@njit(cache=True, nogil=True)
def _walk(
    data: Bytes,
    wanted: Integers,
    connection: Integers,
    log: Integers,
    start: Integers,
    length: Integers,
    told: Integers,
) -> tuple[int, bool, int]:
    """Write down where the wanted messages and all connection records are.

    Returns how many messages there are, whether all records are sound, and how many connections there are.
    """
    at, count, whole, connections = 0, 0, True, 0
    while at < data.size:
        begin, end, op, number, time = _record(data, at)
        if end < 0:
            at, whole = _resume(data, at + 1), False
            continue
        if op == RecordType.MSGDATA:
            k = np.searchsorted(wanted, number)
            if k < wanted.size and wanted[k] == number:
                connection[count], log[count] = number, time
                start[count], length[count] = begin, end - begin
                count += 1
        if op == RecordType.CONNECTION:
            told[connections, 0], told[connections, 1], told[connections, 2] = at + 4, begin - 4, end
            connections += 1
        at = end
    return count, whole, connections
