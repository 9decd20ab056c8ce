"""ROS 2 bags: SQLite files, and folders of SQLite or MCAP files."""

from __future__ import annotations

import re
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from vsalog.errors import ReadError
from vsalog.readers.bag import ZSTD_MAGIC, Connection, Container
from vsalog.readers.base import plural
from vsalog.readers.mcap_file import McapContainer
from vsalog.readers.mcap_walk import MAGIC as MCAP_MAGIC
from vsalog.readers.packets import Packet, RawMessage, packed

SQLITE_MAGIC = b"SQLite format 3\0"
METADATA = "metadata.yaml"

_LANGUAGES = {"ros2msg": "msg", "ros2idl": "idl"}
_LOG_ENDINGS = (".bag", ".csv", ".tsv", ".parquet", ".mat", ".mcap", ".db3")
_IDS_PER_FILE = 2**32
_MAX_BAD_ROWS = 100_000
_ROWS = 4096


class SqliteContainer:
    """One SQLite file of a ROS 2 bag; see `vsalog.readers.bag.Container`.

    Raises
    ------
    ReadError
        The file cannot be opened or holds no bag.
    """

    format = "rosbag2-sqlite3"
    has_publish = False
    rig_text: str | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._database = self._connect()

    def connections(self) -> list[Connection]:
        """Return the bag's topics."""
        definitions = self._definitions()
        found = []
        for number, topic, kind, encoding in self._rows("SELECT id, name, type, serialization_format FROM topics"):
            language, text = definitions.get(str(kind), ("", ""))
            found.append(Connection(int(number), str(topic), str(kind), str(encoding), language, text))
        return found

    def counts(self) -> Mapping[int, int]:
        """Return nothing: the rows would have to be counted."""
        return {}

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some topics in the order of the file."""
        return packed(self._messages(ids)) if ids else iter(())

    def _messages(self, ids: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of some topics in the order of the file; rows that cannot be read are skipped and noted."""
        topics = ",".join(str(int(number)) for number in ids)
        query = (
            "SELECT rowid, topic_id, timestamp, data FROM messages"
            f" WHERE rowid > ? AND topic_id IN ({topics}) ORDER BY rowid"
        )
        last, bad = -1, 0
        try:
            found = self._database.execute(query, (last,))
            while rows := found.fetchmany(_ROWS):
                yield from _sound(rows)
                last = rows[-1][0]
            return
        except sqlite3.DatabaseError:
            pass  # somewhere behind the last of these rows: from there one by one
        while bad <= _MAX_BAD_ROWS:
            try:
                for row in self._database.execute(query, (last,)):
                    last = row[0]
                    yield from _sound([row])
                break
            except sqlite3.DatabaseError:
                bad += 1
                last += 1  # step past the row that cannot be read
        if bad:
            self._note(f"{plural(bad, 'row')} of the database cannot be read, the rest was")

    def _connect(self) -> sqlite3.Connection:
        try:
            return self._checked(self.path)
        except sqlite3.OperationalError:
            # A database with a write-ahead log needs a writable folder even to be read: read a copy.
            self._folder = tempfile.TemporaryDirectory(prefix="vsalog-")
            copy = Path(self._folder.name) / "bag.db3"
            shutil.copyfile(self.path, copy)
            log = self.path.with_name(self.path.name + "-wal")
            if log.is_file():
                shutil.copyfile(log, copy.with_name(copy.name + "-wal"))
        try:
            return self._checked(copy)
        except sqlite3.DatabaseError as error:
            raise ReadError(f"{self.path}: the database cannot be read: {error}") from error

    def _checked(self, path: Path) -> sqlite3.Connection:
        """Open a database for reading only and see that it holds a bag."""
        database = sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro", uri=True)
        try:
            names = {row[0] for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        except sqlite3.OperationalError:
            database.close()
            raise
        except sqlite3.DatabaseError as error:
            database.close()
            raise ReadError(f"{self.path}: the database is damaged: {error}") from error
        if not {"messages", "topics"} <= names:
            database.close()
            raise ReadError(f"{self.path}: is an SQLite database, but no ROS 2 bag (no tables 'topics' and 'messages')")
        return database

    def _rows(self, query: str) -> list[Any]:
        try:
            return self._database.execute(query).fetchall()
        except sqlite3.DatabaseError as error:
            raise ReadError(f"{self.path}: the table of topics cannot be read: {error}") from error

    def _definitions(self) -> dict[str, tuple[str, str]]:
        """Return language and text of the message definitions by type; bags of before 2023 have none."""
        try:
            rows = self._database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ).fetchall()
        except sqlite3.DatabaseError:
            return {}
        return {str(kind): (_LANGUAGES.get(str(encoding), ""), str(text)) for kind, encoding, text in rows}

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _sound(rows: list[Any]) -> Iterator[RawMessage]:
    """Yield the messages of rows that hold a time and bytes."""
    for _, topic, time, data in rows:
        if isinstance(data, bytes) and isinstance(time, int):
            yield topic, time & (2**64 - 1), 0, data


class CompressedContainer:
    """A bag file that is compressed as a whole: decompressed to a temporary file while it is read, which is `inner`.

    Raises
    ------
    ReadError
        The file cannot be decompressed, or what comes out is no bag.
    """

    rig_text: str | None

    def __init__(self, path: Path) -> None:
        import zstandard

        self._folder = tempfile.TemporaryDirectory(prefix="vsalog-")
        plain = Path(self._folder.name) / "bag"
        try:
            with path.open("rb") as source, plain.open("wb") as target:
                zstandard.ZstdDecompressor().copy_stream(source, target)
        except (zstandard.ZstdError, OSError) as error:
            raise ReadError(f"{path}: cannot be decompressed: {error}") from error
        self.inner = bag_file(plain, shown=path)
        self.format = self.inner.format
        self.has_publish = self.inner.has_publish
        self.rig_text = self.inner.rig_text
        self.notes = self.inner.notes

    def connections(self) -> list[Connection]:
        """Return the bag's connections."""
        return self.inner.connections()

    def counts(self) -> Mapping[int, int]:
        """Return how many messages connections have, where the file says so."""
        return self.inner.counts()

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some connections."""
        return self.inner.packets(ids)


class FolderContainer:
    """The files of a ROS 2 bag, which are `parts`, one after the other; see `vsalog.readers.bag.Container`.

    Raises
    ------
    ReadError
        The folder holds no bag.
    """

    def __init__(self, folder: Path) -> None:
        self.notes: list[str] = []
        self.parts: list[Container] = []
        for path in _bag_files(folder, self.notes):
            try:
                self.parts.append(bag_file(path, shown=path))
            except ReadError as error:
                self.notes.append(f"{path.name} was left out: {str(error).removeprefix(f'{path}: ')}")
        if not self.parts:
            raise ReadError("; ".join([f"{folder}: none of its files can be read", *self.notes]))
        formats = {part.format for part in self.parts}
        self.format = "rosbag2-mcap" if formats == {"mcap"} else "rosbag2-sqlite3"
        self.has_publish = all(part.has_publish for part in self.parts)

    @property
    def rig_text(self) -> str | None:
        """The rig in the first file that has one."""
        return next((part.rig_text for part in self.parts if part.rig_text is not None), None)

    def connections(self) -> list[Connection]:
        """Return the connections of all files."""
        return [
            Connection(
                part * _IDS_PER_FILE + one.id,
                one.topic,
                one.type,
                one.encoding,
                one.language,
                one.definition,
                one.metadata,
            )
            for part, container in enumerate(self.parts)
            for one in container.connections()
        ]

    def counts(self) -> Mapping[int, int]:
        """Return how many messages connections have, where their file says so."""
        return {
            part * _IDS_PER_FILE + number: count
            for part, container in enumerate(self.parts)
            for number, count in container.counts().items()
        }

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some connections, file by file."""
        for part, container in enumerate(self.parts):
            first = part * _IDS_PER_FILE
            own = [number - first for number in ids if first <= number < first + _IDS_PER_FILE]
            for packet in container.packets(own):
                yield replace(packet, connection=packet.connection + first)
            self.notes.extend(note for note in container.notes if note not in self.notes)


def bag_file(path: Path, shown: Path) -> Container:
    """Return the container of one file of a ROS 2 bag; messages name it `shown`.

    Raises
    ------
    ReadError
        It is no such file.
    """
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise ReadError(f"{shown}: cannot be opened: {error.strerror or error}") from error
    if head.startswith(MCAP_MAGIC):
        return McapContainer(path)
    if head == SQLITE_MAGIC:
        return SqliteContainer(path)
    if head.startswith(ZSTD_MAGIC) and path == shown:  # compressed once, not twice
        return CompressedContainer(path)
    if not head:
        raise ReadError(f"{shown}: is empty")
    raise ReadError(f"{shown}: is neither an MCAP nor an SQLite file")


def is_bag_folder(folder: Path) -> bool:
    """Tell whether a folder holds a ROS 2 bag."""
    return (folder / METADATA).is_file() or bool(_candidates(folder))


def _candidates(folder: Path) -> list[Path]:
    """Return the bag files in a folder, told by content, ``bag_10`` after ``bag_9``."""
    found = []
    for path in folder.iterdir():
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(16)
            if head.startswith((MCAP_MAGIC, ZSTD_MAGIC)) or head == SQLITE_MAGIC:
                found.append(path)
    return sorted(
        found, key=lambda path: [(int(p), "") if p.isdigit() else (0, p) for p in re.split(r"(\d+)", path.name)]
    )


def _bag_files(folder: Path, notes: list[str]) -> list[Path]:
    """Return the files of a bag: those that the metadata list, or else all that look like bag files.

    The metadata only choose among the files of the folder; what they say is never opened as a path.
    """
    candidates = _candidates(folder)
    metadata = folder / METADATA
    if not metadata.is_file():
        if len({_bag_name(path) for path in candidates}) > 1:
            raise ReadError(
                f"{folder}: is a folder of several logs, no single bag (it has no {METADATA}): name one of"
                f" {_listed(candidates)}"
            )
        notes.append(
            f"there is no {METADATA} (was the recording cut off?): took {plural(len(candidates), 'file')},"
            f" {_listed(candidates)}"
        )
        _note_others(folder, candidates, notes)
        return candidates
    listed = _listed_names(metadata.read_text("utf-8", "replace"))
    present = {path.name: path for path in folder.iterdir() if path.is_file()}
    chosen = [present[name] for name in listed if name in present]
    missing = [name for name in listed if name not in present]
    if missing and not chosen:
        chosen = candidates
        notes.append(f"{METADATA} names files that are not there: took {plural(len(candidates), 'file')} found instead")
    elif missing:
        notes.append(f"{plural(len(missing), 'file')} of the bag missing: {', '.join(missing[:5])}")
    if not chosen:
        raise ReadError(f"{folder}: has a {METADATA}, but no bag files; copy them beside it")
    _note_others(folder, chosen, notes)
    return chosen


def _bag_name(path: Path) -> str:
    """Return what the files of one bag have in common: ``run`` of ``run_0.mcap`` and ``run_1.mcap.zstd``."""
    return re.sub(r"_\d+$", "", path.name.partition(".")[0])


def _note_others(folder: Path, chosen: list[Path], notes: list[str]) -> None:
    """Say which files of the folder look like logs too, but are no part of the bag."""
    others = [
        path
        for path in sorted(folder.iterdir())
        if path not in chosen and path.is_file() and path.suffix in _LOG_ENDINGS
    ]
    if others:
        notes.append(f"{folder.name} holds other logs, which were left out: {_listed(others)}")


def _listed(paths: list[Path]) -> str:
    more = f" and {len(paths) - 5} more" if len(paths) > 5 else ""
    return ", ".join(path.name for path in paths[:5]) + more


def _listed_names(text: str) -> list[str]:
    """Return the names of the files that the metadata list, without folders."""
    block = re.search(r"^[ \t]*relative_file_paths:[ \t]*\n((?:[ \t]*-[ \t]+\S.*\n?)+)", text, re.MULTILINE)
    lines = block.group(1).splitlines() if block else []
    names = [line.strip()[1:].strip().strip("\"'").replace("\\", "/").rpartition("/")[2] for line in lines]
    return [name for name in names if name and name.isprintable()]
