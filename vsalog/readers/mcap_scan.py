"""The records in a chunk of an MCAP file, found by compiled loops."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

import numpy as np
from mcap.opcode import Opcode
from numba import njit
from numpy.typing import NDArray

from vsalog.readers.container import ZSTD_MAGIC
from vsalog.readers.packets import Bytes, Integers, Messages, Packet


class Size(IntEnum):
    """Bytes that parts of fixed length take (mcap.dev/spec)."""

    HEAD = 1 + 8  # opcode and length
    MESSAGE = 2 + 4 + 8 + 8  # channel, sequence, log time and publish time
    LONGEST_COMPRESSION = 16  # names are "zstd" and "lz4"
    CHUNK = HEAD + 28 + 4 + LONGEST_COMPRESSION + 8  # a chunk's beginning, up to the length of its records


_ZSTD = int.from_bytes(ZSTD_MAGIC, "little")


def messages_in(data: Bytes, wanted: NDArray[np.bool_]) -> Packet:
    """Return the messages in a chunk's records.

    Parameters
    ----------
    data : uint8 array
        The records, decompressed.
    wanted : bool array, shape (65536,)
        By channel.
    """
    count = _count(data, wanted)
    channel, log, publish, start, length = (np.empty(count, dtype=np.int64) for _ in range(5))
    compressed = _fill(data, wanted, channel, log, publish, start, length)
    return Packet(channel, log, publish, Messages(data, start, length), bool(compressed))


def ends_whole(data: Bytes) -> bool:
    """Tell whether the last record ends where the chunk does."""
    return bool(_end(data) == data.size)


def others_in(data: Bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records in a chunk that are no messages."""
    position = 0
    while True:
        kind, start, length = _next_other(data, position)
        if kind < 0:
            return
        yield int(kind), data[start : start + length].tobytes()
        position = start + length


@njit(cache=True, nogil=True)
def _number(data: Bytes, at: int, width: int) -> int:
    """Read an unsigned number, least byte first; beyond int64 it becomes negative."""
    value = 0
    for i in range(width - 1, -1, -1):
        value = (value << 8) | int(data[at + i])
    return value


@njit(cache=True, nogil=True)
def _record(data: Bytes, at: int) -> int:
    """Return the length of the record's content; -1 where it does not end within the data."""
    if at + Size.HEAD > data.size:
        return -1
    length = _number(data, at + 1, 8)
    return length if 0 <= length <= data.size - at - Size.HEAD else -1


@njit(cache=True, nogil=True)
def _end(data: Bytes) -> int:
    """Return where the last whole record ends."""
    at = 0
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        at += Size.HEAD + length
    return at


@njit(cache=True, nogil=True)
def _count(data: Bytes, wanted: NDArray[np.bool_]) -> int:
    at, count = 0, 0
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        if data[at] == Opcode.MESSAGE and length >= Size.MESSAGE and wanted[_number(data, at + Size.HEAD, 2)]:
            count += 1
        at += Size.HEAD + length
    return count


@njit(cache=True, nogil=True)
def _fill(
    data: Bytes,
    wanted: NDArray[np.bool_],
    channel: Integers,
    log: Integers,
    publish: Integers,
    start: Integers,
    length: Integers,
) -> bool:
    """Write down where the wanted messages are; tells whether one of them begins as compressed ones do."""
    at, compressed = 0, False
    for k in range(channel.size):
        size = _record(data, at)
        while not (data[at] == Opcode.MESSAGE and size >= Size.MESSAGE and wanted[_number(data, at + Size.HEAD, 2)]):
            at += Size.HEAD + size
            size = _record(data, at)
        head = at + Size.HEAD
        channel[k] = _number(data, head, 2)
        log[k] = _number(data, head + 6, 8)
        publish[k] = _number(data, head + 14, 8)
        start[k], length[k] = head + Size.MESSAGE, size - Size.MESSAGE
        if length[k] >= 4 and data[start[k]] == _ZSTD & 0xFF:
            compressed |= _number(data, start[k], 4) == _ZSTD
        at = head + size
    return compressed


@njit(cache=True, nogil=True)
def _next_other(data: Bytes, at: int) -> tuple[int, int, int]:
    """Return kind, start and length of the next record that is no message; kind -1 where there is none."""
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        if data[at] != Opcode.MESSAGE:
            return int(data[at]), at + Size.HEAD, length
        at += Size.HEAD + length
    return -1, 0, 0


def next_sure_record(data: Bytes, rest: int, loose: bool) -> int:
    """Return where the first record surely begins, -1 where none does.

    Parameters
    ----------
    data : uint8 array
        A stretch of a file.
    rest : int
        How many bytes the file has from the beginning of the stretch.
    loose : bool
        Messages outside of chunks count, where another record follows.
    """
    return int(_next_sure(data, rest, loose))


@njit(cache=True, nogil=True)
def _next_sure(data: Bytes, rest: int, loose: bool) -> int:
    for at in range(data.size - Size.HEAD):
        length = _number(data, at + 1, 8)
        if not 0 < length <= rest - at - Size.HEAD:
            continue
        content, whole = at + Size.HEAD, at + Size.CHUNK <= data.size
        if data[at] == Opcode.CHUNK and whole:
            name = _number(data, content + 28, 4)
            if name <= Size.LONGEST_COMPRESSION and length == 40 + name + _number(data, content + 32 + name, 8):
                return at
        elif data[at] == Opcode.MESSAGE_INDEX and whole:
            entries = _number(data, content + 2, 4)
            if entries and entries % 16 == 0 and length == 6 + entries:
                return at
        elif data[at] == Opcode.DATA_END and length == 4:
            return at
        elif loose and data[at] == Opcode.MESSAGE and length >= Size.MESSAGE:
            following = content + length
            if following + Size.HEAD <= data.size and _next_fits(data, following, rest):
                return at
    return -1


@njit(cache=True, nogil=True)
def _next_fits(data: Bytes, at: int, rest: int) -> bool:
    """Tell whether a message or the end of the data can be at a place."""
    length = _number(data, at + 1, 8)
    if data[at] == Opcode.MESSAGE:
        return Size.MESSAGE <= length <= rest - at - Size.HEAD
    return bool(data[at] == Opcode.DATA_END and length == 4)
