"""The row of an SQLite file that ends within it.

SQLite fills up with zeros what is missing of a file's last page, and takes a row whose end was there for a whole one: the last
numbers of a message would read 0. Rows are put into a page from its end, so that at most one of them lies across the cut; those
beyond it have no columns any more, and are no messages.
(SQLite, "Database File Format", sections 1.3, 1.5 and 1.6.)
"""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path


class PageType(IntEnum):
    """What a page's first byte says; what did not fit into a row goes on in a page that begins with another page's number."""

    OVERFLOW, TABLE_LEAF = 0, 13


def page_size(head: bytes) -> int:
    """Return how large a database's pages are by its header, where 2¹⁶ stands as 1; 0 where the header is cut off."""
    return (head[16] << 8 | head[17] << 16) if len(head) > 17 else 0


def cut_row(path: Path) -> int | None:
    """Return the number of the row across which a file was cut off; −1 for a part of a row that says nothing of its number.

    None where the file ends with a page, or there is no such row.
    """
    with path.open("rb") as file:
        head = file.read(100)
        page = page_size(head)
        there = path.stat().st_size % page if page >= 512 else 0
        if len(head) < 100 or not there or path.stat().st_size < page:
            return None
        file.seek(-there, 2)
        rest = file.read(there)
    if rest[0] == PageType.OVERFLOW:
        return -1
    return _across(rest, page - head[20]) if rest[0] == PageType.TABLE_LEAF else None


def _across(rest: bytes, usable: int) -> int | None:
    """Return the number of the row of a leaf that begins in what is there of it and ends behind."""
    for i in range(int.from_bytes(rest[3:5], "big")):
        start = int.from_bytes(rest[8 + 2 * i : 10 + 2 * i], "big")
        size, after = _varint(rest, start)
        row, after = _varint(rest, after)
        if start < len(rest) < after + _within(size, usable):
            return row
    return None


def _within(size: int, usable: int) -> int:
    """Return how many bytes of a row of some size are in its page, with the number of the page where it goes on."""
    if size <= usable - 35:
        return size
    least = (usable - 12) * 32 // 255 - 23
    local = least + (size - least) % (usable - 4)
    return (local if local <= usable - 35 else least) + 4


def _varint(rest: bytes, at: int) -> tuple[int, int]:
    """Return a number of seven bits per byte, and where it ends."""
    value = 0
    for place in range(9):
        byte = rest[at + place] if at + place < len(rest) else 0
        if place == 8:
            return value << 8 | byte, at + 9
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at + place + 1
    return value, at + 9
