"""The records of a ROS 1 bag one after the other, past damage.

The format has no checksum, but tells some things twice: how long a record's data are, which fields its header has, how many
messages of which times a chunk holds. Where these disagree, bytes have changed; the walk then goes on at the next chunk, and
within a chunk at the next message (`rosbag1_scan.py`).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from typing import IO

from rosbags.rosbag1.reader import RecordType

from vsalog.core.memory import AT_ONCE_BYTES, PIECE_BYTES
from vsalog.readers.compression import DamagedDataError, decompress
from vsalog.readers.record_walk import RecordWalk

VERSION = b"#ROSBAG V2.0\n"
Header = dict[bytes, bytes]

# The fields that a record of each kind has, and their lengths (0 where they vary).
_FIELDS: dict[int, dict[bytes, int]] = {
    RecordType.MSGDATA: {b"conn": 4, b"time": 8},
    RecordType.BAGHEADER: {b"index_pos": 8},
    RecordType.IDXDATA: {b"ver": 4, b"conn": 4, b"count": 4},
    RecordType.CHUNK: {b"compression": 0, b"size": 4},
    RecordType.CHUNK_INFO: {b"ver": 4, b"chunk_pos": 8, b"count": 4},
    RecordType.CONNECTION: {b"conn": 4, b"topic": 0},
}
# How many bytes each counted item takes in the data.
_ITEM: dict[int, int] = {RecordType.IDXDATA: 12, RecordType.CHUNK_INFO: 8}
_LENGTH = struct.Struct("<I")
_CHUNK_MARK = re.compile(rb"\x04\0\0\0op=\x05")


class Walk(RecordWalk):
    """One pass over the records of a bag; see `RecordWalk`.

    Attributes
    ----------
    position : int
        Where the last chunk begins.
    passing : bool
        The last chunk was passed by.
    """

    MARK = VERSION

    def __init__(self, file: IO[bytes], passed: Callable[[int], bool] = lambda position: False) -> None:
        super().__init__(file, passed)
        self.position = 0
        self.passing = False

    def records(self, position: int = len(VERSION), until: int | None = None) -> Iterator[tuple[Header, bytes]]:
        """Yield header and data of the records from a position on, `until` another or the end, chunks decompressed."""
        while position < (self._size if until is None else until):
            if self._passed(position) and (end := self._chunk_end(position)):
                position, self.passing = end, True
                continue
            record = self._record(position)
            if record is not None:
                header, data, end = record
                if op(header) != RecordType.CHUNK:
                    yield header, data
                    position = end
                    continue
                self.chunks, self.position = self.chunks + 1, position
                try:
                    data = decompress(_compression(header), data, number(header, b"size"))
                except DamagedDataError as error:
                    self.lose(position, f"cannot be decompressed, {error}")
                else:
                    self.passing = False
                    yield header, data
                    position = end
                    continue
                if end == self._size or self._header(end) is not None:
                    position = end
                    continue
            following = self._resume(position)
            if following < 0:
                return
            if record is None:
                self.skipped.append((position, following))
            position = following

    def _end(self, position: int) -> tuple[int, int] | None:
        found = self._header(position)
        return None if found is None else (op(found[0]), found[1] + found[2])

    def beginning(self, position: int, size: int) -> tuple[str, bytes] | None:
        """Return the compression and the first bytes of the data of the chunk at a position; None where there is none."""
        found = self._header(position)
        if found is None or op(found[0]) != RecordType.CHUNK:
            return None
        header, start, length = found
        self._file.seek(start)
        return _compression(header), self._file.read(min(length, size))

    def _chunk_end(self, position: int) -> int:
        """Return where the chunk at a position ends, 0 where there is none or nothing follows it."""
        found = self._header(position)
        if found is None or op(found[0]) != RecordType.CHUNK:
            return 0
        end = found[1] + found[2]
        return end if self._header(end) is not None else 0

    def _record(self, position: int) -> tuple[Header, bytes, int] | None:
        """Return header, data and end of the record at a position; None where there is none whose parts agree."""
        found = self._header(position)
        if found is None:
            return None
        header, start, length = found
        end = start + length
        kind = op(header)
        if kind == RecordType.CHUNK and max(length, number(header, b"size")) > AT_ONCE_BYTES:
            return header, b"", end
        self._file.seek(start)
        data = self._file.read(length)
        if kind in _ITEM:
            sound = length == _ITEM[kind] * number(header, b"count")
        elif kind == RecordType.CONNECTION:
            sound = fields(data) is not None
        else:
            sound = kind == RecordType.CHUNK or end == self._size or self._header(end) is not None
        return (header, data, end) if sound else None

    def _header(self, position: int) -> tuple[Header, int, int] | None:
        """Return the header at a position, where its data start and how long they are; None where there is none."""
        self._file.seek(position)
        head = self._file.read(4)
        if len(head) < 4 or _LENGTH.unpack(head)[0] > PIECE_BYTES:
            return None
        length = _LENGTH.unpack(head)[0]
        header = fields(self._file.read(length))
        word = self._file.read(4)
        if header is None or len(word) < 4:
            return None
        start, count = position + 8 + length, _LENGTH.unpack(word)[0]
        expected = _FIELDS.get(op(header))
        if expected is None or count > self._size - start:
            return None
        if any(name not in header or (size and len(header[name]) != size) for name, size in expected.items()):
            return None
        return header, start, count

    def _next_sure(self, data: bytes, position: int) -> int:
        """See `RecordWalk`: where the next chunk begins."""
        for mark in _CHUNK_MARK.finditer(data):
            # The header's length lies ahead of the field op, or of others before it.
            for start in range(mark.start() - 4, max(mark.start() - 80, -1), -1):
                if mark.end() <= start + 4 + _LENGTH.unpack_from(data, start)[0] <= start + 256:
                    found = self._header(position + start)
                    is_chunk = found is not None and op(found[0]) == RecordType.CHUNK
                    if found is not None and is_chunk and _compression(found[0]) in _COMPRESSIONS:
                        return start
        return -1


_COMPRESSIONS = ("none", "bz2", "lz4")


def fields(raw: bytes) -> Header | None:
    """Split a record's header into its fields; None where it is nonsense."""
    found: Header = {}
    position = 0
    while position < len(raw):
        if position + 4 > len(raw):
            return None
        end = position + 4 + _LENGTH.unpack_from(raw, position)[0]
        name, equals, value = raw[position + 4 : end].partition(b"=")
        if end > len(raw) or not equals:
            return None
        found[name] = value
        position = end
    return found


def op(header: Header) -> int:
    """Return which kind of record a header belongs to, -1 where it does not say."""
    value = header.get(b"op", b"")
    return value[0] if len(value) == 1 else -1


def number(header: Header, name: bytes) -> int:
    """Return a field of four bytes as a number."""
    return int(_LENGTH.unpack(header[name])[0])


def _compression(header: Header) -> str:
    return header[b"compression"].decode("ascii", "replace")
