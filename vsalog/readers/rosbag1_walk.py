"""The records of a ROS 1 bag one after the other, past damage.

The format has no checksum, but states some things twice: the length of a record's data, the fields of its header, the number
and times of the messages in a chunk. Where these disagree, bytes have changed; the walk then continues at the next chunk, and
within a chunk at the next message (`rosbag1_scan.py`).
"""

from __future__ import annotations

import re
import struct

from rosbags.rosbag1.reader import RecordType

from vsalog.core.memory import PIECE_BYTES
from vsalog.readers.compression import DamagedDataError, decompress, refuse_bomb
from vsalog.readers.limits import GLANCE_BYTES
from vsalog.readers.record_walk import Header, Place, RecordWalk

VERSION = b"#ROSBAG V2.0\n"

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
    """One pass over the records of a bag; see `RecordWalk`."""

    MARK, CHUNK = VERSION, RecordType.CHUNK

    def beginning(self, position: int) -> tuple[str, bytes] | None:
        """See `RecordWalk`."""
        place = self._head(position)
        if place is None or place.kind != RecordType.CHUNK:
            return None
        self._file.seek(place.start)
        return _compression(place.header), self._file.read(min(place.end - place.start, GLANCE_BYTES))

    def _sound(self, position: int) -> Place | None:
        place = self._head(position)
        if place is None:
            return None
        if place.kind in _ITEM:
            sound = place.end - place.start == _ITEM[place.kind] * number(place.header, b"count")
        elif place.kind == RecordType.CONNECTION:
            sound = fields(self._content(place)) is not None
        else:
            sound = place.kind == RecordType.CHUNK or self._follows(place.end)
        return place if sound else None

    def _content(self, place: Place) -> bytes:
        if place.kind == RecordType.CHUNK:
            refuse_bomb(place.end - place.start, max(place.end - place.start, number(place.header, b"size")))
        self._file.seek(place.start)
        return self._file.read(place.end - place.start)

    def _decompressed(self, chunk: Place, content: bytes) -> bytes:
        try:
            return decompress(_compression(chunk.header), content, number(chunk.header, b"size"))
        except DamagedDataError as error:
            raise DamagedDataError(f"cannot be decompressed, {error}") from error

    def _follows(self, end: int) -> bool:
        return end == self._size or self._head(end) is not None

    def _head(self, position: int) -> Place | None:
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
        return Place(op(header), start, start + count, header)

    def _next_sure(self, data: bytes, position: int) -> int:
        """See `RecordWalk`: where the next chunk begins."""
        for mark in _CHUNK_MARK.finditer(data):
            # The header's length is before the field op, or before other fields.
            for start in range(mark.start() - 4, max(mark.start() - 80, -1), -1):
                if mark.end() <= start + 4 + _LENGTH.unpack_from(data, start)[0] <= start + 256:
                    place = self._head(position + start)
                    is_chunk = place is not None and place.kind == RecordType.CHUNK
                    if place is not None and is_chunk and _compression(place.header) in _COMPRESSIONS:
                        return start
        return -1


_COMPRESSIONS = ("none", "bz2", "lz4")


def fields(raw: bytes) -> Header | None:
    """Split a record's header into its fields; None where it is invalid."""
    found: dict[bytes, bytes] = {}
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
    """Return the kind of record that a header belongs to, -1 where it has none."""
    value = header.get(b"op", b"")
    return value[0] if len(value) == 1 else -1


def number(header: Header, name: bytes) -> int:
    """Return a field of four bytes as a number."""
    return int(_LENGTH.unpack(header[name])[0])


def _compression(header: Header) -> str:
    return header[b"compression"].decode("ascii", "replace")
