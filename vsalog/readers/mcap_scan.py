"""The records in a chunk of an MCAP file, found by compiled loops."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.readers.packets import Bytes, Integers, Messages, Packet

MESSAGE = 5
# Opcode and length; channel, sequence, log time and publish time of a message (mcap.dev/spec).
_HEAD, _MESSAGE_HEAD = 9, 22
_CHUNK, _MESSAGE_INDEX, _DATA_END = 6, 7, 15
# How what zstd made begins.
_ZSTD_FIRST, _ZSTD_NUMBER = 0x28, 0xFD2FB528
# Bytes of a chunk's beginning, up to the length of its records; compressions have short names.
_CHUNK_HEAD, _LONGEST_NAME = 9 + 28 + 4 + 16 + 8, 16


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
    if at + _HEAD > data.size:
        return -1
    length = _number(data, at + 1, 8)
    return length if 0 <= length <= data.size - at - _HEAD else -1


@njit(cache=True, nogil=True)
def _end(data: Bytes) -> int:
    """Return where the last whole record ends."""
    at = 0
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        at += _HEAD + length
    return at


@njit(cache=True, nogil=True)
def _count(data: Bytes, wanted: NDArray[np.bool_]) -> int:
    at, count = 0, 0
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        if data[at] == MESSAGE and length >= _MESSAGE_HEAD and wanted[_number(data, at + _HEAD, 2)]:
            count += 1
        at += _HEAD + length
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
        while not (data[at] == MESSAGE and size >= _MESSAGE_HEAD and wanted[_number(data, at + _HEAD, 2)]):
            at += _HEAD + size
            size = _record(data, at)
        head = at + _HEAD
        channel[k] = _number(data, head, 2)
        log[k] = _number(data, head + 6, 8)
        publish[k] = _number(data, head + 14, 8)
        start[k], length[k] = head + _MESSAGE_HEAD, size - _MESSAGE_HEAD
        if length[k] >= 4 and data[start[k]] == _ZSTD_FIRST:
            compressed |= _number(data, start[k], 4) == _ZSTD_NUMBER
        at = head + size
    return compressed


@njit(cache=True, nogil=True)
def _next_other(data: Bytes, at: int) -> tuple[int, int, int]:
    """Return kind, start and length of the next record that is no message; kind -1 where there is none."""
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        if data[at] != MESSAGE:
            return int(data[at]), at + _HEAD, length
        at += _HEAD + length
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
    for at in range(data.size - _HEAD):
        length = _number(data, at + 1, 8)
        if not 0 < length <= rest - at - _HEAD:
            continue
        content, whole = at + _HEAD, at + _CHUNK_HEAD <= data.size
        if data[at] == _CHUNK and whole:
            name = _number(data, content + 28, 4)
            if name <= _LONGEST_NAME and length == 40 + name + _number(data, content + 32 + name, 8):
                return at
        elif data[at] == _MESSAGE_INDEX and whole:
            entries = _number(data, content + 2, 4)
            if entries and entries % 16 == 0 and length == 6 + entries:
                return at
        elif data[at] == _DATA_END and length == 4:
            return at
        elif loose and data[at] == MESSAGE and length >= _MESSAGE_HEAD:
            following = content + length
            if following + _HEAD <= data.size and _next_fits(data, following, rest):
                return at
    return -1


@njit(cache=True, nogil=True)
def _next_fits(data: Bytes, at: int, rest: int) -> bool:
    """Tell whether a message or the end of the data can be at a place."""
    length = _number(data, at + 1, 8)
    if data[at] == MESSAGE:
        return _MESSAGE_HEAD <= length <= rest - at - _HEAD
    return bool(data[at] == _DATA_END and length == 4)
