"""What the pages of a Parquet column announce: Arrow makes room for it, whatever the footer says of the column.

The header of a page is a structure in Thrift's compact protocol, of which the second and third field are the sizes of the page.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO, Any

_UNCOMPRESSED, _COMPRESSED = 2, 3
_BOOLEANS, _BYTE, _DOUBLE, _BINARY, _LISTS, _STRUCT = (1, 2), 3, 7, 8, (9, 10), 12
_INTEGERS = (4, 5, 6)
_HEADER, _MOST_HEADER = 512, 2**20
_DEEPEST = 8


def page_sizes(file: IO[bytes], column: Any) -> Iterator[tuple[int, int]]:
    """Yield the sizes that a column chunk's pages announce, uncompressed and compressed, as far as their headers can be read.

    Parameters
    ----------
    file : binary file
        Opened.
    column : pyarrow.parquet.ColumnChunkMetaData
        Where the chunk lies.
    """
    at = column.data_page_offset
    if column.has_dictionary_page and 0 < column.dictionary_page_offset < at:
        at = column.dictionary_page_offset
    end = at + column.total_compressed_size
    while 0 <= at < end:
        found = _header(file, at)
        if found is None:
            return
        length, uncompressed, compressed = found
        yield uncompressed, compressed
        at += length + compressed


def _header(file: IO[bytes], at: int) -> tuple[int, int, int] | None:
    """Return how long a page's header is, and the sizes in it; None where there is none."""
    size = _HEADER
    while size <= _MOST_HEADER:
        file.seek(at)
        raw = file.read(size)
        reader = _Compact(raw)
        try:
            sizes = reader.struct(0)
        except IndexError:  # its statistics may be long
            if len(raw) < size:
                return None
            size *= 16
            continue
        except ValueError:
            return None
        uncompressed, compressed = sizes.get(_UNCOMPRESSED, -1), sizes.get(_COMPRESSED, -1)
        return (reader.at, uncompressed, compressed) if min(uncompressed, compressed) >= 0 else None
    return None


class _Compact:
    """Reads a structure in Thrift's compact protocol, of which only the integers are kept.

    Raises IndexError where it goes on behind the end, ValueError where it is none.
    """

    def __init__(self, raw: bytes) -> None:
        self.raw, self.at = raw, 0

    def struct(self, depth: int) -> dict[int, int]:
        """Return the integers of a structure by the number of their field."""
        found: dict[int, int] = {}
        field = 0
        while head := self._byte():
            step, kind = head >> 4, head & 15
            field = field + step if step else self._integer()
            if kind in _INTEGERS:
                found[field] = self._integer()
            elif kind not in _BOOLEANS:  # these are all told by their kind
                self._skip(kind, depth)
        return found

    def _skip(self, kind: int, depth: int) -> None:
        if kind in _INTEGERS:
            self._varint()
        elif kind == _BYTE or kind in _BOOLEANS:
            self.at += 1
        elif kind == _DOUBLE:
            self.at += 8
        elif kind == _BINARY:
            length = self._varint()
            self.at += length
        elif kind == _STRUCT and depth < _DEEPEST:
            self.struct(depth + 1)
        elif kind in _LISTS and depth < _DEEPEST:
            head = self._byte()
            for _ in range(self._varint() if head >> 4 == 15 else head >> 4):
                self._skip(head & 15, depth + 1)
        else:
            raise ValueError("no header of a page")

    def _byte(self) -> int:
        self.at += 1
        return self.raw[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
            if shift > 63:
                raise ValueError("no number of 64 bits")

    def _integer(self) -> int:
        value = self._varint()
        return (value >> 1) ^ -(value & 1)
