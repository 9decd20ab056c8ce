"""Fuzz target: definitions of messages, and messages that may or may not fit them."""

from __future__ import annotations

import struct

from fuzz_contract import exercise, put
from fuzz_frames import framed, frames, sized
from fuzz_mcap import assemble, text

ENCODINGS = (
    ("ros2msg", "cdr"), ("ros1msg", "ros1"), ("ros2idl", "cdr"), ("protobuf", "protobuf"), ("jsonschema", "json"),
)  # fmt: skip
NAME, DEFINITION, TOPIC, METADATA, MESSAGE = range(5)


def one(data: bytes) -> None:
    """Read a log of one topic; the frames are the type's name, its definition, the topic, metadata and the messages."""
    if len(data) < 2:
        return
    exercise(put(log_of(data[1], frames(data[2:])), "log.mcap"), data[0])


def log_of(flags: int, parts) -> bytes:
    """Put a log together; the flags choose the encoding and what is in a chunk."""
    language, encoding = ENCODINGS[flags % len(ENCODINGS)]
    kind, definition, topic, metadata, messages = b"a/msg/T", b"", b"/t", b"", []
    for number, content in parts:
        which = number % 5
        if which == NAME:
            kind = content
        elif which == DEFINITION:
            definition = content
        elif which == TOPIC:
            topic = content
        elif which == METADATA:
            metadata = content
        else:
            messages.append(content)
    schema = struct.pack("<H", 1) + sized(kind) + text(language) + sized(definition)
    unit = sized(sized(b"unit") + sized(metadata)) if metadata else text("")
    channel = struct.pack("<HH", 1, 1) + sized(topic) + text(encoding) + unit
    records = [(3, schema), (4, channel)]
    stamps = range(10**18, 10**18 + len(messages) * 10**6, 10**6)
    found = [(5, struct.pack("<HIQQ", 1, 0, t, t) + m) for t, m in zip(stamps, messages, strict=True)]
    if flags >= 128:
        found = [(6, bytes([1]) + framed(found))]
    return assemble(4, [*records, *found])


def seeds():
    """Yield topics of every encoding."""
    import numpy as np

    yield from _ros(np.random.default_rng(1))
    yield from _others()


def _ros(rng):
    from random_messages import STORES, make
    from write_logs import serialised

    kinds = (
        "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu", "std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float64",
        "geometry_msgs/msg/WrenchStamped", "trajectory_msgs/msg/JointTrajectory", "diagnostic_msgs/msg/DiagnosticArray",
    )  # fmt: skip
    for ros1 in (False, True):
        store = STORES[ros1]
        for kind in kinds:
            definition = store.generate_msgdef(kind, ros_version=1 if ros1 else 2)[0].encode()
            messages = [serialised(make(rng, store, kind), ros1) for _ in range(3)]
            parts = [(NAME, kind.encode()), (DEFINITION, definition), *((MESSAGE, m) for m in messages)]
            yield bytes([0x28, 1 if ros1 else 0]) + framed(parts)
    idl = b"module a { module msg { struct T { double x; sequence<float, 3> y; long z[2]; string s; }; }; };"
    message = b"\0\1\0\0" + struct.pack("<dI2f2iI", 0.5, 2, 1.0, 2.0, 3, 4, 2) + b"a\0"
    yield bytes([0x28, 2]) + framed([(DEFINITION, idl), (MESSAGE, message), (MESSAGE, b"\0\1\0\0")])
    own = b"builtin_interfaces/Time stamp\nfloat64[<=3] x\nstring<=5 name\nint8 A=1\nE[2] e\n" + b"=" * 80
    own += b"\nMSG: a/E\nint32 v\n"
    message = b"\0\1\0\0" + struct.pack("<iIIxxxxdI4s2i", 5, 6, 1, 0.5, 2, b"a\0\0\0", 7, 8)
    yield bytes([0x28, 0]) + framed([(DEFINITION, own), (MESSAGE, message), (MESSAGE, message[:-1])])


def _others():
    field = b"\x0a\x01x\x18\x01\x20\x01\x28\x01"  # double x = 1
    again = b"\x0a\x01m\x18\x02\x20\x03\x28\x0b\x32\x02.M"  # repeated M m = 2
    kind = b"\x0a\x01M" + b"".join(b"\x12" + bytes([len(f)]) + f for f in (field, again))
    file = b"\x0a\x01t" + b"\x22" + bytes([len(kind)]) + kind
    descriptors = b"\x0a" + bytes([len(file)]) + file
    messages = [b"\x09" + bytes(6) + b"\xf0\x3f", b"\x12\x09\x09" + bytes(8), b""]
    yield bytes([0x28, 3]) + framed([(NAME, b"M"), (DEFINITION, descriptors), *((MESSAGE, m) for m in messages)])
    texts = [b'{"header": {"stamp": {"sec": 5, "nanosec": 6}}, "a": [1, 2], "name": ["x", "y"], "position": [1, 2.5]}']
    texts += [b'{"a": NaN, "b": 1e999, "c": {"d": true, "e": null}}', b"[1, 2]", b'{"a": 12345678901234567890}']
    yield bytes([0x28, 4]) + framed([(MESSAGE, m) for m in texts])
