"""What the footer of a Parquet file says of its row groups and columns.

Arrow knows it too, but its Python part ends the whole process where a footer contradicts itself.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from vsalog.readers.thrift import Compact, Fields, integer, structure, structures

_GROUPS = 4
_CHUNKS, _GROUP_ROWS = 1, 3
_CHUNK = 3
_PATH, _VALUES, _UNCOMPRESSED, _COMPRESSED, _DATA, _DICTIONARY, _STATISTICS = 3, 5, 6, 7, 9, 11, 12
_NULLS = 3


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
        Group(integer(group, _GROUP_ROWS, 0), [_chunk(structure(one, _CHUNK)) for one in structures(group, _CHUNKS)])
        for group in structures(footer, _GROUPS)
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
    names = fields.get(_PATH)
    path = ".".join(name.decode("utf-8", "replace") for name in names or () if isinstance(name, bytes))
    data, dictionary = integer(fields, _DATA), integer(fields, _DICTIONARY)
    begin = dictionary if 0 < dictionary < data else data
    sizes = (integer(fields, _COMPRESSED), integer(fields, _UNCOMPRESSED), integer(fields, _VALUES))
    return Chunk(path, begin, *sizes, integer(structure(fields, _STATISTICS), _NULLS))
