"""The missing parts of an SQLite file and its write-ahead log (FILE-wal), as far as these show them.

SQLite ignores all of this silently. Of a file that was truncated within its last page it reads the existing part, fills the
rest with zeros, and takes a truncated row for a whole one: the last numbers of a message would read 0. Rows are put
into a page from its end, so that at most one of them is across the cut; those beyond it have no columns any more, and are no
messages. Of a log it takes the frames before the first that does not match its checksum, as if a program had been killed
there. (SQLite, "Database File Format", sections 1.3, 1.5, 1.6 and 4.)
"""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.memory import AT_ONCE_BYTES


class PageType(IntEnum):
    """The first byte of pages; the rest of a long row is in a page that begins with another page's number."""

    OVERFLOW, TABLE_LEAF = 0, 13


def _head(path: Path) -> tuple[bytes, int, int]:
    """Return the header of a database, how large its pages are by it, 0 where it is none, and the file's size."""
    with path.open("rb") as file:
        head = file.read(100)
    # 2¹⁶ is stored as 1.
    page = head[16] << 8 | head[17] << 16 if len(head) == 100 else 0
    return head, page if page >= 512 else 0, path.stat().st_size


def cut_row(path: Path) -> int | None:
    """Return the number of the row across which a file was truncated; −1 for a part of a row without its number.

    None where the file ends with a page, or there is no such row.
    """
    head, page, size = _head(path)
    if not page or size < page or size % page == 0:
        return None
    with path.open("rb") as file:
        file.seek(size - size % page)
        rest = file.read()
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


class Log(IntEnum):
    """The layout of a write-ahead log."""

    MAGIC = 0x377F0682  # or one more where sums are of numbers with their most significant byte first
    HEAD, FRAME_HEAD = 8, 6  # words of four bytes


_Words = NDArray[np.uint32]


def missing_bytes(path: Path) -> list[Finding]:
    """Return how much of a database is missing by its header; nothing where it is whole."""
    head, page, size = _head(path)
    if not page:
        return []
    # The number of pages is only valid where the change counters agree.
    pages = int.from_bytes(head[28:32], "big") if head[24:28] == head[92:96] else 0
    if size >= page * pages and size % page == 0:
        return []
    whole = max(page * pages, -(-size // page) * page)
    return [Finding(code="recording.database_truncated", value=whole - size, limit=whole, unit="B")]


def damaged_changes(log: Path) -> list[Finding]:
    """Return how much of a write-ahead log is lost after damage; nothing where it is sound."""
    data = np.fromfile(log, np.uint8, AT_ONCE_BYTES)
    data = data[: data.size // 4 * 4]
    big: _Words = data.view(">u4").astype(np.uint32)
    if big.size <= Log.HEAD:
        return []
    summed: _Words = big if big[0] & 1 else data.view("<u4").astype(np.uint32)
    lost = -1
    if int(big[0]) & ~1 == Log.MAGIC:
        lost = int(_lost_frames(summed, big, Log.FRAME_HEAD + int(big[2]) // 4))
    if lost < 0:
        return [Finding(code="recording.changes_unreadable", part=log.name)]
    return [Finding(code="recording.changes_damaged", part=log.name, value=lost)] if lost else []


@njit(cache=True, nogil=True)
def _lost_frames(summed: _Words, big: _Words, frame: int) -> int:
    """Return how many frames up to the last commit come after one that does not match its checksum; −1 for the head.

    Frames of a former round, which remain behind those of the last one, have other salts than the head.
    """
    first, second = _sum(summed, 0, 6, 0, 0)
    if first != big[6] or second != big[7]:
        return -1
    sound, behind, lost = True, 0, 0
    for at in range(Log.HEAD, big.size - frame + 1, frame):
        own = big[at + 2] == big[4] and big[at + 3] == big[5]
        if sound:
            first, second = _sum(summed, at, at + 2, first, second)
            first, second = _sum(summed, at + Log.FRAME_HEAD, at + frame, first, second)
            sound = own and first == big[at + 4] and second == big[at + 5]
        if own and not sound:
            behind += 1
            if big[at + 1]:
                lost = behind
    return lost


@njit(cache=True, nogil=True)
def _sum(words: _Words, begin: int, end: int, first: int, second: int) -> tuple[int, int]:
    for k in range(begin, end, 2):
        first = (first + int(words[k]) + second) & 0xFFFFFFFF
        second = (second + int(words[k + 1]) + first) & 0xFFFFFFFF
    return first, second
