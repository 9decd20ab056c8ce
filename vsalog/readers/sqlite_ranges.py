"""Rows of an SQLite bag by the thousand: SQL concatenates them, so that Python makes no object for any of them."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

import numpy as np
from numba import njit

from vsalog.readers.limits import BLOCK_ROWS, FIRST_ROWS, MOST_STEPS, PACKED_BYTES
from vsalog.readers.packets import Bytes, Integers, Messages, Packet

STEPS_PER_ROW = 1000
"""Steps in which SQLite reads a row: it takes some thirty."""

# In SQLite's order numbers come before texts, texts before blobs. What is of another type has no length here, so that lengths
# are missing or do not fit. Aggregates see rows as they are stored, in the order of their numbers, without an index.
_LENGTH = "CASE WHEN data >= x'' AND timestamp < '' AND topic_id < '' THEN length(data) END"
_PARTS = ", ".join(f"CAST(group_concat({part}) AS BLOB)" for part in ("data, ''", _LENGTH, "topic_id", "timestamp"))
_RANGE = "FROM messages NOT INDEXED WHERE rowid BETWEEN ?1 AND ?2"


def ranges(database: sqlite3.Connection, first: int, last: int, only: str) -> Iterator[tuple[int, Packet]]:
    """Yield the messages of rows without gaps, some rows at a time, and the number of the last of these rows.

    Ends silently where rows are missing, cannot be read, are no messages or are too large: these are then read one
    by one.

    Parameters
    ----------
    database : connection
        Open, of a bag.
    first, last : int
        Row numbers.
    only : str
        A condition on rows, which begins with "AND"; "" for all rows.
    """
    all_rows = f"(SELECT count(*) {_RANGE})" if only else "count(*)"
    query = f"SELECT {all_rows}, count(*), {_PARTS} {_RANGE} {only}"
    rows = FIRST_ROWS
    while first <= last:
        end = min(first + rows, last + 1) - 1
        try:
            there, chosen, *parts = _asked(database, query, first, end)
        except sqlite3.DataError:  # larger together than they may be
            if rows == 1:
                return
            rows = max(1, rows // 8)
            continue
        except sqlite3.Error:
            return
        packet = _packet(*(part or b"" for part in parts))
        if packet is None or len(packet.messages) != chosen or there != end - first + 1:
            return
        yield end, packet
        mean = packet.messages.data.size // max(1, len(packet.messages))
        first, rows = end + 1, max(1, min(BLOCK_ROWS, PACKED_BYTES // (mean + 1)))


def _asked(database: sqlite3.Connection, query: str, first: int, end: int) -> tuple[Any, ...]:
    """Return the result of a query for a range of rows, within bounds of size and time."""
    usual = database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 2 * PACKED_BYTES)
    try:
        with bounded(database, STEPS_PER_ROW * (end - first + 1)):
            found: tuple[Any, ...] = database.execute(query, (first, end)).fetchone()
            return found
    finally:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, usual)


def most_steps(size: int) -> int:
    """Return in how many steps SQLite reads a file of this size [bytes]: a row has thirty, with its place in an index."""
    return STEPS_PER_ROW * size // 30


@contextmanager
def bounded(database: sqlite3.Connection, steps: int) -> Iterator[None]:
    """Let a query fail that takes many more steps than expected: pages that contain others several times may seem endless."""
    every = min(steps, MOST_STEPS)
    calls = count()  # the first may come early: SQLite counts on from the last time that the query ran
    database.set_progress_handler(lambda: next(calls) >= steps // every, every)
    try:
        yield
    finally:
        database.set_progress_handler(None, 0)


def _packet(content: bytes, lengths: bytes, topics: bytes, times: bytes) -> Packet | None:
    """Return the messages whose parts these are; None where the parts do not fit together."""
    data = np.frombuffer(content, np.uint8)
    length, topic, time = (_numbers(np.frombuffer(text, np.uint8)) for text in (lengths, topics, times))
    if not length.size == topic.size == time.size or length.sum() != data.size:
        return None
    return Packet(topic, time, np.zeros(time.size, np.int64), Messages(data, np.cumsum(length) - length, length))


@njit(cache=True, nogil=True)
def _numbers(text: Bytes) -> Integers:
    """Return whole numbers of at most 64 bits separated by commas, up to the first invalid one."""
    out = np.empty(text.size // 2 + 1, dtype=np.int64)
    count, at = 0, 0
    while at < text.size:
        negative = text[at] == 45  # "-"
        at += negative
        begin, number = at, np.int64(0)
        while at < text.size and 48 <= text[at] <= 57:
            number = number * 10 + np.int64(text[at] - 48)
            at += 1
        if at == begin or (at < text.size and text[at] != 44):
            break
        out[count] = -number if negative else number
        count += 1
        at += 1
    return out[:count].copy()
