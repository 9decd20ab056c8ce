"""The SQLite files of ROS 2 bags, past pages that cannot be read."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.printable import printable
from vsalog.core.resolution import STRETCHES
from vsalog.readers.container import MOST_CONNECTIONS, Connection, Part
from vsalog.readers.limits import BLOCK_ROWS, FIRST_ROWS, GLANCE_BYTES, PACKED_BYTES, SAMPLE_ROWS
from vsalog.readers.packets import Messages, Packet
from vsalog.readers.sampling_pieces import Sample
from vsalog.readers.sqlite_damage import cut_row, damaged_changes, missing_bytes
from vsalog.readers.sqlite_opened import connect, left_log
from vsalog.readers.sqlite_ranges import bounded, most_steps, ranges

SQLITE_MAGIC = b"SQLite format 3\0"

# The module decodes SQLite's own messages, in which there may be damaged text.
_DAMAGE = (sqlite3.DatabaseError, UnicodeDecodeError)
_LANGUAGES = {"ros2msg": "msg", "ros2idl": "idl"}
_COLUMNS = {"topic_id", "timestamp", "data"}


_Rows = tuple[tuple[Any, ...], tuple[int, ...], tuple[bytes, ...]]
"""Topics, times and messages."""


class SqliteContainer:
    """One SQLite file of a ROS 2 bag; see `vsalog.readers.container.Container`.

    Raises
    ------
    ReadError
        The file cannot be opened or contains no bag.
    """

    format = "rosbag2-sqlite3"
    has_publish = False
    rig_text: str | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.findings = Findings()
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._part: Part | None = None
        self._stretches: list[tuple[int, int]] = []  # of rows that are read, where that is a sample
        self._cut = cut_row(self.path)
        self._database = self._connect()
        self._note_lack()

    def connections(self) -> list[Connection]:
        """Return the bag's topics."""
        definitions = self._definitions()
        found = []
        for number, *texts in self._topics():
            topic, kind, encoding = (text if isinstance(text, str) else "" for text in texts)
            if not all((topic, kind, encoding)):
                part = printable(topic) or "unnamed"
                self.findings.add(Finding(code="recording.topic_damaged", part=part, value=number))
            language, text = definitions.get(kind, ("", ""))
            found.append(
                Connection(number, topic or f"topic {number}", kind, encoding, language, text, publisher=str(number))
            )
        return found

    def counts(self) -> Mapping[int, int]:
        """Return how many rows there are in all: no topic has more, and to count those of each would take long."""
        first, last = self._ends()
        if self._stretches or last < first:
            return {}
        return {number: max(last - first + 1, FIRST_ROWS) for number, *_ in self._topics()}

    def size(self) -> int:
        """Return how many bytes the file has."""
        return self.path.stat().st_size

    def narrow(self, part: Part) -> bool:
        """Skip rows outside of a part of the log."""
        self._part = part
        return True

    def beginnings(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield nothing: SQLite files have no index of the first message of each topic."""
        yield from ()

    def sample(self, budget: int) -> Sample | None:
        """From now on read stretches of rows; of a damaged file, or one without rows, all."""
        first, last = self._ends()
        if last < first:
            return None
        share = max(budget // STRETCHES * (last - first + 1) // self.size(), 1)
        begins = np.linspace(first, max(last + 1 - share, first), STRETCHES).astype(np.int64).tolist()
        self._stretches = [(begin, begin + share - 1) for begin in begins]
        return Sample(budget, STRETCHES)

    def glimpses(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield some rows from all over the file, no images or maps; where rows cannot be read, none."""
        data = f"CASE WHEN length(data) < {GLANCE_BYTES} THEN data END"
        query = f"SELECT topic_id, timestamp, {data} FROM messages WHERE rowid >= ? ORDER BY rowid LIMIT 32"
        try:
            first, last = self._ends()
            for row in np.linspace(first, max(last - 31, first), SAMPLE_ROWS).astype(np.int64).tolist():
                rows = [r for r in self._database.execute(query, (row,)) if r[0] in ids and type(r[2]) is bytes]
                if rows and all(type(time) is int for _, time, _ in rows):
                    yield _packet(*map(list, zip(*rows, strict=True)))
        except _DAMAGE:
            return

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some topics in the order of the file; unreadable rows are skipped and reported.

        Raises
        ------
        ReadError
            Another program has locked the file.
        """
        if not ids:
            return
        wanted = np.array(sorted(ids), dtype=np.int64)
        strangers = 0
        for packet in self._all(ids):
            known = np.isin(packet.connection, wanted)
            if known.all():
                yield packet
                continue
            rows = np.flatnonzero(known)
            strangers += known.size - rows.size
            if rows.size:
                yield packet.some(rows)
        if strangers:
            self.findings.add(Finding(code="recording.unknown_topics", value=strangers))

    def _all(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield packets of the requested rows: by ranges as far as all is sound, then row by row."""
        within = self._within()
        for first, last in within or [self._numbered()]:
            only, done = self._only(ids), -1
            for end, packet in ranges(self._database, first, last, only):
                done = end
                yield packet
            if within:
                only += f" AND rowid BETWEEN {first} AND {last}"
            with bounded(self._database, most_steps(self.size())):
                yield from _together(self._rows(only, first, done))

    def _rows(self, only: str, first: int, start: int) -> Iterator[_Rows]:
        """Yield rows, some at a time, but one at a time once there was an error, which would lose those that came with it.

        Parameters
        ----------
        only : str
            The condition that chooses them.
        first, start : int
            From the first row to `start` all was read; -1 where nothing was.
        """
        query = f"SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ? {only} ORDER BY rowid"
        last, lost, stretch, last_row = start, 0, 0, np.iinfo(np.int64).max
        count = 0 if start < 0 else start - first + 1
        nonsense, at_once = 0, FIRST_ROWS
        most = self.size()  # more rows than bytes come only of pages that are there several times
        while start < last_row and count < most:
            try:
                cursor = self._database.execute(query, (start,))
                while count < most and (rows := list(islice(cursor, at_once))):
                    first = first if count else rows[0][0]
                    count += len(rows)
                    numbers, topics, times, messages = zip(*rows, strict=True)
                    if set(map(type, messages)) != {bytes} or set(map(type, topics + times)) != {int}:
                        good = [row for row in rows if tuple(map(type, row[1:])) == (int, int, bytes)]
                        nonsense += len(rows) - len(good)
                        if not good:
                            continue
                        numbers, topics, times, messages = zip(*good, strict=True)
                    # Damaged row numbers may be anything; those of the following rows show the position again.
                    last = numbers[-1]
                    at_once = 1 if at_once == 1 else _at_once(messages)
                    yield topics, times, messages
                break
            except _DAMAGE as error:
                self._refuse(error)
                if _code(error) == sqlite3.SQLITE_INTERRUPT:
                    count = most
                elif at_once > 1:
                    start, at_once = last, 1
                elif last > start:
                    start, stretch = last, 0
                else:
                    step = 1 + stretch // FIRST_ROWS
                    start, lost, stretch = start + step, lost + step, stretch + step
        if nonsense:
            self.findings.add(Finding(code="recording.rows_without_message", value=nonsense))
        if count >= most:
            self.findings.add(Finding(code="recording.database_repeats"))
        elif start >= last_row:
            self.findings.add(Finding(code="recording.database_end_unreadable"))
        elif lost:
            self.findings.add(Finding(code="recording.rows_unreadable", value=lost))
        elif not only and last - first + 1 > count:
            self.findings.add(Finding(code="recording.row_numbers_missing", value=last - first + 1 - count))

    def _ends(self) -> tuple[int, int]:
        """Return the first and the last row number; 0 and -1 where they are unknown."""
        query = "SELECT {}(rowid) FROM messages"  # of both in one, all rows would be looked at
        try:
            first, last = (self._database.execute(query.format(which)).fetchone()[0] for which in ("min", "max"))
            return int(first or 0), int(last or 0)
        except (*_DAMAGE, TypeError, ValueError):
            return 0, -1

    def _numbered(self) -> tuple[int, int]:
        """Return the first and the last row; none where they are not numbered as recorders do: their ends are not sure."""
        first, last = self._ends()
        return (first, last) if first in (0, 1) else (0, -1)

    def _only(self, ids: Collection[int]) -> str:
        """Return the condition that chooses topics and times; no topics where all are wanted: unknown ones must be reported.

        A row across the end of a truncated file is none.
        """
        when = "" if self._cut is None else f"AND rowid <> {self._cut if self._cut >= 0 else self._ends()[1]}"
        if self._part is not None:
            times = f"timestamp BETWEEN {self._part.low} AND {self._part.high}"
            when += f" AND ({times} OR topic_id IN ({_listed(self._part.throughout)}))"
        if set(ids) >= {number for number, *_ in self._topics()}:
            return when
        return f"AND topic_id IN ({_listed(ids)}) {when}"

    def _within(self) -> list[tuple[int, int]]:
        """Return the first and the last row of stretches that are read; none for all rows."""
        part = self._part
        if part is None or part.throughout:
            return self._stretches
        query = f"SELECT min(rowid), max(rowid) FROM messages WHERE timestamp BETWEEN {part.low} AND {part.high}"
        try:
            plan = self._database.execute(f"EXPLAIN QUERY PLAN {query}").fetchall()
            if not any("INDEX" in str(step[-1]) for step in plan):
                return []
            with bounded(self._database, most_steps(self.size())):
                first, last = self._database.execute(query).fetchone()
        except _DAMAGE:
            return []
        return [(int(first or 0), int(last or 0))]

    def _refuse(self, error: Exception) -> None:
        """Raise ReadError where another try would fail the same way."""
        code = _code(error)
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            raise ReadError("is locked by a program that writes it; try again later", self.path) from error
        if code == sqlite3.SQLITE_ERROR:
            raise ReadError(f"the table of messages cannot be read: {error}", self.path) from error

    def _note_lack(self) -> None:
        """Record what is missing of the file and of its write-ahead log, which may contain pages that the file lacks."""
        try:
            log = left_log(self.path)
            self.findings.add(*(damaged_changes(log) if log else missing_bytes(self.path)))
        except OSError:
            return  # it was opened as a copy

    def _connect(self) -> sqlite3.Connection:
        try:
            return self._checked(self.path)
        except sqlite3.OperationalError:
            # A database that a program is writing may need a writable folder even to be read: read a copy.
            self._folder = tempfile.TemporaryDirectory(prefix="vsalog-")
            copy = Path(self._folder.name) / "bag.db3"
            shutil.copyfile(self.path, copy)
            log = self.path.with_name(self.path.name + "-wal")
            if log.is_file():
                shutil.copyfile(log, copy.with_name(copy.name + "-wal"))
        try:
            return self._checked(copy)
        except _DAMAGE as error:
            raise ReadError(f"the database cannot be read: {error}", self.path) from error

    def _checked(self, path: Path) -> sqlite3.Connection:
        """Open a database for reading only and check that it contains a bag."""
        database = connect(path)
        database.text_factory = lambda raw: raw.decode("utf-8", "replace")
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, AT_ONCE_BYTES)
        try:
            columns = self._columns(database)
        except sqlite3.OperationalError:
            database.close()
            raise
        except _DAMAGE as error:
            database.close()
            raise ReadError(f"the database is damaged: {error}", self.path) from error
        if not columns >= _COLUMNS:
            database.close()
            raise ReadError("is an SQLite database, but no ROS 2 bag (no tables 'topics' and 'messages')", self.path)
        return database

    def _columns(self, database: sqlite3.Connection) -> set[str]:
        """Return the columns of the messages, none where the tables are not those of a bag."""
        try:
            tables = _tables(database)
        except sqlite3.OperationalError:
            raise
        except _DAMAGE:
            # With this, SQLite also opens files that are shorter than they should be, and ignores tables it cannot understand.
            database.execute("PRAGMA writable_schema = ON")
            tables = _tables(database)
            self.findings.add(Finding(code="recording.database_damaged"))
        if not tables >= {"messages", "topics"}:
            return set()
        return {str(row[1]) for row in database.execute("PRAGMA table_info(messages)")}

    def _topics(self) -> list[tuple[int, Any, Any, Any]]:
        """Return number, name, type and encoding of the topics."""
        query = "SELECT id, name, type, serialization_format FROM topics"
        try:
            rows = self._database.execute(query).fetchmany(MOST_CONNECTIONS + 1)
        except _DAMAGE as error:
            raise ReadError(f"the table of topics cannot be read: {error}", self.path) from error
        if len(rows) > MOST_CONNECTIONS:
            raise ReadError(f"has more than {MOST_CONNECTIONS} topics; no such bag is read", self.path)
        return [row for row in rows if isinstance(row[0], int)]

    def _definitions(self) -> dict[str, tuple[str, str]]:
        """Return language and text of the message definitions by type; bags of before 2023 have none."""
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        try:
            rows = self._database.execute(query).fetchmany(MOST_CONNECTIONS)
        except _DAMAGE:
            return {}
        return {str(kind): (_LANGUAGES.get(str(encoding), ""), str(text)) for kind, encoding, text in rows}


def _code(error: Exception) -> int:
    """Return SQLite's code of an error, 0 where it has none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _listed(ids: Collection[int]) -> str:
    return ",".join(str(int(number)) for number in ids)


def _at_once(messages: Sequence[bytes]) -> int:
    """Return how many rows to read at once, of the size of those that were: there may be images among them."""
    size = sum(map(len, messages)) // len(messages)
    return max(2, min(FIRST_ROWS, PACKED_BYTES // (size + 1)))


def _tables(database: sqlite3.Connection) -> set[str]:
    return {row[0] for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}


def _together(rows: Iterator[_Rows]) -> Iterator[Packet]:
    """Yield packets of rows that come some at a time."""
    connection: list[int] = []
    log: list[int] = []
    content: list[bytes] = []
    size = 0
    for topics, times, messages in rows:
        connection += topics
        log += times
        content += messages
        size += sum(map(len, messages))
        if len(content) >= BLOCK_ROWS or size >= PACKED_BYTES:
            yield _packet(connection, log, content)
            connection, log, content, size = [], [], [], 0
    if content:
        yield _packet(connection, log, content)


def _packet(connection: list[int], log: list[int], content: list[bytes]) -> Packet:
    zeros = np.zeros(len(log), dtype=np.int64)
    return Packet(np.array(connection, dtype=np.int64), np.array(log, dtype=np.int64), zeros, Messages.of(content))
