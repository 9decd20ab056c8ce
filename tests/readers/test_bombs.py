"""Logs that promise more than any recording has: they are refused or passed by, within seconds and in little memory."""

from __future__ import annotations

import bz2
import json
import re
import sqlite3
import struct
import subprocess
import sys
import zlib
from io import BytesIO

import h5py
import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from random_messages import STORES
from write_logs import START, McapLog

GIB = 2**30
READ = """
import json, sys, time
from pathlib import Path
from vsalog.core.errors import ReadError
from vsalog.readers import read
for path in sorted(Path(sys.argv[1]).iterdir()):
    begin = time.perf_counter()
    try:
        recording = read(path)
        words = " ".join([*recording.notes, *recording.unread.values()])
    except ReadError as error:
        words = "refused: " + str(error)
    # What getrusage tells includes the process that started this one.
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    peak = int(status["VmHWM"].split()[0]) * 1024
    print(json.dumps([path.name, words, time.perf_counter() - begin, peak]))
"""


def record(kind, content):
    return struct.pack("<BQ", kind, len(content)) + content


def chunk(compression, data, size, checksum=0):
    head = struct.pack("<QQQII", 0, 0, size, checksum, len(compression)) + compression.encode()
    return record(6, head + struct.pack("<Q", len(data)) + data)


def text(words):
    return struct.pack("<I", len(words)) + words.encode()


def mcap(*records):
    magic = b"\x89MCAP0\r\n"
    return (
        magic + record(1, text("") + text("")) + b"".join(records) + record(15, bytes(4)) + record(2, bytes(20)) + magic
    )


def zeros(compressor, count):
    """Compress so many mebibytes of zeros."""
    return b"".join([*(compressor.compress(bytes(2**20)) for _ in range(count)), compressor.flush()])


def grown(compression, announced):
    """A chunk of zeros that are more than the chunk announces, or more than any has."""
    if compression == "zstd":
        data = zeros(zstandard.ZstdCompressor().compressobj(), 64)
    else:
        with lz4.frame.LZ4FrameCompressor() as compressor:
            data = compressor.begin() + zeros(compressor, 64)
    return mcap(chunk(compression, data, announced))


def fields(**values):
    parts = [name.encode() + b"=" + value for name, value in values.items()]
    head = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(head)) + head


def grown_bag(announced):
    data = zeros(bz2.BZ2Compressor(), 24)
    head = fields(op=b"\3", index_pos=bytes(8), conn_count=bytes(4), chunk_count=bytes(4)) + bytes(4)
    body = fields(op=b"\5", compression=b"bz2", size=struct.pack("<I", announced))
    return b"#ROSBAG V2.0\n" + head + body + struct.pack("<I", len(data)) + data


def many_channels(count):
    records = []
    for i in range(1, count + 1):
        schema = struct.pack("<H", i) + text(f"a/msg/T{i}") + text("ros2msg") + text(f"float64 x{i}")
        channel = struct.pack("<HH", i, i) + text(f"/t{i}") + text("cdr") + text("")
        records += [record(3, schema), record(4, channel)]
    return mcap(*records)


def many_connections(count):
    records = (
        fields(op=b"\7", conn=struct.pack("<I", i), topic=b"/t%d" % i) + struct.pack("<I", 0) for i in range(count)
    )
    return b"#ROSBAG V2.0\n" + b"".join(records)


def sparse():
    log = McapLog(profile="")
    for i in range(24_000):
        log.add_json("/sparse", {f"x{i % 4000}": i}, START + i)
    return log.bytes()


def json_log(topic, *messages):
    log = McapLog(profile="")
    for i, message in enumerate(messages):
        log.add_json(topic, message, START + i)
    return log.bytes()


def many_keys(value):
    """Objects whose members are all new in every message."""
    return json_log("/t", *({f"x{i}_{j}": value for j in range(8_000)} for i in range(50)))


def naming_one_another():
    """As many arrays that may name others as arrays they may name."""
    message = {f"t{i}": ["a", "b"] for i in range(8000)} | {f"x{i}": [1, 2, 3] for i in range(8000)}
    return json_log("/t", *[message] * 20)


def wide():
    """Few fields for one stream, but many for a log."""
    log = McapLog(profile="")
    for i in range(300):
        log.add_json(f"/t{i}", {f"x{j}": 1 for j in range(1000)}, START)
    return log.bytes()


def stated_units():
    """A unit for each of more fields than there are, and many messages."""
    log = McapLog(profile="")
    metadata = {f"unit:y{i}": "m" for i in range(50_000)}
    channel = log.writer.register_channel("/t", "json", 0, metadata)
    for i in range(500):
        log.raw(channel, json.dumps({f"x{j}": 1 for j in range(4000)}).encode(), START + i)
    return log.bytes()


def many_messages():
    message = record(5, struct.pack("<HIQQ", 1, 0, 1, 1) + b"\0\1\0\0" + bytes(8))
    schema = record(3, struct.pack("<H", 1) + text("std_msgs/msg/Float64") + text("ros2msg") + text("float64 data"))
    channel = record(4, struct.pack("<HH", 1, 1) + text("/x") + text("cdr") + text(""))
    data = message * 2_000_000
    return mcap(schema, channel, chunk("zstd", zstandard.compress(data), len(data), zlib.crc32(data)))


def defined(definition):
    """A thousand messages of some type, which do not fit it."""
    log = McapLog()
    channel = log.channel("/t", "a/T", encoding="ros1", language="ros1msg", text=definition)
    for i in range(1000):
        log.raw(channel, struct.pack("<I", 2**31 - i), START + i)
    return log.bytes()


def large_messages(path):
    """Write a database of images, larger together than the memory they may take."""
    kind, store = "std_msgs/msg/UInt8MultiArray", STORES[False]
    layout = store.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    raw = bytes(store.serialize_cdr(store.types[kind](layout, np.zeros(12 * 2**20, np.uint8)), kind))
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA synchronous = OFF")
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)")
        database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        database.execute("INSERT INTO topics VALUES (1, '/image', ?, 'cdr')", (kind,))
        database.executemany("INSERT INTO messages VALUES (?, 1, ?, ?)", ((i, START + i, raw) for i in range(1, 41)))
        database.commit()


def empty_parts():
    """Protobuf messages of two bytes for each of millions of objects, of a type that holds itself."""
    field = b"\x0a\x01m\x18\x01\x20\x03\x28\x0b\x32\x02.M"  # repeated M m = 1
    kind = b"\x0a\x01M\x12" + bytes([len(field)]) + field
    file = b"\x0a\x01t" + b"\x22" + bytes([len(kind)]) + kind
    log = McapLog(profile="")
    number = log.writer.register_schema("M", "protobuf", b"\x0a" + bytes([len(file)]) + file)
    channel = log.writer.register_channel("/t", "protobuf", number)
    for i, size in enumerate((7, 7, 9)):
        log.raw(channel, b"\x0a\x00" * (size * 2**19), START + i)
    return log.bytes()


def large_chunk():
    """A part of a MATLAB v7.3 variable that should be 2400 bytes."""
    file = BytesIO()
    with h5py.File(file, "w", userblock_size=512) as target:
        data = target.create_dataset("x", shape=(1, 300), dtype="f8", chunks=(1, 300), compression="gzip")
        data.attrs["MATLAB_class"] = np.bytes_("double")
        data.id.write_direct_chunk((0, 0), zeros(zlib.compressobj(), 300))
    return b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + file.getvalue()[128:]


def large_variable():
    """A MATLAB v5 variable of zeros."""
    head = (
        struct.pack("<4I", 6, 8, 6, 0) + struct.pack("<4I", 5, 8, 1, 300 * 2**17) + struct.pack("<2I", 1 << 16 | 1, 120)
    )
    head += struct.pack("<2I", 9, 300 * 2**20)
    compressor = zlib.compressobj()
    ahead = compressor.compress(struct.pack("<2I", 14, len(head) + 300 * 2**20) + head)
    raw = ahead + zeros(compressor, 300)
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<2I", 15, len(raw)) + raw


def large_page():
    """A table of one cell, which Arrow would decompress as a whole whether it is a signal or not."""
    file = BytesIO()
    cell = pa.array([bytes(300 * 2**20)], pa.binary())
    table = pa.table({"time": [0.0], "x": [1.0], "b": cell})
    pq.write_table(table, file, compression="zstd", use_dictionary=False, write_statistics=False)
    return file.getvalue()


RULE = "=" * 80 + "\nMSG: a/"
TYPES = "".join(f"{RULE}T{i}\nT{i + 1} x\nT{i + 1} y\n" for i in range(1, 30)) + f"{RULE}T30\n"
CHAIN = "".join(f"{RULE}T{i}\nT{i + 1} x\n" for i in range(300)) + f"{RULE}T300\nfloat64 x\n"
BOMBS = {
    "zstd-large": (lambda: grown("zstd", 2**31), "1 of 1 chunk damaged"),
    "zstd-more": (lambda: grown("zstd", 2**20), "1 of 1 chunk damaged"),
    "zstd-absurd": (lambda: grown("zstd", 2**62), "1 of 1 chunk damaged"),
    "lz4-large": (lambda: grown("lz4", 2**31), "1 of 1 chunk damaged"),
    "lz4-more": (lambda: grown("lz4", 2**20), "1 of 1 chunk damaged"),
    "bz2-large": (lambda: grown_bag(2**31), "1 of 1 chunk damaged"),
    "bz2-more": (lambda: grown_bag(100), "1 of 1 chunk damaged"),
    "channels": (lambda: many_channels(16_400), "refused.*16384 topics"),
    "connections": (lambda: many_connections(17_000), "refused.*16384 connections"),
    "sparse": (sparse, "refused.*unfolds"),
    "json-keys": (lambda: many_keys(1), "more than 4096 different fields"),
    "json-texts": (lambda: many_keys("a"), "text"),
    "json-parts": (lambda: json_log("/t", {f"x{i}": {"y": 1} for i in range(20_000)}), "more than 8192 parts"),
    "json-array": (lambda: json_log("/t", {"x": [0] * 2**20}), "array of 1048576 values"),
    "json-large": (lambda: json_log("/t", {"x": [0] * 2**22}), "larger than 4 MiB"),
    "json-deep": (lambda: json_log("/t", json.loads('{"x":' * 500 + "1" + "}" * 500)), "nested more than 32 deep"),
    "json-name": (lambda: json_log("/t", {"x" * 2**21: {f"x{i}": 1 for i in range(4000)}}), "longer than 256"),
    "json-names": (naming_one_another, "more than 8192 parts"),
    "topic-name": (lambda: json_log("/" + "t" * 2**21, {f"x{i}": 1 for i in range(4000)}), "more than 256 characters"),
    "field-name": (lambda: defined(f"E[64] x\n{RULE}E\nfloat64[64] {'x' * 2**16}\n"), "longer than 256"),
    "wide": (wide, "refused.*262144 channels"),
    "units": (stated_units, ""),
    "messages": (many_messages, "compressed so much"),
    "images": (large_messages, "array of 12582912 values"),
    "whole": (lambda: zeros(zstandard.ZstdCompressor().compressobj(), 128), "refused.*grows more than 1032 times"),
    "empty-parts": (empty_parts, "larger than 4 MiB"),
    "matlab-chunk": (large_chunk, "refused"),
    "matlab-variable": (large_variable, "refused.*more memory"),
    "parquet-page": (large_page, "refused.*compressed so much"),
    "recursive": (lambda: defined("T t"), "contains itself"),
    "doubling": (lambda: defined("T1 x\nT1 y\n" + TYPES), "no message fits"),
    "long": (lambda: defined("".join(f"float64 x{i}\n" for i in range(100_000))), "are not read"),
    "fixed-array": (lambda: defined("float64[1000000000] x"), "no message fits"),
    "claimed-array": (lambda: defined("float64[] x"), "no message fits"),
    "empty-elements": (lambda: defined(f"E[] x\n{RULE}E\n"), "no message fits"),
    "deep": (lambda: defined("T0 x\n" + CHAIN), "nested too deeply"),
}


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the peak of memory is told by /proc")


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What reading each bomb comes to, in one process whose memory is watched."""
    folder = tmp_path_factory.mktemp("bombs")
    for name, (content, _) in BOMBS.items():
        if content is large_messages:
            content(folder / name)
        else:
            (folder / name).write_bytes(content())
    done = subprocess.run([sys.executable, "-c", READ, str(folder)], capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    return {name: rest for name, *rest in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs(said, name):
    words, seconds, peak = said[name]
    assert re.search(BOMBS[name][1], words), words
    assert seconds < 20
    assert peak < GIB
