"""Fuzz target: the SQLite files of ROS 2 bags, alone and in a folder with metadata: rows of any kind, and changed bytes."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import suppress

import zstandard
from fuzz_contract import empty, exercise, put
from fuzz_frames import framed, frames

TOPIC, MESSAGE, DEFINITION, PATCH, SCHEMA, METADATA, COMPRESSED = range(7)
TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format, offered_qos_profiles);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type, encoding, encoded_message_definition);
"""


def one(data: bytes) -> None:
    """Read what the input makes: how to read it, whether in a folder, and frames (or bytes as they are)."""
    if len(data) < 2:
        return
    if data[1] & 1:
        exercise(put(data[2:], "log.db3"), data[0])
        return
    parts = frames(data[2:])
    content = assemble(parts)
    if content is None:
        return
    if data[1] & 4:
        content = zstandard.compress(content)
    if not data[1] & 2:
        exercise(put(content, "log.db3"), data[0])
        return
    folder = empty("bag")
    for kind, text in parts:
        if kind % 7 == METADATA:
            (folder / "metadata.yaml").write_bytes(text)
    (folder / "bag_0.db3").write_bytes(content)
    exercise(folder, data[0] & ~64)


def assemble(parts) -> bytes | None:
    """Put a database together; None where SQLite itself cannot."""
    database = sqlite3.connect(":memory:")
    with suppress(sqlite3.Error, sqlite3.Warning, OverflowError, UnicodeDecodeError):
        for sql in [p for k, p in parts if k % 7 == SCHEMA] or [TABLES.encode()]:
            text = sql.decode("utf-8", "replace").replace("\0", "")
            # What it does when it is read is of interest, not what it does when it is written.
            if not any(
                word in text.lower() for word in ("attach", "recursive", "pragma", "randomblob", "zeroblob", "vacuum")
            ):
                database.executescript(text[:4000])
    for kind, content in parts:
        with suppress(sqlite3.Error, OverflowError):
            if kind % 7 == TOPIC:
                database.execute("INSERT INTO topics VALUES (?, ?, ?, ?, '')", cells(content, 4))
            elif kind % 7 == MESSAGE:
                database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", cells(content, 3))
            elif kind % 7 == COMPRESSED:
                topic, stamp, message = cells(content, 3)
                packed = zstandard.compress(message if isinstance(message, bytes) else b"")
                database.execute(
                    "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", (topic, stamp, packed)
                )
            elif kind % 7 == DEFINITION:
                insert = (
                    "INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition) VALUES (?, ?, ?)"
                )
                database.execute(insert, cells(content, 3))
    try:
        database.commit()
        raw = bytearray(database.serialize())
    except sqlite3.Error:
        return None
    finally:
        database.close()
    for kind, content in parts:
        if kind % 7 == PATCH and len(content) > 4 and raw:
            at = struct.unpack_from("<I", content)[0] % len(raw)
            raw[at : at + len(content) - 4] = content[4:]
    return bytes(raw)


def cells(content: bytes, count: int) -> list:
    """Read values: a whole number, a real one, text, bytes or nothing."""
    found = []
    for kind, part in frames(content)[:count]:
        if kind == 0:
            found.append(int.from_bytes(part[:8].ljust(8, b"\0"), "little", signed=True))
        elif kind == 1:
            found.append(part.decode("utf-8", "replace"))
        elif kind == 2:
            found.append(part)
        else:
            found.append(struct.unpack("<d", part[:8].ljust(8, b"\0"))[0] if kind == 3 else None)
    return [*found, *([None] * count)][:count]


def row(*values) -> bytes:
    parts = []
    for value in values:
        if isinstance(value, int):
            parts.append((0, value.to_bytes(8, "little", signed=True)))
        else:
            parts.append((1, value.encode()) if isinstance(value, str) else (2, value))
    return framed(parts)


META = b"""rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  relative_file_paths:
    - bag_0.db3
  duration: {nanoseconds: 5}
  starting_time: {nanoseconds_since_epoch: 1}
  message_count: 5
  topics_with_message_count: []
  compression_format: zstd
  compression_mode: MESSAGE
"""


def seeds():
    """Yield inputs that are sound bags."""
    from random_messages import STORES
    from write_logs import JOINT_STATE, MS, START, joint_state, serialised

    definition = STORES[False].generate_msgdef(JOINT_STATE, ros_version=2)[0]
    parts = [
        (TOPIC, row(1, "/joints", JOINT_STATE, "cdr")),
        (TOPIC, row(2, "/number", "std_msgs/msg/Float64", "cdr")),
        (DEFINITION, row(JOINT_STATE, "ros2msg", definition)),
    ]
    for i in range(6):
        message = serialised(joint_state(START + i * MS, ["elbow", "knee"], [i, -i]))
        number = serialised(STORES[False].types["std_msgs/msg/Float64"](0.1 * i))
        parts += [(MESSAGE, row(1, START + i * MS, message)), (COMPRESSED, row(2, START + i * MS, number))]
    for how in (0x68, 0x38, 0x02):
        yield bytes([how, 0]) + framed(parts)
    yield bytes([0x28, 2]) + framed([*parts, (METADATA, META)])
    yield bytes([0x28, 6]) + framed([*parts, (METADATA, META.replace(b"MESSAGE", b"FILE"))])
    yield bytes([0x28, 0]) + framed([*parts, (PATCH, struct.pack("<I", 4096 + 3) + b"\0\7")])
    yield bytes([0x28, 0]) + framed([(SCHEMA, TABLES.encode()), *parts[:6]])
    whole = assemble(parts)
    assert whole is not None
    yield bytes([0x00, 1]) + whole
