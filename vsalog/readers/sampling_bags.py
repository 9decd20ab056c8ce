"""A sample of a ROS bag: whole chunks of a ROS 1 bag, rows of an SQLite bag, and of a folder some of each file."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import BinaryIO

import numpy as np
from rosbags.rosbag1.reader import Header, ReaderError, RecordType

from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import PIECE_BYTES
from vsalog.core.printable import printable
from vsalog.core.resolution import STRETCHES
from vsalog.readers.concatenated_files import opened_rosbag1
from vsalog.readers.file_sequence import SeveralContainer
from vsalog.readers.limits import MOST_STEPS
from vsalog.readers.opened import for_sqlite
from vsalog.readers.rosbag2 import METADATA
from vsalog.readers.sampling_mcap import MAGIC as MCAP_MAGIC
from vsalog.readers.sampling_mcap import cut_mcap
from vsalog.readers.sampling_pieces import Cut, Piece, chosen_pieces, copy_pieces
from vsalog.readers.sqlite_opened import attach

_VERSION = b"#ROSBAG V2.0\n"
_SQLITE = b"SQLite format 3\0"
_LENGTH = struct.Struct("<I")


Record = tuple[Header, Piece]
"""A record's header and where the whole record lies."""


def cut_rosbag1(source: Path, target: Path, budget: int) -> Cut | None:
    """Cut stretches of chunks out of a ROS 1 bag; of one without chunks, or several in one, nothing. See `sampling.Cutter`."""
    if isinstance(opened_rosbag1(source), SeveralContainer):
        return None
    with source.open("rb") as file:
        index = _index(file)
        walked = index or [record for record, _ in zip(_records(file, len(_VERSION)), range(MOST_STEPS), strict=False)]
        chunks = sorted(
            _chunks(file, index) if index else (p for header, p in walked if _op(header) == RecordType.CHUNK)
        )
        connections = [record for record in walked if _op(record[0]) == RecordType.CONNECTION]
        pieces, stretches = chosen_pieces(chunks, budget) if chunks else ([], 0)
        if not pieces:
            return None
        size = sum(piece.size for piece in pieces)
        with target.open("wb") as out:
            out.write(_VERSION)
            out.write(_bag_header(size, len(connections), len(pieces)))
            copy_pieces(file, [*pieces, *(piece for _, piece in connections)], out)
        totals = _totals(file, index)
    return Cut(size, stretches, totals, () if index else (Finding(code="recording.no_index"),))


def cut_sqlite(source: Path, target: Path, budget: int) -> Cut | None:
    """Cut stretches of rows out of the SQLite file of a ROS 2 bag. See `sampling.Cutter`."""
    with source.open("rb") as file:
        if file.read(len(_SQLITE)) != _SQLITE:
            return None  # compressed as a whole
    try:
        with closing(sqlite3.connect(for_sqlite(target), uri=True)) as database:
            attach(database, source, "log")
            for (table,) in database.execute("SELECT name FROM log.sqlite_master WHERE type = 'table'").fetchall():
                if table in ("topics", "message_definitions"):
                    database.execute(f"CREATE TABLE {table} AS SELECT * FROM log.{table}")
            first, last = database.execute("SELECT min(rowid), max(rowid) FROM log.messages").fetchone()
            share = max(budget // STRETCHES * (last - first + 1) // source.stat().st_size, 1)
            database.execute("CREATE TABLE messages AS SELECT * FROM log.messages WHERE 0")
            for begin in np.linspace(first, last + 1 - share, STRETCHES).astype(int).tolist():
                # The limit is for damaged databases, whose pages may go round in circles.
                database.execute(
                    "INSERT INTO messages SELECT * FROM log.messages WHERE rowid BETWEEN ? AND ? LIMIT ?",
                    (begin, begin + share - 1, share),
                )
            database.commit()
    except (sqlite3.DatabaseError, TypeError):  # damaged, or without rows: what can be done is the reader's business
        target.unlink(missing_ok=True)
        return None
    return Cut(target.stat().st_size, STRETCHES)


def cut_folder(source: Path, target: Path, budget: int) -> Cut | None:
    """Cut stretches out of each file of a ROS 2 bag; what cannot be cut is only taken where it is small."""
    files = [path for path in sorted(source.iterdir()) if path.is_file()]
    whole = sum(path.stat().st_size for path in files)
    target.mkdir()
    cuts: list[Cut] = []
    totals: Counter[str] = Counter()
    for path in files:
        if path.name == METADATA:
            (target / path.name).write_bytes(path.read_bytes().replace(b"message_count:", b"whole:"))
            continue
        with path.open("rb") as file:
            cutter = cut_mcap if file.read(len(MCAP_MAGIC)) == MCAP_MAGIC else cut_sqlite
        cut = cutter(path, target / path.name, max(budget * path.stat().st_size // whole, 1))
        if cut is None and path.stat().st_size > budget:
            return None
        if cut is None:
            shutil.copyfile(path, target / path.name)
        else:
            cuts.append(cut)
            totals.update(cut.totals)
    if not cuts:
        return None
    findings = Findings()
    findings.add(*(one for cut in cuts for one in cut.findings))
    # What stretches of two files have between them is a seam, too.
    return Cut(sum(cut.size for cut in cuts), sum(cut.stretches for cut in cuts), dict(totals), tuple(findings))


def _index(file: BinaryIO) -> list[Record]:
    """Return the connections and the infos of chunks at the end of a bag; nothing where it has no index."""
    first = next(_records(file, len(_VERSION)), None)
    try:
        position = first[0].get_uint64("index_pos") if first else 0
        counts = first[0].get_uint32("conn_count") + first[0].get_uint32("chunk_count") if first else 0
    except ReaderError:
        return []
    found = list(_records(file, position)) if 0 < position < 2**62 else []
    return found if len(found) == counts else []


def _chunks(file: BinaryIO, index: Sequence[Record]) -> Iterator[Piece]:
    """Yield the chunks that the index tells of."""
    for header, _ in index:
        if _op(header) == RecordType.CHUNK_INFO:
            found = next(_records(file, int.from_bytes(header.get("chunk_pos", b""), "little")), None)
            if found is not None and _op(found[0]) == RecordType.CHUNK:
                yield found[1]


def _totals(file: BinaryIO, index: Sequence[Record]) -> dict[str, int]:
    """Return the messages of each topic, but of those with several publishers, which may be several streams."""
    counts: Counter[int] = Counter()
    topics: dict[str, list[int]] = {}
    for header, piece in index:
        if _op(header) == RecordType.CONNECTION:
            topic = printable(header.get("topic", b"").decode("utf-8", "replace"))
            topics.setdefault(topic, []).append(int.from_bytes(header.get("conn", b""), "little"))
        elif _op(header) == RecordType.CHUNK_INFO:
            pairs = 8 * int.from_bytes(header.get("count", b""), "little")
            file.seek(max(piece.position + piece.size - pairs, 0))
            for connection, count in struct.iter_unpack("<II", file.read(pairs)[:pairs]):
                counts[connection] += count
    return {topic: counts[numbers[0]] for topic, numbers in topics.items() if len(numbers) == 1}


def _bag_header(size: int, connections: int, chunks: int) -> bytes:
    """Return a bag's first record: the connections stand behind chunks of `size` bytes, or in these, where there are none."""
    # Its own length does not depend on the numbers in it.
    fields = {"op": b"\x03", "index_pos": bytes(8), "conn_count": bytes(4), "chunk_count": bytes(4)}
    length = len(_VERSION) + 8 + sum(4 + len(name) + 1 + len(value) for name, value in fields.items())
    fields["index_pos"] = struct.pack("<Q", length + size)
    fields["conn_count"], fields["chunk_count"] = _LENGTH.pack(connections), _LENGTH.pack(chunks)
    parts = [f"{name}=".encode() + value for name, value in fields.items()]
    header = b"".join(_LENGTH.pack(len(part)) + part for part in parts)
    return _LENGTH.pack(len(header)) + header + _LENGTH.pack(0)


def _op(header: Header) -> int:
    return int.from_bytes(header.get("op", b"")[:1], "little")


def _records(file: BinaryIO, position: int) -> Iterator[Record]:
    """Yield the records of a bag from a place on, their data unread, up to the end or to damage."""
    size = file.seek(0, 2)
    while position + 8 <= size:
        file.seek(position)
        length = _LENGTH.unpack(file.read(4))[0]
        if length > min(PIECE_BYTES, size - position - 8):
            return
        file.seek(position)
        try:
            header = Header.read(file)
        except (ReaderError, ValueError):  # ValueError: a name that is no text
            return
        end = position + 8 + length + _LENGTH.unpack(file.read(4))[0]
        if end > size:
            return
        yield header, Piece(position, end - position)
        position = end
