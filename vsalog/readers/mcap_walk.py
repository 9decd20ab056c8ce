"""The records of an MCAP file one after the other, past damage.

A record tells its length twice: in its head, and by the lengths of its parts. Where the two disagree, or no record can begin
where it ends, bytes have changed; the walk then goes on at the next place where a record surely begins.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from typing import IO

import numpy as np
from mcap.opcode import Opcode

from vsalog.core.finding import Finding
from vsalog.core.memory import AT_ONCE_BYTES, PIECE_BYTES
from vsalog.readers.limits import GLANCE_BYTES
from vsalog.readers.mcap_scan import Reserved, Size, next_sure_record
from vsalog.readers.record_walk import RecordWalk

MAGIC = b"\x89MCAP0\r\n"


KEPT = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA)
"""Records that are handed over if nothing else is asked for."""

# The parts of each record: so many bytes, or (negative) as many as a number of so many bytes says.
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


class Walk(RecordWalk):
    """One pass over the data section; see `RecordWalk`.

    Parameters
    ----------
    file, passed : as for `RecordWalk`
    verify : bool
        Compute the checksum of the data section.
    kept : collection of int
        Kinds of records that are handed over; the others are passed by.
    chunked : bool
        It is known that messages are in chunks.

    Attributes
    ----------
    unknown : int
        Records of a kind that the format does not have.
    changed : bool
        The checksum of the data section does not match.
    end : int or None
        Where what follows the data section begins, once it was reached.
    """

    def __init__(
        self,
        file: IO[bytes],
        verify: bool,
        passed: Callable[[int], bool] = lambda position: False,
        kept: Collection[int] = KEPT,
        chunked: bool = False,
    ) -> None:
        super().__init__(file, passed)
        self.unknown = 0
        self.changed = False
        self.end: int | None = None
        self._verify = verify
        self._kept = kept
        self._checksum = zlib.crc32(MAGIC)
        self._chunked = chunked

    def records(self, position: int = len(MAGIC), until: int | None = None) -> Iterator[tuple[int, bytes, int]]:
        """Yield kind, content and position of the records in `kept`, from a position on and `until` another.

        Without that up to the end of the data section or of what there is.
        """
        while until is None or position < until:
            kind, length = self._sound(position)
            if kind in (Opcode.DATA_END, Opcode.FOOTER):
                self._compare_checksum(kind, position)
                self.end = position + (_HEAD.size + length if kind == Opcode.DATA_END else 0)
                return
            if kind < 0:
                self._chunked |= self._resembles_chunk(position)
                following = self._resume(position)
                if following < 0:
                    return
                self.skipped.append((position, following))
                position = following
                continue
            if kind == Opcode.CHUNK and self._passed(position):
                position += _HEAD.size + length
                continue
            keep = kind in self._kept and (kind != Opcode.ATTACHMENT or length <= AT_ONCE_BYTES)
            content = self._read(position, length, keep)
            if keep and len(content) < length:  # the file has become shorter meanwhile
                self.cut = (position, self._size)
                return
            self._chunked |= kind == Opcode.CHUNK
            self.unknown += Opcode.DATA_END < kind < Reserved.PRIVATE
            if keep:
                yield kind, content, position
            position += _HEAD.size + length

    MARK = MAGIC

    def note_joined(self) -> None:
        """Look whether another file begins behind the end of this one."""
        end = self._size if self.end is None else self.end
        for _, _, following in self.heads(end):
            end = following
        kind, length = self._head(end)
        self._file.seek(end + _HEAD.size + length + len(MAGIC))
        if kind == Opcode.FOOTER and self._file.read(len(MAGIC)) == MAGIC:
            self.joined = end + _HEAD.size + length + len(MAGIC)

    def findings(self) -> list[Finding]:
        """Return what was damaged."""
        found = super().findings()
        if self.unknown:
            found.append(Finding(code="recording.unknown_records", value=self.unknown))
        if self.changed:
            found.append(Finding(code="recording.bad_checksum"))
        return found

    def _end(self, position: int) -> tuple[int, int] | None:
        kind, length = self._head(position)
        return None if kind in (-1, Opcode.FOOTER, Opcode.DATA_END) else (kind, position + _HEAD.size + length)

    def _next_sure(self, data: bytes, position: int) -> int:
        """See `RecordWalk`; messages count only as long as no chunk was seen: within one, nothing would vouch for them."""
        return next_sure_record(np.frombuffer(data, np.uint8), self._size - position, not self._chunked)

    def _sound(self, position: int) -> tuple[int, int]:
        """Return kind and content's length of the record at a position; kind -1 where none can be."""
        kind, length = self._head(position)
        if kind < 0:
            return -1, 0
        least = _least_length(kind, self._file.read(min(length, GLANCE_BYTES)) if kind != Opcode.MESSAGE else b"")
        if least == length and kind != Opcode.MESSAGE:
            return kind, length
        # Records may have grown by parts that are not known yet, but hardly to twice their head.
        if least > length or (kind == Opcode.CHUNK and length - least > Size.CHUNK):
            return -1, 0
        end = position + _HEAD.size + length
        return (kind, length) if end == self._size or self._head(end)[0] > 0 else (-1, 0)

    def _resembles_chunk(self, position: int) -> bool:
        """Tell whether a damaged record was a chunk: by its kind, or by its lengths."""
        self._file.seek(position)
        head = self._file.read(_HEAD.size + GLANCE_BYTES)
        if len(head) < _HEAD.size:
            return False
        kind, length = _HEAD.unpack_from(head)
        return bool(kind == Opcode.CHUNK or length == _least_length(Opcode.CHUNK, head[_HEAD.size :]))

    def _head(self, position: int) -> tuple[int, int]:
        """Return kind and length as a record's head has them; kind -1 where they cannot be right."""
        self._file.seek(position)
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return -1, 0
        kind, length = _HEAD.unpack(head)
        fits = length <= self._size - position - _HEAD.size
        return (kind, length) if fits and kind else (-1, 0)

    def _read(self, position: int, length: int, keep: bool) -> bytes:
        """Return a record's content if it is kept; its bytes are added to the checksum."""
        self._file.seek(position)
        if not keep and not self._verify:
            return b""
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
        return b""

    def _compare_checksum(self, kind: int, position: int) -> None:
        """Compare the checksum with the one at the end of the data section, 0 for none."""
        self._file.seek(position + _HEAD.size)
        stated = struct.unpack("<I", self._file.read(4))[0] if kind == Opcode.DATA_END else 0
        self.changed = bool(self._verify and stated and not self.skipped and stated != self._checksum)


def _least_length(kind: int, beginning: bytes) -> int:
    """Return how long a record's content has to be at least by its parts, as far as its beginning tells."""
    at = 0
    for part in _PARTS.get(kind, ()):
        if part > 0:
            at += part
        elif at - part > len(beginning):
            break
        else:
            at += int.from_bytes(beginning[at : at - part], "little") - part
    return at
