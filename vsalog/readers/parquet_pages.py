"""What the pages of a Parquet column announce: Arrow makes room for it, whatever the footer says of the column.

The header of a page is a structure in Thrift's compact protocol, of which the second and third field are the sizes of the page.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import IO, NamedTuple

from vsalog.core.memory import AT_ONCE_BYTES, PIECE_BYTES
from vsalog.readers.compression import MAX_RATIO
from vsalog.readers.limits import GLANCE_BYTES
from vsalog.readers.parquet_footer import Chunk
from vsalog.readers.thrift import Compact, Fields, integer, structure


class PageHeader(IntEnum):
    """Fields (parquet.thrift)."""

    TYPE, UNCOMPRESSED, COMPRESSED = range(1, 4)


class DataPageHeader(IntEnum):
    """Fields of either version (parquet.thrift)."""

    VALUES = 1


_OF_DATA = {0: 5, 3: 8}
"""Which field of a header is that of a page of data, by the type of the page; its first field is the number of values."""


class Page(NamedTuple):
    """What a page's header says: its size, compressed and not [bytes], and how many values of the column it holds."""

    uncompressed: int
    compressed: int
    values: int


def trouble_with_pages(file: IO[bytes], chunk: Chunk) -> str | None:
    """Return what is wrong with the headers of a column's pages in a row group, None where nothing is.

    Pages have checksums, their headers have none: where a page is no longer taken for one, the values behind it would move up.

    Parameters
    ----------
    file : binary file
        Opened.
    chunk : Chunk
        What the footer says of it.
    """
    values = 0
    for page in pages(file, chunk):
        if page.uncompressed > max(AT_ONCE_BYTES, MAX_RATIO * page.compressed):
            return f"a page of it announces {page.uncompressed} bytes out of {page.compressed}"
        values += page.values
    return None if values == chunk.values else f"its pages hold {values} of {chunk.values} values"


def pages(file: IO[bytes], chunk: Chunk) -> Iterator[Page]:
    """Yield what a column's pages in a row group announce, as far as their headers can be read."""
    at, end = chunk.begin, chunk.begin + chunk.compressed
    while 0 <= at < end:
        found = _header(file, at)
        if found is None:
            return
        length, page = found
        yield page
        at += length + page.compressed


def _header(file: IO[bytes], at: int) -> tuple[int, Page] | None:
    """Return how long a page's header is, and what it says; None where there is none."""
    size = GLANCE_BYTES
    while size <= PIECE_BYTES:
        file.seek(at)
        raw = file.read(size)
        reader = Compact(raw)
        try:
            page = _page(reader.struct())
        except IndexError:  # its statistics may be long
            if len(raw) < size:
                return None
            size *= 16
            continue
        except ValueError:
            return None
        return reader.at, page
    return None


def _page(header: Fields) -> Page:
    """Return what the header of a page says.

    Raises
    ------
    ValueError
        It is no header of a page.
    """
    uncompressed, compressed = integer(header, PageHeader.UNCOMPRESSED), integer(header, PageHeader.COMPRESSED)
    values = integer(structure(header, _OF_DATA.get(integer(header, PageHeader.TYPE), -1)), DataPageHeader.VALUES, 0)
    if min(uncompressed, compressed, values) < 0:
        raise ValueError("no header of a page")
    return Page(uncompressed, compressed, values)
