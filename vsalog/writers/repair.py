"""The readable part of a damaged log, as a sound MCAP file."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata
from mcap.writer import CompressionType, Writer
from msgspec import structs

from vsalog.core.errors import ReadError, WriteError
from vsalog.core.finding import Finding, Findings
from vsalog.core.finding_texts import sentence
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.readers import open_container, read
from vsalog.readers.compressed_messages import plain
from vsalog.readers.container import Connection, Container
from vsalog.readers.file_sequence import SeveralContainer
from vsalog.readers.mcap_file import McapContainer, summary_records
from vsalog.readers.mcap_scan import Size, messages_in
from vsalog.readers.mcap_walk import Walk
from vsalog.readers.message_reader import BagReader
from vsalog.readers.remote import local
from vsalog.readers.sniff import sniff
from vsalog.writers.atomic import atomic_path
from vsalog.writers.recording_mcap import write_mcap
from vsalog.writers.recording_topics import topics_of
from vsalog.writers.repaired import Repaired

_MESSAGE_HEAD = struct.Struct("<HIQQ")
_SCHEMA_LANGUAGES = {("ros1", "msg"): "ros1msg", ("cdr", "msg"): "ros2msg", ("cdr", "idl"): "ros2idl"}
_TABLES = ("table", "table-folder", "parquet", "matlab")

RawMessage = tuple[int, int, int, int, bytes]
"""Channel, sequence number, log time [ns], publish time [ns], the serialised message."""


def repair(source: Path, target: Path, rate: float | None = None) -> Repaired:
    """Write the readable part of a log into an MCAP file with chunks, checksums and an index.

    Messages and definitions of MCAP files and ROS bags are copied bit for bit; metadata and attachments of MCAP files too.
    Tables have no messages: their columns become topics.

    Parameters
    ----------
    source : the log, which stays as it is
    target : appears when all is written; replaced when it is there
    rate : samples per second of tables without a time column [Hz]

    Raises
    ------
    ReadError
        Nothing of the log can be read.
    WriteError
        The file cannot be written, or is the log itself.
    """
    source = local(source)
    kind = sniff(source)
    _keep_source(source, target)
    if kind in _TABLES:
        return _repair_table(source, target, rate)
    container = open_container(source, kind)
    parts = list(_parts(container))
    findings = Findings()
    messages = others = 0
    with atomic_path(target) as temporary, temporary.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile=_profile(parts), library="vsalog")
        definitions = _Definitions(writer)
        for part in parts:
            numbers = definitions.of(part)
            if isinstance(part, McapContainer):
                others += _copy_others(writer, part, findings)
            for number, sequence, log, publish, data in _messages(part, numbers, findings):
                writer.add_message(number, log, data, publish, sequence)
                messages += 1
        writer.finish()  # type: ignore[no-untyped-call]
        if not messages + others:
            raise ReadError(f"{source}: none of its messages can be read: {target.name} was not written")
    found = Findings()
    found.add(*(one for part in [container, *parts] for one in part.findings), *findings, *_unfit(target))
    return Repaired(str(target), messages, len(definitions.announced), tuple(map(sentence, found)), tuple(found))


def _unfit(target: Path) -> list[Finding]:
    """Return which messages were copied although they cannot be decoded."""
    reader = BagReader(McapContainer(target))
    try:
        for _ in reader.blocks(None):
            pass
    except ReadError:  # more topics than are ever decoded
        return []
    return [structs.replace(one, evidence={**one.evidence, "done": "copied as they are"}) for one in reader.unfit]


def _keep_source(source: Path, target: Path) -> None:
    """Refuse to overwrite the input."""
    files = [source, *source.iterdir()] if source.is_dir() else [source]
    if target.exists() and any(target.samefile(file) for file in files):
        raise WriteError(f"{target}: is the log itself; give the repaired file another name")


def _parts(container: Container) -> Iterator[Container]:
    """Yield the files that a container consists of."""
    if isinstance(container, SeveralContainer):
        for part in container.parts:
            yield from _parts(part)
    else:
        yield container


def _profile(parts: list[Container]) -> str:
    first = parts[0]
    if not isinstance(first, McapContainer):
        return "ros1" if first.format == "rosbag1" else "ros2"
    with first.open() as file:
        header = next((record.content for record in Walk(file, kept=(Opcode.HEADER,)).records()), b"")
    try:
        return str(Header.read(ReadDataStream(BytesIO(header))).profile)
    except (ValueError, struct.error, McapError):
        return ""


class _Definitions:
    """Registers schemas and channels; those that the files of a split bag share, once."""

    def __init__(self, writer: Writer) -> None:
        self._schema = cache(writer.register_schema)
        self._channel = cache(
            # The old number is part of the key: two publishers on a topic stay two.
            lambda _, topic, encoding, schema, metadata: writer.register_channel(
                topic, encoding, schema, dict(metadata)
            )
        )
        self.announced: set[int] = set()

    def of(self, part: Container) -> dict[int, int]:
        """Return a file's channel numbers → the new ones."""
        connections = part.connections()
        if isinstance(part, McapContainer):
            schemas = {number: self._schema(s.name, s.encoding, s.data) for number, s in part.schemas.items()}
            numbers = {
                number: self._channel(
                    number, c.topic, c.message_encoding, schemas.get(c.schema_id, 0), tuple(c.metadata.items())
                )
                for number, c in part.channels.items()
            }
        else:
            numbers = {
                one.id: self._channel(one.id, one.topic, one.encoding, self._stated(one), tuple(one.metadata.items()))
                for one in connections
            }
        self.announced.update(numbers.values())
        return numbers

    def _stated(self, one: Connection) -> int:
        # A definition that the bag lacks is an empty one: readers then take the type by its name.
        language = _SCHEMA_LANGUAGES.get(
            (one.encoding, one.language), "ros1msg" if one.encoding == "ros1" else "ros2msg"
        )
        return int(self._schema(one.type, language, one.definition.encode("utf-8", "surrogatepass")))


def _messages(part: Container, numbers: Mapping[int, int], findings: Findings) -> Iterator[RawMessage]:
    """Yield a file's messages by their new channels."""
    if isinstance(part, McapContainer):
        yield from _mcap_messages(part, numbers, findings)
        return
    for packet in map(plain, part.packets(list(numbers))):
        times = zip(packet.connection.tolist(), packet.log.view(np.uint64).tolist(), packet.messages, strict=True)
        for connection, log, data in times:
            yield numbers[connection], 0, log, log, data


def _copy_others(writer: Writer, part: McapContainer, findings: Findings) -> int:
    """Copy metadata and attachments; return how many there are that can be read."""
    count = 0
    for content in _records_of(part, Opcode.ATTACHMENT, Opcode.ATTACHMENT_INDEX):
        try:
            _copy_attachment(writer, content)
        except (ValueError, struct.error, McapError):
            findings.add(Finding(code="repair.attachment_damaged"))
        else:
            count += 1
    for content in _records_of(part, Opcode.METADATA, Opcode.METADATA_INDEX):
        with suppress(ValueError, struct.error, McapError):  # noted when the channels were looked for
            metadata = Metadata.read(ReadDataStream(BytesIO(content)))
            writer.add_metadata(metadata.name, metadata.metadata)
            count += 1
    return count


def _mcap_messages(part: McapContainer, numbers: Mapping[int, int], findings: Findings) -> Iterator[RawMessage]:
    unknown = 0
    for record, content in part.records():
        for channel, sequence, log, publish, data in _in_record(record, content):
            if channel in numbers:
                yield numbers[channel], sequence, log, publish, data
            else:
                unknown += 1
    if unknown:
        findings.add(Finding(code="repair.unknown_channels", value=unknown))


def _copy_attachment(writer: Writer, content: bytes) -> None:
    """Write an attachment again; ValueError where its checksum, 0 for none, does not match."""
    stated = int.from_bytes(content[-4:], "little")
    if stated and stated != zlib.crc32(content[:-4]):
        raise ValueError
    a = Attachment.read(ReadDataStream(BytesIO(content)))
    writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)


def _in_record(record: int, content: bytes) -> Iterator[RawMessage]:
    """Yield the messages in a chunk, or the one that a record is."""
    if record == Opcode.MESSAGE:
        yield *_MESSAGE_HEAD.unpack_from(content), content[_MESSAGE_HEAD.size :]
    if record == Opcode.CHUNK:
        found = messages_in(np.frombuffer(content, np.uint8), np.ones(2**16, dtype=np.bool_)).messages
        for start, length in zip(found.start.tolist(), found.length.tolist(), strict=True):
            head = _MESSAGE_HEAD.unpack_from(content, start - _MESSAGE_HEAD.size)
            yield *head, content[start : start + length]


def _records_of(part: McapContainer, wanted: int, index: int) -> Iterator[bytes]:
    """Yield the contents of the records of a kind: those between other records, and those only in the summary."""
    found = set()
    with part.open() as file:
        for record in Walk(file, kept=(wanted,)).records():
            found.add(record.position)
            yield record.content
        for kind, content in summary_records(file) or ():
            position, length = struct.unpack_from("<QQ", content) if kind == index else (0, 0)
            if Size.HEAD < length <= AT_ONCE_BYTES and position not in found:
                file.seek(position)
                raw = file.read(length)
                if raw[: Size.HEAD] == struct.pack("<BQ", wanted, length - Size.HEAD) and len(raw) == length:
                    yield raw[Size.HEAD :]


def _repair_table(source: Path, target: Path, rate: float | None) -> Repaired:
    """Write the columns of a table as topics; those without a time are left out and noted."""
    recording = read(source, rate=rate)
    timeless = {name for name, stream in recording.streams.items() if stream.time_source == "none"}
    timed = {name: channel for name, channel in recording.channels.items() if channel.stream not in timeless}
    if not timed:
        raise ReadError(f"{source}: has no time, and messages need one: give the sample rate with --rate, in Hz")
    found = (*recording.findings, *(Finding(code="repair.no_time", part=name) for name in timeless))
    recording = replace(recording, channels=timed)
    write_mcap(recording, target, units=True)
    topics = topics_of(recording)
    count = sum(topic.stamps.size for topic in topics)
    return Repaired(str(target), count, len(topics), tuple(map(sentence, found)), found)
