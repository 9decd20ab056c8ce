"""A sample of a ROS bag: whole chunks of a ROS 1 bag, rows of an SQLite bag, and of a folder some of each file."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Iterable
from contextlib import closing
from itertools import islice
from pathlib import Path

import numpy as np
from rosbags.rosbag1.reader import RecordType

from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import printable
from vsalog.core.resolution import STRETCHES
from vsalog.readers.concatenated_files import opened_rosbag1
from vsalog.readers.limits import MOST_STEPS
from vsalog.readers.mcap_walk import MAGIC as MCAP_MAGIC
from vsalog.readers.opened import for_sqlite
from vsalog.readers.rosbag1 import Rosbag1Container
from vsalog.readers.rosbag1_walk import VERSION, Walk, number, op
from vsalog.readers.rosbag2 import METADATA
from vsalog.readers.sampling_mcap import cut_mcap
from vsalog.readers.sampling_pieces import Cut, Piece, chosen_pieces, copy_pieces
from vsalog.readers.sqlite_opened import attach

_SQLITE = b"SQLite format 3\0"
_LENGTH = struct.Struct("<I")


def cut_rosbag1(source: Path, target: Path, budget: int) -> Cut | None:
    """Cut stretches of chunks out of a ROS 1 bag; of one without chunks, or several in one, nothing. See `sampling.Cutter`."""
    bag = opened_rosbag1(source)
    if not isinstance(bag, Rosbag1Container):
        return None
    indexed = bag.has_index()
    with source.open("rb") as file:
        walk = Walk(file)
        begins: Iterable[int] = [len(VERSION)]
        if indexed:
            first, _, _ = next(walk.heads())
            begins = [*sorted(bag.chunks), *struct.unpack("<Q", first[b"index_pos"])]
        connections: dict[int, tuple[str, Piece]] = {}
        chunks: list[Piece] = []
        for begin in begins:
            for header, at, end in islice(walk.heads(begin), 1 if begin in bag.chunks else MOST_STEPS):
                if op(header) == RecordType.CHUNK:
                    chunks.append(Piece(at, end - at))
                elif op(header) == RecordType.CONNECTION:
                    topic = printable(header[b"topic"].decode("utf-8", "replace"))
                    connections[number(header, b"conn")] = topic, Piece(at, end - at)
        pieces, stretches = chosen_pieces(chunks, budget) if chunks else ([], 0)
        if not pieces:
            return None
        size = sum(piece.size for piece in pieces)
        with target.open("wb") as out:
            out.write(VERSION)
            out.write(_bag_header(size, len(connections), len(pieces)))
            copy_pieces(file, [*pieces, *(piece for _, piece in connections.values())], out)
    # Topics with several publishers may be several streams.
    publishers = Counter(topic for topic, _ in connections.values())
    totals = {topic: bag.counted[one] for one, (topic, _) in connections.items() if indexed and publishers[topic] == 1}
    return Cut(size, stretches, totals, () if indexed else (Finding(code="recording.no_index"),))


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


def _bag_header(size: int, connections: int, chunks: int) -> bytes:
    """Return a bag's first record: the connections stand behind chunks of `size` bytes, or in these, where there are none."""
    # Its own length does not depend on the numbers in it.
    fields = {"op": b"\x03", "index_pos": bytes(8), "conn_count": bytes(4), "chunk_count": bytes(4)}
    length = len(VERSION) + 8 + sum(4 + len(name) + 1 + len(value) for name, value in fields.items())
    fields["index_pos"] = struct.pack("<Q", length + size)
    fields["conn_count"], fields["chunk_count"] = _LENGTH.pack(connections), _LENGTH.pack(chunks)
    parts = [f"{name}=".encode() + value for name, value in fields.items()]
    header = b"".join(_LENGTH.pack(len(part)) + part for part in parts)
    return _LENGTH.pack(len(header)) + header + _LENGTH.pack(0)
