"""Whether an SQLite file and its log of changes (FILE-wal) are all there, as far as they tell themselves.

SQLite passes over both in silence: of a file that was cut off within its last page it reads what is there, and of a log it
takes what comes ahead of the first frame that does not match its checksum, as if a program had been killed there.
(SQLite, "Database File Format", sections 1.3 and 4.)
"""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.readers.sqlite_cut import page_size


class Log(IntEnum):
    """How a log of changes is laid out."""

    MAGIC = 0x377F0682  # or one more where sums are of numbers with their most significant byte first
    HEAD, FRAME_HEAD = 8, 6  # words of four bytes


_Words = NDArray[np.uint32]


def missing_bytes(path: Path) -> list[Finding]:
    """Return how much of a database is missing by what its header says; nothing where it is whole."""
    with path.open("rb") as file:
        head = file.read(100)
        size = file.seek(0, 2)
    page = page_size(head)
    if len(head) < 100 or page < 512:
        return []
    # How many pages there are is only told where the counters of changes agree.
    pages = int.from_bytes(head[28:32], "big") if head[24:28] == head[92:96] else 0
    if size >= page * pages and size % page == 0:
        return []
    whole = max(page * pages, -(-size // page) * page)
    return [Finding(code="recording.database_truncated", value=whole - size, limit=whole, unit="B")]


def damaged_changes(log: Path) -> list[Finding]:
    """Return how much of a log of changes is lost behind damage; nothing where it is sound."""
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
    """Return how many frames up to the last that ends a change come behind one that does not match its sum; −1 for the head.

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
