"""ROS 1 bags, walked from the start: bags without an index, cut off or with a bad chunk are read as far as they go."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from vsalog.errors import ReadError
from vsalog.readers.bag import Connection
from vsalog.readers.base import plural
from vsalog.readers.packets import PACKED, Packet, RawMessage, ahead, packet_of
from vsalog.readers.rosbag1_scan import messages_in

MAGIC = b"#ROSBAG V"
_SUPPORTED = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG_HEADER, _CHUNK, _CONNECTION = 2, 3, 5, 7
_MAX_HEADER = 2**24
_LENGTH = struct.Struct("<I")

Header = dict[bytes, bytes]


class Rosbag1Container:
    """One ROS 1 bag; see `vsalog.readers.bag.Container`.

    Raises
    ------
    ReadError
        The file cannot be opened, is encrypted or of an older version.
    """

    format = "rosbag1"
    has_publish = False
    rig_text: str | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self._damage: list[str] = []
        self._connections: dict[int, Connection] | None = None

    def connections(self) -> list[Connection]:
        """Return the bag's connections, from its index or else by walking the bag."""
        if self._connections is None:
            with self._open() as file:
                found = self._indexed(file)
            if not found:
                found = {}
                for header, data in self._records(noting=False):
                    inner = _chunk_records(data) if _op(header) == _CHUNK else [(header, data)]
                    for own, detail in inner:
                        if _op(own) == _CONNECTION:
                            _keep(found, own, detail)
            self._connections = found
        return list(self._connections.values())

    def counts(self) -> Mapping[int, int]:
        """Return nothing: the index would have to be walked for it."""
        return {}

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some connections in the order of the file; what is damaged is skipped and noted."""
        return ahead(self._packets(ids))

    def _packets(self, ids: Collection[int]) -> Iterator[Packet]:
        wanted = np.array(sorted(ids), dtype=np.int64)
        loose: list[RawMessage] = []  # outside of chunks
        for header, data in self._records():
            if loose and (_op(header) == _CHUNK or len(loose) >= PACKED):
                yield packet_of(loose)
                loose = []
            if _op(header) == _CHUNK:
                packet, whole = messages_in(np.frombuffer(data, np.uint8), wanted)
                if not whole:
                    self._damage.append("a record in a chunk is damaged")
                if len(packet.messages):
                    yield packet
                continue
            connection, time = header.get(b"conn", b""), header.get(b"time", b"")
            if _op(header) != _MESSAGE or len(connection) != 4 or len(time) != 8:
                continue
            number = _LENGTH.unpack(connection)[0]
            if number in wanted:
                seconds, fraction = struct.unpack("<II", time)
                loose.append((number, seconds * 1_000_000_000 + fraction, 0, data))
        if loose:
            yield packet_of(loose)

    def _open(self) -> IO[bytes]:
        try:
            file = self.path.open("rb")
        except OSError as error:
            raise ReadError(f"{self.path}: cannot be opened: {error.strerror or error}") from error
        version = file.readline(20)
        if version != _SUPPORTED:
            file.close()
            shown = version.decode("ascii", "replace").strip()
            raise ReadError(
                f"{self.path}: is a ROS bag of a version that is not supported ({shown});"
                " 'rosbag migrate' or 'rosbag fix' brings it to version 2.0"
            )
        return file

    def _indexed(self, file: IO[bytes]) -> dict[int, Connection]:
        """Return the connections in the index at the end; none where the bag has no index."""
        found: dict[int, Connection] = {}
        for header, _ in _walk(file, file.tell()):
            if header.get(b"encryptor"):
                raise ReadError(f"{self.path}: is encrypted; decrypt it first ('rosbag decrypt')")
            index = header.get(b"index_pos", b"")
            if len(index) != 8 or not 0 < struct.unpack("<Q", index)[0] < 2**62:
                return {}
            count = header.get(b"conn_count", b"")
            file.seek(struct.unpack("<Q", index)[0])
            for inner, data in _walk(file, file.tell()):
                if _op(inner) != _CONNECTION:
                    break
                _keep(found, inner, data)
            return found if len(count) == 4 and len(found) == _LENGTH.unpack(count)[0] else {}
        return found

    def _records(self, noting: bool = True) -> Iterator[tuple[Header, bytes]]:
        """Yield header and data of the records, those of a chunk decompressed; with `noting`, notes what was damaged."""
        chunks = 0
        self._damage.clear()
        with self._open() as file:
            for header, data in _walk(file, file.tell(), self._note):
                op = _op(header)
                if op == _BAG_HEADER and header.get(b"index_pos") == bytes(8):
                    self._note("the bag has no index (it was not closed properly): all that is in it was read")
                if op != _CHUNK:
                    yield header, data
                    continue
                chunks += 1
                try:
                    content = _decompressed(header, data)
                except Exception as error:  # compression libraries have their own exceptions
                    self._damage.append(str(error) or type(error).__name__)
                    continue
                yield header, content
        if self._damage and noting:
            count = f"{len(self._damage)} of {plural(chunks, 'chunk')}"
            self._note(f"{count} damaged, the rest was read ({self._damage[0]})")

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _walk(file: IO[bytes], start: int, note: Callable[[str], None] | None = None) -> Iterator[tuple[Header, bytes]]:
    """Yield header and data of the records from `start` to the end of the file or of what there is."""
    size = file.seek(0, 2)
    file.seek(start)
    position = start
    while position < size:
        record = _read_record(file, size)
        if record is None:
            if note:
                note(
                    f"the bag ends within its data, as when a recording is cut off: read up to byte {position}"
                    f" of {size}, the rest is left out"
                )
            return
        position = file.tell()
        yield record
        file.seek(position)


def _read_record(file: IO[bytes], size: int) -> tuple[Header, bytes] | None:
    """Return the next record's header and data, or None where it is cut off or nonsense."""
    head = file.read(4)
    if len(head) < 4:
        return None
    length = _LENGTH.unpack(head)[0]
    if length > min(_MAX_HEADER, size - file.tell()):
        return None
    header = _header(file.read(length))
    word = file.read(4)
    if header is None or len(word) < 4:
        return None
    count = _LENGTH.unpack(word)[0]
    if count > size - file.tell():
        return None
    return header, file.read(count)


def _chunk_records(content: bytes) -> Iterator[tuple[Header, bytes]]:
    """Yield header and data of the sound records in a chunk."""
    position, end = 0, len(content)
    while position + 8 <= end:
        start = position + 4
        stop = start + _LENGTH.unpack_from(content, position)[0]
        header = _header(content[start:stop]) if stop + 4 <= end else None
        if header is None:
            break
        position = stop + 4 + _LENGTH.unpack_from(content, stop)[0]
        if position > end:
            break
        yield header, content[stop + 4 : position]


def _header(raw: bytes) -> Header | None:
    """Split a record header into its fields, or None where it is nonsense."""
    fields: Header = {}
    position = 0
    while position < len(raw):
        if position + 4 > len(raw):
            return None
        end = position + 4 + _LENGTH.unpack_from(raw, position)[0]
        name, equals, value = raw[position + 4 : end].partition(b"=")
        if end > len(raw) or not equals:
            return None
        fields[name] = value
        position = end
    return fields


def _op(header: Header) -> int:
    value = header.get(b"op", b"")
    return value[0] if value else -1


def _decompressed(header: Header, data: bytes) -> bytes:
    """Return the records of a chunk.

    Raises
    ------
    ValueError
        The compression is unknown; damage has the exceptions of the compression libraries.
    """
    compression = header.get(b"compression", b"none")
    if compression == b"none":
        return data
    if compression == b"bz2":
        return bz2.decompress(data)
    if compression == b"lz4":
        from lz4.frame import decompress

        return bytes(decompress(data))
    raise ValueError(f"compression '{compression[:20].decode('ascii', 'replace')}' is not supported")


def _keep(found: dict[int, Connection], header: Header, data: bytes) -> None:
    """Add a connection record to `found`, unless it is damaged."""
    number = header.get(b"conn", b"")
    detail = _header(data)
    if len(number) != 4 or detail is None:
        return
    identity = _LENGTH.unpack(number)[0]
    found[identity] = Connection(
        id=identity,
        topic=header.get(b"topic", b"").decode("utf-8", "replace"),
        type=detail.get(b"type", b"").decode("utf-8", "replace"),
        encoding="ros1",
        language="msg",
        definition=detail.get(b"message_definition", b"").decode("utf-8", "replace"),
    )
