"""What the footer of a Parquet file says of its row groups and columns.

Arrow knows it too, but its Python part ends the whole process where a footer contradicts itself.
"""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

from vsalog.readers.thrift import Compact, Fields, integer, structure, structures


class FileMetaData(IntEnum):
    """Fields (parquet.thrift)."""

    ROW_GROUPS = 4


class RowGroup(IntEnum):
    """Fields (parquet.thrift)."""

    COLUMNS = 1
    ROWS = 3


class ColumnChunk(IntEnum):
    """Fields (parquet.thrift)."""

    META_DATA = 3


class ColumnMetaData(IntEnum):
    """Fields (parquet.thrift)."""

    PATH = 3
    VALUES, UNCOMPRESSED, COMPRESSED = range(5, 8)
    DATA_PAGE = 9
    DICTIONARY_PAGE, STATISTICS = range(11, 13)


class Statistics(IntEnum):
    """Fields (parquet.thrift)."""

    NULLS = 3


class Chunk(NamedTuple):
    """A column of a row group: where it lies, its sizes [bytes], its values, and how many of them are null; -1 where not said."""

    path: str
    begin: int
    compressed: int
    uncompressed: int
    values: int
    nulls: int


class Group(NamedTuple):
    """A row group."""

    rows: int
    chunks: list[Chunk]


def row_groups(path: Path) -> list[Group]:
    """Return the row groups of a Parquet file.

    Raises
    ------
    OSError
        It cannot be read, or has no footer.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - 8, 0))
        length = int.from_bytes(file.read(4), "little")
        file.seek(max(size - 8 - length, 0))
        raw = file.read(length)
    try:
        footer = Compact(raw).struct()
    except (IndexError, ValueError) as error:
        raise OSError("its footer, which tells where everything lies, is damaged") from error
    return [
        Group(
            integer(group, RowGroup.ROWS, 0),
            [_chunk(structure(one, ColumnChunk.META_DATA)) for one in structures(group, RowGroup.COLUMNS)],
        )
        for group in structures(footer, FileMetaData.ROW_GROUPS)
    ]


def footer_trouble(path: Path) -> str:
    """Return in words what is wrong with the footer of a file that Arrow does not open, "" where nothing is seen to be."""
    try:
        with path.open("rb") as file:
            file.seek(max(file.seek(0, 2) - 4, 0))
            end = file.read(4)
        if end == b"PARE":
            return "it is encrypted"
        if end != b"PAR1":
            return "it ends without its footer, which tells where everything lies, as when it is cut off or was never closed"
        row_groups(path)
    except OSError as error:
        return str(error)
    return ""


def _chunk(fields: Fields) -> Chunk:
    names = fields.get(ColumnMetaData.PATH)
    parts = names if isinstance(names, list) else []
    path = ".".join(name.decode("utf-8", "replace") for name in parts if isinstance(name, bytes))
    data, dictionary = integer(fields, ColumnMetaData.DATA_PAGE), integer(fields, ColumnMetaData.DICTIONARY_PAGE)
    begin = dictionary if 0 < dictionary < data else data
    sizes = (
        integer(fields, ColumnMetaData.COMPRESSED),
        integer(fields, ColumnMetaData.UNCOMPRESSED),
        integer(fields, ColumnMetaData.VALUES),
    )
    return Chunk(path, begin, *sizes, integer(structure(fields, ColumnMetaData.STATISTICS), Statistics.NULLS))
