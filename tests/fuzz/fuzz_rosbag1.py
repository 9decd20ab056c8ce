"""Fuzz target: ROS 1 bags, as they are or put together of records, compressed, with an index whose positions are right."""

from __future__ import annotations

import bz2
import struct
import tempfile
from pathlib import Path

import lz4.frame
from fuzz_contract import exercise, put
from fuzz_frames import framed, frames, sized

VERSION = b"#ROSBAG V2.0\n"
RECORD, CHUNK, INDEX = range(3)
COMPRESSIONS = (b"none", b"bz2", b"lz4")


def one(data: bytes) -> None:
    """Read what the input makes: how to read it, how to put it together, and frames (or bytes as they are)."""
    if len(data) < 2:
        return
    content = data[2:] if data[1] & 1 else assemble(data[1], frames(data[2:]))
    exercise(put(content, "log.bag"), data[0])


def assemble(flags: int, parts) -> bytes:
    """Put a bag together. Flags: 2 without an index, 4 cut off."""
    body, index = [], []
    for kind, content in parts:
        which = kind % 3
        target = index if which == INDEX else body
        target.append(chunk(content) if which == CHUNK else record(content))
    start = len(VERSION) + 4096 + sum(map(len, body))
    found = sum(b"op=\x07" in part[:64] for part in index)
    position = 0 if flags & 2 else start
    head = fields(
        op=b"\3", index_pos=struct.pack("<Q", position), conn_count=struct.pack("<I", found), chunk_count=bytes(4)
    )
    whole = VERSION + head + sized(b" " * (4096 - len(head) - 4)) + b"".join(body) + b"".join(index)
    return whole[: len(whole) * 3 // 4] if flags & 4 else whole


def record(content: bytes) -> bytes:
    """Return a record: the length of its header in two bytes, the header, and the data."""
    length = int.from_bytes(content[:2], "little")
    return sized(content[2 : 2 + length]) + sized(content[2 + length :])


def chunk(content: bytes) -> bytes:
    """Return a chunk: one byte says how it is compressed, the rest are frames of records."""
    how = content[0] if content else 0
    inner = b"".join(record(part) for _, part in frames(content[1:]))
    kind = COMPRESSIONS[how % 3]
    stored = {b"none": bytes, b"bz2": bz2.compress, b"lz4": lz4.frame.compress}[kind](inner)
    return fields(op=b"\5", compression=kind, size=struct.pack("<I", len(inner) + (how >> 6 & 1))) + sized(stored)


def fields(**values: bytes) -> bytes:
    return sized(b"".join(sized(name.encode() + b"=" + value) for name, value in values.items()))


def records(raw: bytes):
    """Yield header and data of the records in bytes."""
    at = 0
    while at + 8 <= len(raw):
        (length,) = struct.unpack_from("<I", raw, at)
        (size,) = struct.unpack_from("<I", raw, at + 4 + length)
        yield raw[at + 4 : at + 4 + length], raw[at + 8 + length : at + 8 + length + size]
        at += 8 + length + size


def taken_apart(raw: bytes, messages: int = 8):
    """Yield the frames of a bag, of each chunk its first records."""
    after = False
    for header, data in records(raw[len(VERSION) :]):
        if b"op=\x03" in header:
            continue
        if b"op=\x05" in header:
            kind = next(i for i, name in enumerate(COMPRESSIONS) if b"compression=" + name in header)
            plain = (bytes, bz2.decompress, lz4.frame.decompress)[kind](data)
            inner = [(RECORD, written(*one)) for one in records(plain)][:messages]
            yield CHUNK, bytes([kind]) + framed(inner)
            continue
        after = after or b"op=\x07" in header
        yield (INDEX if after else RECORD), written(header, data)


def written(header: bytes, data: bytes) -> bytes:
    return struct.pack("<H", len(header)) + header + data


def seeds():
    """Yield inputs that are sound bags."""
    from random_messages import STORES
    from rosbags import rosbag1
    from write_logs import MS, START, joint_state, serialised

    kinds = rosbag1.Writer.CompressionFormat
    for compression in (None, kinds.BZ2, kinds.LZ4):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "bag")
            writer = rosbag1.Writer(path)
            writer.chunk_threshold = 700
            if compression:
                writer.set_compression(compression)
            with writer:
                one_of = {}
                for i in range(8):
                    number = STORES[True].types["std_msgs/msg/Float64"](0.5 * i)
                    for topic, message in (
                        ("/joints", joint_state(START + i * MS, ["elbow", "knee"], [i, -i], ros1=True)),
                        ("/number", number),
                    ):
                        if topic not in one_of:
                            one_of[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORES[True])
                        writer.write(one_of[topic], START + i * MS, serialised(message, ros1=True))
            raw = path.read_bytes()
        yield bytes([0x00, 1]) + raw
        parts = list(taken_apart(raw))
        yield bytes([0x68, 0]) + framed(parts)
        yield bytes([0x38, 2]) + framed([p for p in parts if p[0] != INDEX])
        loose = [f for kind, content in parts if kind == CHUNK for f in frames(content[1:])]
        yield bytes([0x68, 2]) + framed(loose)
