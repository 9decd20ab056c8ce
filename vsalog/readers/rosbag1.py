"""ROS 1 bags, walked from the start: bags without an index, truncated or with a bad chunk are read as far as possible."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import IO

import numpy as np
from rosbags.rosbag1.reader import RecordType

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.readers.chunked_file import ChunkedFile, Spans
from vsalog.readers.container import MOST_CONNECTIONS, Connection
from vsalog.readers.limits import FIRST_ROWS
from vsalog.readers.message_definitions import DefinitionError, ros1_checksum
from vsalog.readers.packets import Bytes, Packet, RawMessage
from vsalog.readers.record_walk import Header, Record
from vsalog.readers.rosbag1_index import IndexCheck, chunk_told
from vsalog.readers.rosbag1_scan import messages_in
from vsalog.readers.rosbag1_walk import VERSION, Walk, fields, number

MAGIC = b"#ROSBAG V"


_NONE = np.empty(0, np.int64)

Found = dict[int, tuple[Connection, bool]]
"""Connections by number, and whether the two copies of each in a bag agree."""


class Rosbag1Container(ChunkedFile):
    """One ROS 1 bag, neither encrypted nor of an older version; see `ChunkedFile`."""

    format = "rosbag1"
    has_publish = False
    rig_text: str | None = None
    WALK, DEFINITIONS, NO_INDEX = Walk, (RecordType.CONNECTION,), "recording.no_index"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._index: Found | None = None
        self._connections: dict[int, Connection] | None = None

    def connections(self) -> list[Connection]:
        """Return the bag's connections, from its index or else by walking the bag."""
        if self._connections is None:
            with self.open() as file:
                found = dict(self._indexed(file))
                if not found or not all(sound for _, sound in found.values()):
                    for record in self._records(Walk(file)):
                        self._keep_all(found, record)
            self._connections = {identity: connection for identity, (connection, _) in found.items()}
        return list(self._connections.values())

    def counts(self) -> Mapping[int, int]:
        """Return how many messages connections have, by the index, but no fewer than show a connection's channels."""
        self.connections()
        return {} if self._pieces else {number: max(count, FIRST_ROWS) for number, count in self.counted.items()}

    def has_index(self) -> bool:
        """Return whether there is a sound index at the end, and read it."""
        with self.open() as file:
            return bool(self._indexed(file))

    def _messages(self, data: Bytes, ids: Collection[int]) -> Packet:
        return messages_in(data, np.array(sorted(ids), dtype=np.int64))[0]

    def _records(self, walk: Walk, spans: Spans | None = None) -> Iterator[Record]:
        return chain.from_iterable(walk.records(*span) for span in (self._spans() if spans is None else spans))

    def _items(self, ids: Collection[int], spans: Spans | None) -> Iterator[Packet | RawMessage]:
        wanted = np.array(sorted(ids), dtype=np.int64)
        part = self._part
        left_out = {at for at, chunk in self.chunks.items() if part is not None and part.leaves_out(chunk)}
        check = IndexCheck(wanted, part, whole=part is None and self._pieces is None)
        with self.open() as file:
            walk = Walk(file, left_out.__contains__)
            for record in self._records(walk, spans):
                kind, position, data, header = record
                check.damaged(walk.damage)
                if kind == RecordType.CHUNK:
                    packet, sound, connections = messages_in(np.frombuffer(data, np.uint8), wanted)
                    if connections.size:
                        self._compare(record)
                    check.chunk(packet)
                    if not sound:
                        walk.lose(position, "some of its records cannot be read", len(packet.messages))
                    yield packet
                elif kind == RecordType.MSGDATA:
                    one = number(header, b"conn")
                    if one in ids:
                        seconds, fraction = struct.unpack("<II", header[b"time"])
                        yield one, seconds * 1_000_000_000 + fraction, 0, data
                elif kind == RecordType.BAGHEADER:
                    self._note_index(struct.unpack("<Q", header[b"index_pos"])[0])
                    check.announced(header)
                elif walk.passing:
                    check.passed(header, data)
                else:
                    check.record(header, data)
        if spans is None:
            self.findings.add(*walk.findings(), *check.findings(walk.damage, walk.chunks))

    def _note_index(self, position: int) -> None:
        if position == 0:
            self.findings.add(Finding(code="recording.no_index"))
        elif position >= self.size():
            self.findings.add(Finding(code="recording.index_cut_off"))

    def _compare(self, chunk: Record) -> None:
        """Compare the connections in a chunk with the known ones."""
        known = self._connections or {}
        found: Found = {}
        self._keep_all(found, chunk)
        for identity, (connection, _) in found.items():
            if known.get(identity, connection) != connection:
                topic = printable(known[identity].topic)
                self.findings.add(Finding(code="recording.definition_damaged", part=topic))

    def _keep_all(self, found: Found, record: Record) -> None:
        """Add the connections of a record to `found`.

        Raises
        ------
        ReadError
            There are more than any bag has.
        """
        data = record.content
        if record.kind == RecordType.CONNECTION:
            _keep(found, record.header, data)
        elif record.kind == RecordType.CHUNK:
            _, _, connections = messages_in(np.frombuffer(data, np.uint8), _NONE)
            for start, stop, end in connections.tolist():
                _keep(found, fields(data[start:stop]) or {}, data[stop + 4 : end])
        if len(found) > MOST_CONNECTIONS:
            raise ReadError(f"has more than {MOST_CONNECTIONS} connections; no such bag is read", self.path)

    def _check(self, file: IO[bytes]) -> None:
        version = file.readline(20)
        if version != VERSION:
            shown = version.decode("ascii", "replace").strip()
            raise ReadError(
                f"is a ROS bag of a version that is not supported ({shown});"
                " 'rosbag migrate' or 'rosbag fix' brings it to version 2.0",
                self.path,
            )

    def _indexed(self, file: IO[bytes]) -> Found:
        """Return the connections in the index at the end; none where the bag has no index or it is damaged."""
        if self._index is None:
            self._index = self._read_index(file)
        return self._index

    def _read_index(self, file: IO[bytes]) -> Found:
        found: Found = {}
        header = next((record.header for record in Walk(file).records()), {})
        if header.get(b"encryptor"):
            raise ReadError("is encrypted; decrypt it first ('rosbag decrypt')", self.path)
        index, count = header.get(b"index_pos", b""), header.get(b"conn_count", b"")
        if len(index) != 8 or len(count) != 4 or not struct.unpack("<Q", index)[0]:
            return {}
        walk, counted = Walk(file), Counter[int]()
        for record in walk.records(struct.unpack("<Q", index)[0]):
            if record.kind == RecordType.CHUNK_INFO:
                for connection, number_of in struct.iter_unpack("<II", record.content):
                    counted[connection] += number_of
                if entry := chunk_told(record.header, record.content):
                    self.chunks[entry[0]] = entry[1]
            elif record.kind == RecordType.CONNECTION:
                self._keep_all(found, record)
            else:
                break
        if len(found) == number(header, b"conn_count") and not walk.skipped:
            self.counted = counted
            return found
        self.chunks = {}
        return {}


def _keep(found: Found, header: Header, data: bytes) -> None:
    """Add a connection record to `found`, unless it is damaged or a sound copy of it exists."""
    detail = fields(data)
    if len(header.get(b"conn", b"")) != 4 or detail is None:
        return
    identity, topic = number(header, b"conn"), header.get(b"topic", b"")
    if identity in found and found[identity][1]:
        return
    kind, text = (_text(detail.get(name, b"")) for name in (b"type", b"message_definition"))
    sound = detail.get(b"topic", topic) == topic and _agrees(kind, text, _text(detail.get(b"md5sum", b"*")))
    if identity not in found or sound:
        publisher = _text(detail.get(b"callerid", b"")) or str(identity)
        found[identity] = Connection(identity, _text(topic), kind, "ros1", "msg", text, publisher=publisher), sound


@lru_cache
def _agrees(kind: str, text: str, checksum: str) -> bool:
    """Return whether a definition matches its checksum; a missing one is no contradiction."""
    try:
        return checksum == "*" or not text or ros1_checksum(kind, text) == checksum
    except DefinitionError:
        return False


def _text(raw: bytes) -> str:
    return raw.decode("utf-8", "replace")
