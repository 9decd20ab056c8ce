"""The records in a chunk of an MCAP file, found by compiled loops."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.readers.container import ZSTD_MAGIC
from vsalog.readers.packets import Bytes, Messages, Packet


class Size(IntEnum):
    """Bytes that parts of fixed length take (mcap.dev/spec)."""

    HEAD = 1 + 8  # opcode and length
    MESSAGE = 2 + 4 + 8 + 8  # channel, sequence, log time and publish time
    LONGEST_COMPRESSION = 16  # names are "zstd" and "lz4"
    CHUNK = HEAD + 28 + 4 + LONGEST_COMPRESSION + 8  # a chunk's beginning, up to the length of its records


class Reserved(IntEnum):
    """Opcodes from which on records are not of the format (mcap.dev/spec)."""

    PRIVATE = 0x80


class Width(IntEnum):
    """Bytes of a number. Members have one type: what takes numbers is compiled once more for each that is written out."""

    SHORT, INT, LONG = 2, 4, 8


class Found(IntEnum):
    """Rows of the table of messages."""

    CHANNEL, LOG, PUBLISH, START, LENGTH = range(5)


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
    count, _ = _messages(data, 0, wanted, np.empty((len(Found), 0), dtype=np.int64))
    found = np.empty((len(Found), count), dtype=np.int64)
    _, compressed = _messages(data, 0, wanted, found)
    channel, log, publish, start, length = found
    return Packet(channel, log, publish, Messages(data, start, length), bool(compressed))


def ends_whole(data: Bytes) -> bool:
    """Return whether the last record ends where the chunk does."""
    kind, at = 0, 0
    while kind >= 0:
        kind, start, length = _next_other(data, at)
        at = start + length
    return bool(at == data.size)


def others_in(data: Bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records in a chunk that are no messages."""
    position = 0
    while True:
        kind, start, length = _next_other(data, position)
        if kind < 0:
            return
        yield int(kind), data[start : start + length].tobytes()
        position = start + length


@compiled
def _number(data: Bytes, at: int, width: Width) -> int:
    """Read an unsigned number, least byte first; beyond int64 it becomes negative."""
    value = 0
    for i in range(width - 1, -1, -1):
        value = (value << 8) | int(data[at + i])
    return value


@compiled
def _record(data: Bytes, at: int) -> int:
    """Return the length of the record's content; -1 where it does not end within the data."""
    if at + Size.HEAD > data.size:
        return -1
    length = _number(data, at + 1, Width.LONG)
    return length if 0 <= length <= data.size - at - Size.HEAD else -1


@compiled
def _messages(data: Bytes, at: int, wanted: NDArray[np.bool_], found: NDArray[np.int64]) -> tuple[int, bool]:
    """Store the positions of the wanted messages, from a record on and as far as there is room.

    Returns their number, and whether one of them begins as compressed ones do.
    """
    count, compressed = 0, False
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        head = at + Size.HEAD
        at = head + length
        if data[head - Size.HEAD] != Opcode.MESSAGE or length < Size.MESSAGE:
            continue
        channel = _number(data, head, Width.SHORT)
        if not wanted[channel]:
            continue
        start = head + Size.MESSAGE
        if count < found.shape[1]:
            found[Found.CHANNEL, count] = channel
            found[Found.LOG, count] = _number(data, head + 6, Width.LONG)
            found[Found.PUBLISH, count] = _number(data, head + 14, Width.LONG)
            found[Found.START, count], found[Found.LENGTH, count] = start, at - start
            compressed |= at - start >= Width.INT and _number(data, start, Width.INT) == _ZSTD
        count += 1
    return count, compressed


@compiled
def _next_other(data: Bytes, at: int) -> tuple[int, int, int]:
    """Return kind, start and length of the next record that is no message; kind -1 and where the last whole one ends."""
    while at < data.size:
        length = _record(data, at)
        if length < 0:
            break
        if data[at] != Opcode.MESSAGE:
            return int(data[at]), at + Size.HEAD, length
        at += Size.HEAD + length
    return -1, at, 0


def next_sure_record(data: Bytes, rest: int, loose: bool) -> int:
    """Return the position where the first record surely begins, -1 for none.

    Parameters
    ----------
    data : uint8 array
        A stretch of a file.
    rest : int
        Bytes of the file from the beginning of the stretch.
    loose : bool
        Messages outside of chunks count, where another record follows.
    """
    return int(_next_sure(data, rest, loose))


@compiled
def _next_sure(data: Bytes, rest: int, loose: bool) -> int:
    for at in range(data.size - Size.HEAD):
        length = _number(data, at + 1, Width.LONG)
        if not 0 < length <= rest - at - Size.HEAD:
            continue
        content, whole = at + Size.HEAD, at + Size.CHUNK <= data.size
        if data[at] == Opcode.CHUNK and whole:
            name = _number(data, content + 28, Width.INT)
            if name <= Size.LONGEST_COMPRESSION and length == 40 + name + _number(
                data, content + 32 + name, Width.LONG
            ):
                return at
        elif data[at] == Opcode.MESSAGE_INDEX and whole:
            entries = _number(data, content + 2, Width.INT)
            if entries and entries % 16 == 0 and length == 6 + entries:
                return at
        elif data[at] == Opcode.DATA_END and length == 4:
            return at
        elif loose and data[at] == Opcode.MESSAGE and length >= Size.MESSAGE:
            following = content + length
            if following + Size.HEAD <= data.size and _next_fits(data, following, rest):
                return at
    return -1


@compiled
def _next_fits(data: Bytes, at: int, rest: int) -> bool:
    """Return whether a message or the end of the data can be at a place."""
    length = _number(data, at + 1, Width.LONG)
    if data[at] == Opcode.MESSAGE:
        return Size.MESSAGE <= length <= rest - at - Size.HEAD
    return bool(data[at] == Opcode.DATA_END and length == 4)
