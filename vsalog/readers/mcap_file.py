"""MCAP files, whole or damaged.

The file is walked from the start rather than by its index: a truncated recording has no index, and one bad chunk
must not hide those after it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, MetadataIndex, Schema, Statistics
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.readers.chunked_file import ChunkedFile, Spans
from vsalog.readers.container import Chunk, Connection
from vsalog.readers.mcap_scan import ends_whole, messages_in, others_in
from vsalog.readers.mcap_walk import MAGIC, Walk
from vsalog.readers.packets import Bytes, Packet, RawMessage

RIG_METADATA = "vsalog.rig"
RIG_KEY = "toml"


_LANGUAGES = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl", "omgidl": "idl", "protobuf": "protobuf"}
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_FOOTER = struct.Struct("<BQQQI")
_CHUNK_INDEX = struct.Struct("<QQQQI")
_OFFSET = struct.Struct("<HQ")


class McapContainer(ChunkedFile):
    """One MCAP file; see `ChunkedFile`.

    Attributes
    ----------
    schemas, channels : dict of int to record
        Of the file, by their numbers; complete once `connections` was asked for.
    """

    format = "mcap"
    has_publish = True
    WALK, NO_INDEX = Walk, "recording.no_summary"
    DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._rig_text: str | None = None
        self._scanned = False
        self._indexed: bool | None = None
        self._text = 0
        self._end: int | None = None

    @property
    def rig_text(self) -> str | None:
        """The rig in the metadata record ``vsalog.rig``, as TOML."""
        self._scan()
        return self._rig_text

    def connections(self) -> list[Connection]:
        """Return the file's channels."""
        self._scan()
        return [self._connection(channel) for channel in self.channels.values()]

    def counts(self) -> Mapping[int, int]:
        """Return how many messages channels have, by the summary at the end."""
        self._scan()
        return self.counted if self._pieces is None else {}

    def _check(self, file: IO[bytes]) -> None:
        if file.read(len(MAGIC)) != MAGIC:
            raise ReadError("is no MCAP file", self.path)

    def has_index(self) -> bool:
        """Return whether there is a sound summary at the end, and read it."""
        if self._indexed is None:
            try:
                self._indexed = self._summary()
            except (ValueError, LookupError, OSError, struct.error, McapError):
                self._indexed = False  # damage anywhere in the summary: the walk finds the contents
        return self._indexed

    def _messages(self, data: Bytes, ids: Collection[int]) -> Packet:
        return messages_in(data, _flags(ids))

    def _items(self, ids: Collection[int], spans: Spans | None) -> Iterator[Packet | RawMessage]:
        wanted = _flags(ids)
        count = 0
        for record, content in self.records(spans):
            if record == Opcode.CHUNK:
                packet = messages_in(np.frombuffer(content, np.uint8), wanted)
                count += len(packet.messages)
                yield packet
            elif record == Opcode.MESSAGE:
                channel, _, log, publish = _MESSAGE_HEAD.unpack_from(content)
                if wanted[channel]:
                    count += 1
                    yield channel, log, publish, content[_MESSAGE_HEAD.size :]
        expected = sum(self.counts().get(number, 0) for number in ids)
        if count < expected and self._part is None and spans is None:
            self.findings.add(
                Finding(
                    code="recording.messages_missing",
                    value=expected - count,
                    evidence={"expected": expected, "counted_by": "summary"},
                )
            )

    def _connection(self, channel: Channel) -> Connection:
        schema = self.schemas.get(channel.schema_id)
        return Connection(
            id=channel.id,
            topic=channel.topic,
            type=schema.name if schema else "",
            encoding=channel.message_encoding,
            language=_LANGUAGES.get(schema.encoding, "") if schema else "",
            definition=_definition(schema) if schema else "",
            metadata=channel.metadata,
            publisher=channel.metadata.get("callerid") or str(channel.id),
        )

    def _scan(self) -> None:
        """Read channels, schemas and the rig: from the summary at the end, or else by walking the file."""
        if self._scanned:
            return
        self._scanned = True
        if self.has_index():
            return
        self.schemas, self.channels, self.counted, self.chunks = {}, {}, {}, {}
        for record, content in self.records():
            if record == Opcode.CHUNK:
                for inner, own in others_in(np.frombuffer(content, np.uint8)):
                    self._keep(inner, own)
            else:
                self._keep(record, content)
        if self._end is not None:
            with self.open() as file:
                for kind, content in summary_records(file, self._end) or ():
                    if kind == Opcode.STATISTICS:
                        with suppress(ValueError, struct.error, McapError):
                            self.counted = _statistics(content).channel_message_counts
                    elif kind != Opcode.METADATA:
                        self._keep(kind, content)

    def _summary(self) -> bool:
        """Read the summary at the end of the file; False where it is missing, damaged or incomplete."""
        statistics: Statistics | None = None
        metadata: list[MetadataIndex] = []
        with self.open() as file:
            for kind, content in summary_records(file) or ():
                if kind == Opcode.STATISTICS:
                    statistics = _statistics(content)
                elif kind == Opcode.CHUNK_INDEX:
                    position, chunk = _chunk_in(content)
                    self.chunks[position] = chunk
                elif kind == Opcode.METADATA_INDEX:
                    metadata.append(MetadataIndex.read(ReadDataStream(BytesIO(content))))
                else:
                    self._keep(kind, content)
            if statistics is None or statistics.channel_count != len(self.channels):
                return False
            if any(one.schema_id and one.schema_id not in self.schemas for one in self.channels.values()):
                return False
            if statistics.metadata_count != len(metadata):
                return False
            for index in metadata:
                file.seek(index.offset)
                kind, length = _HEAD.unpack(file.read(_HEAD.size))
                self._keep(kind, file.read(min(length, index.length)))
        self.counted = {number: statistics.channel_message_counts.get(number, 0) for number in self.channels}
        return True

    def _keep(self, record: int, content: bytes) -> None:
        """Remember a channel, a schema or the rig."""
        stream = ReadDataStream(BytesIO(content))
        try:
            if record == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schemas[schema.id] = schema
                self._text += len(schema.data)
                if self._text > AT_ONCE_BYTES:
                    raise ReadError(f"has more than {AT_ONCE_BYTES} bytes of message definitions", self.path)
            elif record == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self.channels[channel.id] = channel
            elif record == Opcode.METADATA:
                metadata = Metadata.read(stream)
                if metadata.name == RIG_METADATA:
                    self._rig_text = metadata.metadata.get(RIG_KEY)
        except (ValueError, struct.error, McapError):  # its messages will be reported as missing
            self.findings.add(Finding(code="recording.record_damaged"))

    def records(self, spans: Spans | None = None) -> Iterator[tuple[int, bytes]]:
        """Yield the records of the data section, a chunk as its own records, decompressed.

        `findings` reports what was skipped, unless only some spans of the file are read.
        """
        with self.open() as file:
            passed = self._passed_by(file)
            whole = not passed and spans is None and self._pieces is None
            walk = Walk(
                file,
                whole and _states_checksum(file),
                passed.__contains__,
                chunked=bool(self.chunks),
            )
            spans_read = self._spans() if spans is None else spans
            for record in chain.from_iterable(walk.records(*span) for span in spans_read):
                if record.kind == Opcode.CHUNK and not ends_whole(np.frombuffer(record.content, np.uint8)):
                    walk.lose(record.position, "its last record is cut off")
                yield record.kind, record.content
            if spans is None and self._pieces is None and not self._indexed:
                walk.note_joined()
        if spans is not None:
            return
        self.findings.add(*walk.findings())
        self._end = walk.end

    def _passed_by(self, file: IO[bytes]) -> frozenset[int]:
        """Return the positions of chunks that surely contain no message in the window: summary and chunk agree on their times."""
        if self._part is None:
            return frozenset()
        found = []
        for position, chunk in self.chunks.items():
            if chunk.last and self._part.leaves_out(chunk):
                file.seek(position)
                head = file.read(_HEAD.size + 16)
                if head[:1] == bytes([Opcode.CHUNK]) and head[_HEAD.size :] == struct.pack(
                    "<QQ", chunk.first, chunk.last
                ):
                    found.append(position)
        return frozenset(found)


def _statistics(content: bytes) -> Statistics:
    found: Statistics = Statistics.read(ReadDataStream(BytesIO(content)))
    return found


def _definition(schema: Schema) -> str:
    """Return a schema's text; other bytes, such as those of protobuf, as one character each."""
    return schema.data.decode("latin-1") if schema.encoding == "protobuf" else schema.data.decode("utf-8", "replace")


def _flags(ids: Collection[int]) -> NDArray[np.bool_]:
    """Return for each possible channel whether it is among some."""
    flags = np.zeros(2**16, dtype=np.bool_)
    flags[list(ids)] = True
    return flags


def summary_records(file: IO[bytes], start: int | None = None) -> Iterator[tuple[int, bytes]] | None:
    """Return kind and content of the records in the summary; None where there is none, or it is damaged.

    Parameters
    ----------
    file : binary file
        Opened.
    start : int, optional
        Byte at which it begins, in place of the footer's: removed chunks leave the footer's number too large.
    """
    found = _footer(file)
    if found is None:
        return None
    position, stated, checksum = found
    start = stated if start is None else start
    if not 0 < start <= position or position - start > AT_ONCE_BYTES:
        return None
    file.seek(start)
    section = file.read(position - start + _FOOTER.size)
    # The checksum covers the footer up to itself.
    if checksum and zlib.crc32(section[:-4]) != checksum:
        return None
    records = np.frombuffer(section[: position - start], np.uint8)
    return others_in(records) if ends_whole(records) else None


def _chunk_in(content: bytes) -> tuple[int, Chunk]:
    """Return the position of the chunk of a chunk index record, and the record's data about it."""
    first, last, position, _, size = _CHUNK_INDEX.unpack_from(content)
    offsets = content[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size]
    channels = frozenset(channel for channel, _ in _OFFSET.iter_unpack(offsets[: size // _OFFSET.size * _OFFSET.size]))
    return position, Chunk(first, last, channels or None)


def _states_checksum(file: IO[bytes]) -> bool:
    """Return whether there may be a checksum of the data section."""
    found = _footer(file)
    if found is None:
        return False
    position, start, _ = found
    at = (start or position) - _HEAD.size - 4
    if not 0 <= at < position:
        return True
    file.seek(at)
    end = file.read(_HEAD.size + 4)
    return (
        len(end) < _HEAD.size + 4
        or end[: _HEAD.size] != _HEAD.pack(Opcode.DATA_END, 4)
        or end[_HEAD.size :] != bytes(4)
    )


def _footer(file: IO[bytes]) -> tuple[int, int, int] | None:
    """Return the footer's position, where the summary starts, and its checksum (0 for none); None without a footer."""
    position = file.seek(0, 2) - len(MAGIC) - _FOOTER.size
    if position < len(MAGIC):
        return None
    file.seek(position)
    kind, length, start, _, checksum = _FOOTER.unpack(file.read(_FOOTER.size))
    return (position, start, checksum) if kind == Opcode.FOOTER and length == _FOOTER.size - _HEAD.size else None
