"""Fuzz target: MCAP files, as they are or put together of records, with right checksums and a summary."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import lz4.frame
import zstandard
from fuzz_contract import exercise, put
from fuzz_frames import framed, frames, sized

MAGIC = b"\x89MCAP0\r\n"
CHUNK, DATA_END, SUMMARY = 6, 15, 0x80
"""Frames of kind SUMMARY plus a record's are put into the summary."""
COMPRESSIONS = ("", "zstd", "lz4", "zstd")
LONGEST = 4000
"""Records that are longer make no good seeds."""
SAMPLES = Path(__file__).parents[2] / "sample_logs"


def one(data: bytes) -> None:
    """Read what the input makes: how to read it, how to put it together, and frames (or bytes as they are)."""
    if len(data) < 2:
        return
    content = data[2:] if data[1] & 1 else assemble(data[1], frames(data[2:]))
    exercise(put(content, "log.mcap"), data[0])


def assemble(flags: int, parts) -> bytes:
    """Put a file together. Flags: 2 summary, 4 no checksum of the data, 8 cut off, 16 wrong checksums."""
    head = record(1, text("ros2") + text("fuzz"))
    data, summary, starts = [MAGIC + head], [], []
    size = len(MAGIC) + len(head)
    for kind, content in parts:
        if kind & SUMMARY:
            summary.append(record(kind & 0x7F, content))
            continue
        whole = record(CHUNK, chunk(content, bool(flags & 16))) if kind == CHUNK else record(kind, content)
        starts.append((kind, size, len(whole)))
        data.append(whole)
        size += len(whole)
    body = b"".join(data)
    checksum = 0 if flags & 4 else zlib.crc32(body)
    body += record(DATA_END, struct.pack("<I", checksum))
    if not flags & 2:
        tail = record(2, bytes(20))
    else:
        start = len(body)
        kept = b"".join(summary)
        footer = struct.pack("<BQQQ", 2, 20, start if kept else 0, 0)
        tail = kept + footer + struct.pack("<I", zlib.crc32(kept + footer))
    whole = body + tail + MAGIC
    return whole[: len(whole) * 3 // 4] if flags & 8 else whole


def chunk(content: bytes, wrong: bool) -> bytes:
    """Return a chunk's content: one byte says how it is compressed, the rest are frames of records."""
    how = content[0] if content else 0
    inner = b"".join(record(kind, part) for kind, part in frames(content[1:]))
    inner = inner[:-3] if how & 4 else inner
    size = len(inner) + (how >> 3 & 1)
    stored = {"": bytes, "zstd": zstandard.compress, "lz4": lz4.frame.compress}[COMPRESSIONS[how & 3]](inner)
    checksum = 0 if how & 16 else zlib.crc32(inner) + wrong & 0xFFFFFFFF
    times = (0, 0) if how & 32 else (0, 2**64 - 1)
    head = struct.pack("<QQQI", *times, size, checksum) + text(COMPRESSIONS[how & 3])
    return head + struct.pack("<Q", len(stored)) + stored


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def text(words: str) -> bytes:
    return sized(words.encode())


def records(data: bytes):
    """Yield kind and content of the records in bytes."""
    at = 0
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        yield kind, data[at + 9 : at + 9 + length]
        at += 9 + length


def taken_apart(raw: bytes, messages: int = 6):
    """Yield the frames of a file, of each chunk its first messages."""
    summary = False
    for kind, content in records(raw[8:-8]):
        if kind == DATA_END:
            summary = True
        elif kind == CHUNK:
            size, length = struct.unpack_from("<Q", content, 16)[0], struct.unpack_from("<I", content, 28)[0]
            name = content[32 : 32 + length].decode()
            stored = content[40 + length :]
            plain = {"": lambda b, _: b, "zstd": lambda b, n: zstandard.decompress(b, n), "lz4": lz4_plain}[name](
                stored, size
            )
            inner = list(records(plain))
            few = [r for r in inner if r[0] != 5] + [r for r in inner if r[0] == 5][:messages]
            yield CHUNK, bytes([COMPRESSIONS.index(name)]) + framed(few)
        elif kind not in (1, 2) and len(content) < LONGEST:
            yield (kind | SUMMARY if summary else kind), content


def lz4_plain(stored: bytes, _size: int) -> bytes:
    return lz4.frame.decompress(stored)


def seeds():
    """Yield inputs that are sound logs."""
    from mcap.writer import CompressionType
    from write_logs import MS, START, McapLog, joint_state

    logs = []
    for options in ({}, {"compression": CompressionType.LZ4}, {"use_chunking": False, "enable_data_crcs": True}):
        log = McapLog(chunk_size=600, **options)
        for i in range(6):
            log.add("/joint_states", joint_state(START + i * MS, ["elbow", "knee"], [i, -i], [i, 0]), START + i * MS)
            log.add_json("/json", {"a": i, "b": {"c": [1, 2.5]}, "stamp": START + i}, START + i * MS)
        logs.append(log.bytes())
    for raw in logs:
        yield bytes([0x00, 1]) + raw
        parts = list(taken_apart(raw))
        yield bytes([0x68, 2]) + framed(parts)
        yield bytes([0x38, 4]) + framed(parts)
    for name in ("vsa2_exp2", "awas_exp2"):
        yield bytes([0x68, 0]) + framed(list(taken_apart((SAMPLES / f"{name}.mcap").read_bytes(), 3))[:8])
