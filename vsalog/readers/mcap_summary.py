"""The summary at the end of an MCAP file: its channels at once, without walking the file."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import IO

import numpy as np
from mcap.opcode import Opcode

from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.readers.chunk_index import Chunk
from vsalog.readers.mcap_scan import ends_whole, others_in
from vsalog.readers.mcap_walk import MAGIC

_HEAD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<BQQQI")
_CHUNK_INDEX = struct.Struct("<QQQQI")
_OFFSET = struct.Struct("<HQ")


def summary_records(file: IO[bytes], start: int | None = None) -> Iterator[tuple[int, bytes]] | None:
    """Return kind and content of the records in the summary; None where there is none, or it is damaged.

    Parameters
    ----------
    file : binary file
        Opened.
    start : int, optional
        Byte at which it begins, in place of the footer's: removed chunks leave the footer's number too large.
    """
    found = _footer(file)
    if found is None:
        return None
    position, stated, checksum = found
    start = stated if start is None else start
    if not 0 < start <= position or position - start > AT_ONCE_BYTES:
        return None
    file.seek(start)
    section = file.read(position - start + _FOOTER.size)
    # The checksum covers the footer up to itself.
    if checksum and zlib.crc32(section[:-4]) != checksum:
        return None
    records = np.frombuffer(section[: position - start], np.uint8)
    return others_in(records) if ends_whole(records) else None


def chunk_in(content: bytes) -> tuple[int, Chunk]:
    """Return the position of the chunk that a chunk index record is of, and what the record tells of it."""
    first, last, position, _, size = _CHUNK_INDEX.unpack_from(content)
    offsets = content[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
    channels = frozenset(channel for channel, _ in _OFFSET.iter_unpack(offsets[: size // _OFFSET.size * _OFFSET.size]))
    return position, Chunk(first, last, channels or None)


def states_checksum(file: IO[bytes]) -> bool:
    """Tell whether there may be a checksum of the data section."""
    found = _footer(file)
    if found is None:
        return False
    position, start, _ = found
    at = (start or position) - _HEAD.size - 4
    if not 0 <= at < position:
        return True
    file.seek(at)
    end = file.read(_HEAD.size + 4)
    return (
        len(end) < _HEAD.size + 4
        or end[: _HEAD.size] != _HEAD.pack(Opcode.DATA_END, 4)
        or end[_HEAD.size :] != bytes(4)
    )


def _footer(file: IO[bytes]) -> tuple[int, int, int] | None:
    """Return the footer's position, where the summary starts, and its checksum (0 for none); None without a footer."""
    position = file.seek(0, 2) - len(MAGIC) - _FOOTER.size
    if position < len(MAGIC):
        return None
    file.seek(position)
    kind, length, start, _, checksum = _FOOTER.unpack(file.read(_FOOTER.size))
    return (position, start, checksum) if kind == Opcode.FOOTER and length == _FOOTER.size - _HEAD.size else None
