"""ROS 1 bags, walked from the start: bags without an index, cut off or with a bad chunk are read as far as they go."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import IO

import numpy as np
from rosbags.rosbag1.reader import RecordType

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import printable
from vsalog.readers.chunk_index import Chunk, Needed, Part, some_of
from vsalog.readers.compression import beginning
from vsalog.readers.container import MOST_CONNECTIONS, Connection
from vsalog.readers.definitions import DefinitionError, ros1_checksum
from vsalog.readers.limits import BLOCK_ROWS, FIRST_ROWS, GLANCE_BYTES
from vsalog.readers.opened import FilePart
from vsalog.readers.packets import Packet, RawMessage, ahead, packet_of
from vsalog.readers.rosbag1_index import IndexCheck, chunk_told
from vsalog.readers.rosbag1_scan import connections_in, messages_in
from vsalog.readers.rosbag1_walk import (
    VERSION,
    Header,
    Walk,
    fields,
    number,
    op,
)
from vsalog.readers.walk_findings import walk_findings

MAGIC = b"#ROSBAG V"


Found = dict[int, tuple[Connection, bool]]
"""Connections by number, and whether what a bag tells twice of each agrees."""


class Rosbag1Container:
    """One ROS 1 bag; see `vsalog.readers.container.Container`.

    Parameters
    ----------
    path : Path
        Where it is.
    span : (int, int), optional
        From which byte of the file on and up to which, where others are in it, too.

    Attributes
    ----------
    counted : Counter
        Messages of connections, as the index tells.
    chunks : dict of int to Chunk
        What the index tells of chunks, by their positions.

    Raises
    ------
    ReadError
        The file cannot be opened, is encrypted or of an older version.
    """

    format = "rosbag1"
    has_publish = False
    rig_text: str | None = None

    def __init__(self, path: Path, span: tuple[int, int] | None = None) -> None:
        self.path = path
        self._span = span
        self._index: Found | None = None
        self.findings = Findings()
        self._connections: dict[int, Connection] | None = None
        self.counted: Counter[int] = Counter()
        self.chunks: dict[int, Chunk] = {}
        self._part: Part | None = None

    def connections(self) -> list[Connection]:
        """Return the bag's connections, from its index or else by walking the bag."""
        if self._connections is None:
            with self._open() as file:
                found = dict(self._indexed(file))
                if not found or not all(sound for _, sound in found.values()):
                    for header, data in Walk(file).records():
                        self._keep_all(found, header, data)
            self._connections = {identity: connection for identity, (connection, _) in found.items()}
        return list(self._connections.values())

    def counts(self) -> Mapping[int, int]:
        """Return how many messages connections have, as the index says, but no less than tell a connection's channels."""
        self.connections()
        return {number: max(count, FIRST_ROWS) for number, count in self.counted.items()}

    def size(self) -> int:
        """Return how many bytes the bag has."""
        return self.path.stat().st_size if self._span is None else self._span[1] - self._span[0]

    def has_index(self) -> bool:
        """Tell whether there is a sound index at the end, and learn what it tells."""
        with self._open() as file:
            return bool(self._indexed(file))

    def narrow(self, part: Part) -> bool:
        """Pass by chunks without a message of a part of the log, where the index tells of chunks."""
        self.connections()
        self._part = part
        return bool(self.chunks)

    def glimpses(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the first messages of chunks from all over the bag."""
        self.connections()
        wanted = np.array(sorted(ids), dtype=np.int64)
        with self._open() as file:
            walk = Walk(file)
            for position in some_of(self.chunks, ids):
                found = walk.beginning(position, GLANCE_BYTES)
                if found is not None:
                    yield messages_in(np.frombuffer(beginning(*found, GLANCE_BYTES), np.uint8), wanted)[0]

    def packets(self, ids: Collection[int], needed: Needed | None = None) -> Iterator[Packet]:
        """Yield the messages of some connections in the order of the file; what is damaged is skipped and noted.

        Raises
        ------
        IndexContradictsError
            Only a part is read, and the index tells two things of what is in it.
        """
        return ahead(self._packets(ids, needed))

    def _packets(self, ids: Collection[int], needed: Needed | None) -> Iterator[Packet]:
        wanted = np.array(sorted(ids), dtype=np.int64)
        loose: list[RawMessage] = []  # outside of chunks
        part = self._part
        whole = part is None and needed is None

        def leaves_out(chunk: Chunk) -> bool:
            outside = part is not None and part.leaves_out(chunk)
            return outside or (needed is not None and not chunk.may_hold(needed))

        check = IndexCheck(wanted, None if whole else leaves_out)
        with self._open() as file:
            known = {} if whole else self.chunks
            walk = Walk(file, lambda at: at in known and leaves_out(known[at]))
            for header, data in walk.records():
                kind = op(header)
                check.damaged(walk.damage)
                if loose and (kind == RecordType.CHUNK or len(loose) >= BLOCK_ROWS):
                    yield packet_of(loose)
                    loose = []
                if kind == RecordType.CHUNK:
                    packet, sound, connections = messages_in(np.frombuffer(data, np.uint8), wanted)
                    if connections:
                        self._compare(data)
                    check.chunk(packet)
                    if not sound:
                        walk.lose(len(packet.messages), "some of its records cannot be read")
                    if len(packet.messages):
                        yield packet
                elif kind == RecordType.MSGDATA:
                    one = number(header, b"conn")
                    if one in ids:
                        seconds, fraction = struct.unpack("<II", header[b"time"])
                        loose.append((one, seconds * 1_000_000_000 + fraction, 0, data))
                elif kind == RecordType.BAGHEADER:
                    self._note_index(struct.unpack("<Q", header[b"index_pos"])[0])
                    check.announced(header)
                elif walk.passing:
                    check.passed(header, data)
                else:
                    check.record(header, data)
        if loose:
            yield packet_of(loose)
        self.findings.add(*walk_findings(walk.skipped, walk.cut), *check.findings(walk.damage, walk.chunks))

    def _note_index(self, position: int) -> None:
        if position == 0:
            self.findings.add(Finding(code="recording.no_index"))
        elif position >= self.size():
            self.findings.add(Finding(code="recording.index_cut_off"))

    def _compare(self, chunk: bytes) -> None:
        """Compare the connections that a chunk tells with what is known of them."""
        known = self._connections or {}
        found: Found = {}
        self._keep_all(found, {b"op": bytes([RecordType.CHUNK])}, chunk)
        for identity, (connection, _) in found.items():
            if known.get(identity, connection) != connection:
                topic = printable(known[identity].topic)
                self.findings.add(Finding(code="recording.definition_damaged", part=topic))

    def _keep_all(self, found: Found, header: Header, data: bytes) -> None:
        """Add the connections that a record tells to `found`.

        Raises
        ------
        ReadError
            There are more than any bag has.
        """
        if op(header) == RecordType.CONNECTION:
            _keep(found, header, data)
        elif op(header) == RecordType.CHUNK:
            for start, stop, end in connections_in(np.frombuffer(data, np.uint8)):
                _keep(found, fields(data[start:stop]) or {}, data[stop + 4 : end])
        if len(found) > MOST_CONNECTIONS:
            raise ReadError(f"has more than {MOST_CONNECTIONS} connections; no such bag is read", self.path)

    def _open(self) -> IO[bytes]:
        try:
            file = self.path.open("rb") if self._span is None else FilePart.opened(self.path, *self._span)
        except OSError as error:
            raise ReadError(f"cannot be opened: {error.strerror or error}", self.path) from error
        version = file.readline(20)
        if version != VERSION:
            file.close()
            shown = version.decode("ascii", "replace").strip()
            raise ReadError(
                f"is a ROS bag of a version that is not supported ({shown});"
                " 'rosbag migrate' or 'rosbag fix' brings it to version 2.0",
                self.path,
            )
        return file

    def _indexed(self, file: IO[bytes]) -> Found:
        """Return the connections in the index at the end; none where the bag has no index or it is damaged."""
        if self._index is None:
            self._index = self._read_index(file)
        return self._index

    def _read_index(self, file: IO[bytes]) -> Found:
        found: Found = {}
        header, _ = next(Walk(file).records(), ({}, b""))
        if header.get(b"encryptor"):
            raise ReadError("is encrypted; decrypt it first ('rosbag decrypt')", self.path)
        index, count = header.get(b"index_pos", b""), header.get(b"conn_count", b"")
        if len(index) != 8 or len(count) != 4 or not struct.unpack("<Q", index)[0]:
            return {}
        walk = Walk(file)
        for inner, data in walk.records(struct.unpack("<Q", index)[0]):
            if op(inner) == RecordType.CHUNK_INFO:
                for connection, number_of in struct.iter_unpack("<II", data):
                    self.counted[connection] += number_of
                if told := chunk_told(inner, data):
                    self.chunks[told[0]] = told[1]
            elif op(inner) == RecordType.CONNECTION:
                self._keep_all(found, inner, data)
            else:
                break
        if len(found) == number(header, b"conn_count") and not walk.skipped:
            return found
        self.counted, self.chunks = Counter(), {}
        return {}


def begins_bag(file: IO[bytes], at: int) -> bool:
    """Tell whether a bag begins at a place in a file: its first record follows its version."""
    header, _ = next(Walk(file).records(at + len(VERSION)), ({}, b""))
    return op(header) == RecordType.BAGHEADER


def _keep(found: Found, header: Header, data: bytes) -> None:
    """Add a connection record to `found`, unless it is damaged or a sound copy of it is there."""
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
    """Tell whether a definition is the one that its checksum was made of; none is no contradiction."""
    try:
        return checksum == "*" or not text or ros1_checksum(kind, text) == checksum
    except DefinitionError:
        return False


def _text(raw: bytes) -> str:
    return raw.decode("utf-8", "replace")
