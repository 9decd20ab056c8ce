"""MCAP files, whole or damaged.

The file is walked from the start rather than by its index: a recording that was cut off has no index, and one bad chunk
must not hide those behind it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from vsalog.errors import ReadError
from vsalog.readers.bag import Connection
from vsalog.readers.base import plural
from vsalog.readers.mcap_scan import MESSAGE, ends_whole, messages_in, others_in
from vsalog.readers.packets import PACKED, Packet, RawMessage, ahead, packet_of

MAGIC = b"\x89MCAP0\r\n"
RIG_METADATA = "vsalog.rig"
RIG_KEY = "toml"

_FOOTER, _SCHEMA, _CHANNEL, _CHUNK, _METADATA, _DATA_END = 2, 3, 4, 6, 12, 15
_LANGUAGES = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl", "omgidl": "idl"}
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")


class McapContainer:
    """One MCAP file; see `vsalog.readers.bag.Container`.

    Raises
    ------
    ReadError
        The file cannot be opened or is no MCAP file.
    """

    format = "mcap"
    has_publish = True

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._counts: dict[int, int] = {}
        self._rig_text: str | None = None
        self._scanned = False

    @property
    def rig_text(self) -> str | None:
        """The rig in the metadata record ``vsalog.rig``, as TOML."""
        self._scan()
        return self._rig_text

    def connections(self) -> list[Connection]:
        """Return the file's channels."""
        self._scan()
        return [self._connection(channel) for channel in self._channels.values()]

    def counts(self) -> Mapping[int, int]:
        """Return how many messages channels have, as the summary at the end says."""
        self._scan()
        return self._counts

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some channels in the order of the file; what is damaged is skipped and noted."""
        wanted = np.zeros(2**16, dtype=np.bool_)
        wanted[list(ids)] = True
        return ahead(self._packets(wanted))

    def _packets(self, wanted: NDArray[np.bool_]) -> Iterator[Packet]:
        loose: list[RawMessage] = []  # outside of chunks
        for record, content in self._records():
            if loose and (record == _CHUNK or len(loose) >= PACKED):
                yield packet_of(loose)
                loose = []
            if record == _CHUNK:
                packet = messages_in(np.frombuffer(content, np.uint8), wanted)
                if len(packet.messages):
                    yield packet
            elif record == MESSAGE and len(content) >= _MESSAGE_HEAD.size:
                channel, _, log, publish = _MESSAGE_HEAD.unpack_from(content)
                if wanted[channel]:
                    loose.append((channel, log, publish, content[_MESSAGE_HEAD.size :]))
        if loose:
            yield packet_of(loose)

    def _connection(self, channel: Any) -> Connection:
        schema = self._schemas.get(channel.schema_id)
        return Connection(
            id=channel.id,
            topic=channel.topic,
            type=schema.name if schema else "",
            encoding=channel.message_encoding,
            language=_LANGUAGES.get(schema.encoding, "") if schema else "",
            definition=schema.data.decode("utf-8", "replace") if schema else "",
            metadata=channel.metadata,
        )

    def _scan(self) -> None:
        """Learn channels, schemas and the rig: from the summary at the end, or else by walking the file."""
        if self._scanned:
            return
        self._scanned = True
        if self._summary():
            return
        for record, content in self._records():
            if record == _CHUNK:
                for inner, own in others_in(np.frombuffer(content, np.uint8)):
                    self._keep(inner, own)
            else:
                self._keep(record, content)

    def _summary(self) -> bool:
        """Read the summary at the end of the file; False where it is missing, damaged or incomplete."""
        from mcap.reader import make_reader

        try:
            with self.path.open("rb") as file:
                summary = make_reader(file).get_summary()
                counts = summary.statistics if summary else None
                if summary is None or counts is None or counts.channel_count != len(summary.channels):
                    return False
                if any(c.schema_id and c.schema_id not in summary.schemas for c in summary.channels.values()):
                    return False
                if counts.metadata_count != len(summary.metadata_indexes):
                    return False
                for index in summary.metadata_indexes:
                    file.seek(index.offset)
                    record, length = _HEAD.unpack(file.read(_HEAD.size))
                    self._keep(record, file.read(min(length, index.length)))
        except Exception:  # damage anywhere in the summary: the walk will find what there is
            return False
        self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
        self._counts = {number: counts.channel_message_counts.get(number, 0) for number in summary.channels}
        return True

    def _keep(self, record: int, content: bytes) -> None:
        """Remember a channel, a schema or the rig."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Metadata, Schema

        try:
            stream = ReadDataStream(BytesIO(content))
            if record == _SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema
            elif record == _CHANNEL:
                channel = Channel.read(stream)
                self._channels[channel.id] = channel
            elif record == _METADATA:
                metadata = Metadata.read(stream)
                if metadata.name == RIG_METADATA:
                    self._rig_text = metadata.metadata.get(RIG_KEY)
        except Exception:  # a damaged record; its messages will be reported as missing
            self._note("a damaged channel, schema or metadata record was skipped")

    def _records(self) -> Iterator[tuple[int, bytes]]:
        """Yield the records of the data section, a chunk as its own records, decompressed; notes what was skipped."""
        chunks = 0
        damage: list[str] = []
        with _open(self.path) as file:
            for record, content, position in self._top_records(file, self._note):
                if record != _CHUNK:
                    yield record, content
                    continue
                chunks += 1
                try:
                    data = _chunk_data(content)
                except Exception as error:  # compression libraries have their own exceptions
                    damage.append(f"at byte {position}: {_words(error)}")
                    continue
                if not ends_whole(np.frombuffer(data, np.uint8)):
                    damage.append(f"at byte {position}: its last record is cut off")
                yield record, data
        if damage:
            self._note(
                f"{len(damage)} of {plural(chunks, 'chunk')} damaged, the rest was read ({'; '.join(damage[:3])})"
            )

    @staticmethod
    def _top_records(file: IO[bytes], note: Callable[[str], None]) -> Iterator[tuple[int, bytes, int]]:
        """Yield record, content and position up to the end of the data section or of what there is."""
        checksum = zlib.crc32(file.read(len(MAGIC)))
        size = file.seek(0, 2)
        file.seek(len(MAGIC))
        while True:
            position = file.tell()
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                break
            record, length = _HEAD.unpack(head)
            if length > size - file.tell() or record == 0:
                break
            content = file.read(length)
            if record == _DATA_END:
                stated = struct.unpack_from("<I", content)[0] if length >= 4 else 0
                if stated and stated != checksum:
                    note("the checksum of the data section does not match: some of its bytes have changed")
                return
            if record == _FOOTER:
                return
            checksum = zlib.crc32(content, zlib.crc32(head, checksum))
            yield record, content, position
        note(
            f"the file ends within its data, as when a recording is cut off: read up to byte {position}"
            f" of {size}, the rest is left out"
        )

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _open(path: Path) -> IO[bytes]:
    try:
        file = path.open("rb")
    except OSError as error:
        raise ReadError(f"{path}: cannot be opened: {error.strerror or error}") from error
    if file.read(len(MAGIC)) != MAGIC:
        file.close()
        raise ReadError(f"{path}: is no MCAP file")
    file.seek(0)
    return file


def _chunk_data(content: bytes) -> bytes:
    """Return the records of a chunk, decompressed, their checksum verified."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import get_chunk_data_stream

    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    if chunk.compression not in ("", "lz4", "zstd"):
        raise ValueError(f"compression '{chunk.compression[:20]}' is not supported")
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    return bytes(stream.read(length))


def _words(error: Exception) -> str:
    text = str(error).splitlines()
    return "checksum does not match" if "crc" in str(error).lower() else (text or [type(error).__name__])[0]
