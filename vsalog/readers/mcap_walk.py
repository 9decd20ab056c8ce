"""The records of an MCAP file one after the other, past damage.

A record states its length twice: in its head, and by the lengths of its parts. Where the two disagree, or no record can begin
where it ends, bytes have changed; the walk then continues at the next place where a record surely begins.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Collection
from typing import IO

import numpy as np
from mcap.opcode import Opcode

from vsalog.core.finding import Finding
from vsalog.core.memory import AT_ONCE_BYTES, PIECE_BYTES
from vsalog.readers.compression import DamagedDataError, decompress
from vsalog.readers.limits import GLANCE_BYTES
from vsalog.readers.mcap_scan import Reserved, Size, next_sure_record
from vsalog.readers.record_walk import Place, RecordWalk

MAGIC = b"\x89MCAP0\r\n"


KEPT = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA)
"""Records that are returned by default."""

# The parts of each record: a number of bytes, or (negative) the size of a number that states the bytes.
_PARTS: dict[int, tuple[int, ...]] = {
    Opcode.HEADER: (-4, -4),
    Opcode.FOOTER: (20,),
    Opcode.SCHEMA: (2, -4, -4, -4),
    Opcode.CHANNEL: (4, -4, -4, -4),
    Opcode.MESSAGE: (22,),
    Opcode.CHUNK: (28, -4, -8),
    Opcode.MESSAGE_INDEX: (2, -4),
    Opcode.ATTACHMENT: (16, -4, -4, -8, 4),
    Opcode.METADATA: (-4, -4),
    Opcode.DATA_END: (4,),
}
_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")


class Walk(RecordWalk):
    """One pass over the data section; see `RecordWalk`.

    Parameters
    ----------
    file, passed : as for `RecordWalk`
    verify : bool
        Compute the checksum of the data section.
    kept : collection of int
        Kinds of records that are returned; the others are skipped.
    chunked : bool
        It is known that messages are in chunks.

    Attributes
    ----------
    unknown : int
        Records of a kind that the format does not have.
    changed : bool
        The checksum of the data section does not match.
    """

    MARK, CHUNK, LAST = MAGIC, Opcode.CHUNK, (Opcode.DATA_END, Opcode.FOOTER)

    def __init__(
        self,
        file: IO[bytes],
        verify: bool = False,
        passed: Callable[[int], bool] = lambda position: False,
        kept: Collection[int] = KEPT,
        chunked: bool = False,
    ) -> None:
        super().__init__(file, passed)
        self.unknown = 0
        self.changed = False
        self._verify = verify
        self._kept = kept
        self._checksum = zlib.crc32(MAGIC)
        self._chunked = chunked

    def beginning(self, position: int) -> tuple[str, bytes] | None:
        """See `RecordWalk`."""
        self._file.seek(position + _HEAD.size)
        content = self._file.read(GLANCE_BYTES)
        if len(content) < _CHUNK_HEAD.size:
            return None
        start = _CHUNK_HEAD.size + _CHUNK_HEAD.unpack_from(content)[4] + 8
        return content[_CHUNK_HEAD.size : start - 8].decode("ascii", "replace"), content[start:]

    def note_joined(self) -> None:
        """Check whether another file begins after the end of this one."""
        end = self._size if self.end is None else self.end
        for _, _, following in self.heads(end):
            end = following
        last = self._head(end)
        if last is not None and last.kind == Opcode.FOOTER:
            self._file.seek(last.end + len(MAGIC))
            if self._file.read(len(MAGIC)) == MAGIC:
                self.joined = last.end + len(MAGIC)

    def findings(self) -> list[Finding]:
        """Return what was damaged."""
        found = super().findings()
        if self.unknown:
            found.append(Finding(code="recording.unknown_records", value=self.unknown))
        if self.changed:
            found.append(Finding(code="recording.bad_checksum"))
        return found

    def _next_sure(self, data: bytes, position: int) -> int:
        """See `RecordWalk`; messages count only as long as no chunk was seen: within one, nothing would confirm them."""
        return next_sure_record(np.frombuffer(data, np.uint8), self._size - position, not self._chunked)

    def _sound(self, position: int) -> Place | None:
        place = self._head(position)
        if place is not None:
            length = place.end - place.start
            beginning = self._file.read(min(length, GLANCE_BYTES)) if place.kind != Opcode.MESSAGE else b""
            least = _least_length(place.kind, beginning)
            if least == length and place.kind != Opcode.MESSAGE:
                return place
            # Later versions may add parts to records, but hardly up to twice their head.
            grown = least <= length and (place.kind != Opcode.CHUNK or length - least <= Size.CHUNK)
            if grown and (place.end == self._size or self._head(place.end) is not None):
                return place
        self._chunked |= self._resembles_chunk(position)
        return None

    def _resembles_chunk(self, position: int) -> bool:
        """Return whether a damaged record was a chunk: by its kind, or by its lengths."""
        self._file.seek(position)
        head = self._file.read(_HEAD.size + GLANCE_BYTES)
        if len(head) < _HEAD.size:
            return False
        kind, length = _HEAD.unpack_from(head)
        return bool(kind == Opcode.CHUNK or length == _least_length(Opcode.CHUNK, head[_HEAD.size :]))

    def _head(self, position: int) -> Place | None:
        self._file.seek(position)
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        kind, length = _HEAD.unpack(head)
        start = position + _HEAD.size
        return Place(kind, start, start + length) if kind and length <= self._size - start else None

    def _content(self, place: Place) -> bytes | None:
        """Return a record's content if it is kept; its bytes are added to the checksum."""
        length = place.end - place.start
        keep = place.kind in self._kept and (place.kind != Opcode.ATTACHMENT or length <= AT_ONCE_BYTES)
        self._chunked |= place.kind == Opcode.CHUNK
        self.unknown += Opcode.DATA_END < place.kind < Reserved.PRIVATE
        self._file.seek(place.start - _HEAD.size)
        if not keep and not self._verify:
            return None
        head = self._file.read(_HEAD.size)
        if keep:
            content = self._file.read(length)
            if self._verify:
                self._checksum = zlib.crc32(content, zlib.crc32(head, self._checksum))
            return content
        self._checksum = zlib.crc32(head, self._checksum)
        while length > 0 and (piece := self._file.read(min(length, PIECE_BYTES))):
            self._checksum = zlib.crc32(piece, self._checksum)
            length -= len(piece)
        return None

    def _decompressed(self, chunk: Place, content: bytes) -> bytes:
        """See `RecordWalk`; the chunk's checksum is verified."""
        _, _, size, checksum, length = _CHUNK_HEAD.unpack_from(content)
        start = _CHUNK_HEAD.size + length + 8
        stored = int.from_bytes(content[start - 8 : start], "little")
        if start + stored > len(content):
            raise DamagedDataError("its lengths contradict one another")
        kind = content[_CHUNK_HEAD.size : start - 8].decode("ascii", "replace")
        data = decompress(kind, content[start : start + stored], size)
        if checksum and zlib.crc32(data) != checksum:
            raise DamagedDataError("checksum does not match")
        return data

    def _finish(self, last: Place) -> None:
        """Compare the checksum with the one at the end of the data section, 0 for none."""
        ended = last.kind == Opcode.DATA_END
        self.end = last.end if ended else last.start - _HEAD.size
        self._file.seek(last.start)
        stated = struct.unpack("<I", self._file.read(4))[0] if ended else 0
        self.changed = bool(self._verify and stated and not self.skipped and stated != self._checksum)


def _least_length(kind: int, beginning: bytes) -> int:
    """Return the least length of a record's content by its parts, as far as its beginning shows it."""
    at = 0
    for part in _PARTS.get(kind, ()):
        if part > 0:
            at += part
        elif at - part > len(beginning):
            break
        else:
            at += int.from_bytes(beginning[at : at - part], "little") - part
    return at
