"""Protobuf channels of MCAP files, next to what was put into the messages; descriptors are made here, without a compiler."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from finding_codes import values_of
from google.protobuf import descriptor_pb2, descriptor_pool, duration_pb2, message_factory, timestamp_pb2
from hypothesis import given, settings
from hypothesis import strategies as st
from write_logs import MS, START, McapLog, at

from vsalog.core.memory import PIECE_BYTES
from vsalog.readers import read
from vsalog.readers.message_definitions import DefinitionError
from vsalog.readers.packets import Messages
from vsalog.readers.protobuf_messages import ProtobufDecoder

F = descriptor_pb2.FieldDescriptorProto
TYPES = {
    "double": st.floats(width=64),
    "float": st.floats(width=32),
    "int32": st.integers(-(2**31), 2**31 - 1),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "uint64": st.integers(0, 2**64 - 1),
    "sint32": st.integers(-(2**31), 2**31 - 1),
    "sint64": st.integers(-(2**63), 2**63 - 1),
    "fixed32": st.integers(0, 2**32 - 1),
    "fixed64": st.integers(0, 2**64 - 1),
    "sfixed32": st.integers(-(2**31), 2**31 - 1),
    "sfixed64": st.integers(-(2**63), 2**63 - 1),
    "bool": st.booleans(),
}
SHARED = {module.DESCRIPTOR.name: module.DESCRIPTOR for module in (timestamp_pb2, duration_pb2)}


class Schema:
    """Message types in the making: ``Schema().message("P", x="double", v="*double", p=".t.Q")``; * repeats, ? is optional."""

    def __init__(self, syntax="proto3", package="t"):
        self.file = descriptor_pb2.FileDescriptorProto(name="t.proto", package=package, syntax=syntax)

    def message(self, name, /, **fields):
        part = self.file.message_type.add(name=name)
        for number, (field, kind) in enumerate(fields.items(), 1):
            one = part.field.add(name=field, number=number)
            one.label = F.LABEL_REPEATED if kind[0] == "*" else F.LABEL_OPTIONAL
            if kind[0] == "?" and self.file.syntax == "proto3":
                one.proto3_optional, one.oneof_index = True, len(part.oneof_decl)
                part.oneof_decl.add(name=f"_{field}")
            kind = kind.lstrip("*?")
            if kind.startswith("."):
                one.type_name, one.type = kind, F.TYPE_MESSAGE
                library = {"Timestamp": "timestamp", "Duration": "duration"}.get(kind.rpartition(".")[2])
                if kind.startswith(".google.") and f"google/protobuf/{library}.proto" not in self.file.dependency:
                    self.file.dependency.append(f"google/protobuf/{library}.proto")
            else:
                one.type = F.Type.Value(f"TYPE_{kind.upper()}")
        return self

    def data(self, with_library=True):
        found = descriptor_pb2.FileDescriptorSet(file=[self.file])
        for name in self.file.dependency if with_library else ():
            SHARED[name].CopyToProto(found.file.add())  # behind what imports it: order is the reader's business
        return found.SerializeToString()

    def new(self, name):
        pool = descriptor_pool.DescriptorPool()
        for name_of_file in self.file.dependency:
            pool.AddSerializedFile(SHARED[name_of_file].serialized_pb)
        pool.Add(self.file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{self.file.package}.{name}"))


def decoded(schema, name, messages, wanted=None):
    decoder = ProtobufDecoder(f"{schema.file.package}.{name}", schema.data(), "/t", wanted)
    raws = [m if isinstance(m, bytes) else m.SerializeToString() for m in messages]
    return decoder.decode(Messages.of(raws)), decoder


def _schema_of_types():
    kinds = {kind: kind for kind in TYPES}
    schema = Schema().message("Part", x="double", n="int64")
    schema.message("Sink", **kinds, s="string", part=".t.Part")
    return schema.message("Deep", many="*.t.Part", sink=".t.Sink", **{f"r_{kind}": f"*{kind}" for kind in kinds})


SINK = _schema_of_types()
SINK_CLASS = SINK.new("Deep")
PART = st.fixed_dictionaries({"x": TYPES["double"], "n": TYPES["int64"]})
DEEP = st.fixed_dictionaries(
    {
        "many": st.lists(PART, max_size=3),
        "sink": st.fixed_dictionaries({**TYPES, "s": st.text(max_size=5)}, optional={"part": PART}),
        **{f"r_{kind}": st.lists(values, max_size=3) for kind, values in TYPES.items()},
    }
)


def flat(content, path):
    """Return path → number of what was put into a message."""
    if isinstance(content, dict):
        return {k: v for name, part in content.items() for k, v in flat(part, f"{path}.{name}").items()}
    if isinstance(content, list):
        return {k: v for i, part in enumerate(content) for k, v in flat(part, f"{path}[{i}]").items()}
    return {} if isinstance(content, str) else {path: float(content)}


@settings(max_examples=25, deadline=None)
@given(st.lists(DEEP, min_size=1, max_size=4))
def test_every_number_of_every_type_comes_back_bit_for_bit(contents):
    result, decoder = decoded(SINK, "Deep", [SINK_CLASS(**content) for content in contents])
    assert result.good.all()
    rows = [flat(content, "/t") for content in contents]
    assert set(result.columns) == {name for row in rows for name in row}
    for name, values in result.columns.items():
        expected = np.array([row.get(name, np.nan) for row in rows])
        np.testing.assert_array_equal(values, expected)
        known = ~np.isnan(expected)
        np.testing.assert_array_equal(np.signbit(values[known]), np.signbit(expected[known]))
    assert set(decoder.unread.values()) <= {"text"}


def test_a_log_with_stamps_joints_by_name_and_units(tmp_path):
    schema = Schema(package="robot").message(
        "Joints", timestamp=".google.protobuf.Timestamp", name="*string", position="*double", mode="int32"
    )
    joints = schema.new("Joints")
    log = McapLog(profile="")
    number = log.writer.register_schema("robot.Joints", "protobuf", schema.data())
    channel = log.writer.register_channel("/joints", "protobuf", number, {"unit:position": "deg"})
    names = [["elbow", "knee"], ["knee", "elbow"], []]
    for i in range(30):
        message = joints(name=names[i % 3], position=[{"elbow": i, "knee": -i}[n] for n in names[i % 3]], mode=i % 2)
        stamp = START + i * MS
        message.timestamp.seconds, message.timestamp.nanos = stamp // 10**9, stamp % 10**9
        log.raw(channel, message.SerializeToString(), stamp + 5 * MS)
    log.raw(channel, b"\xff", START + 40 * MS)
    recording = read(log.save(tmp_path / "log"))
    elbow = recording.channel("/joints.position[elbow]")
    assert (elbow.unit, elbow.type) == ("deg", "robot.Joints")
    i = np.arange(30)
    np.testing.assert_array_equal(at(elbow, START + i * MS), np.where(i % 3 < 2, i, np.nan))
    np.testing.assert_array_equal(recording.channel("/joints.mode").values, i % 2)
    assert set(recording.channels) == {"/joints.position[elbow]", "/joints.position[knee]", "/joints.mode"}
    assert recording.streams["/joints"].time_source == "header"
    assert not recording.unread
    assert values_of(recording, "recording.messages_damaged") == [1]
    one = read(tmp_path / "log", wanted=["/joints.mode"])
    assert list(one.channels) == ["/joints.mode"]


@pytest.mark.parametrize("kind", ["google", "own"])
def test_stamps_in_a_header(kind):
    time = ".google.protobuf.Timestamp" if kind == "google" else ".t.Time"
    schema = Schema().message("Time", sec="int64", nsec="int32").message("Header", stamp=time, n="uint32")
    schema.message("M", header=".t.Header", x="double", took=".google.protobuf.Duration")
    message = schema.new("M")(x=1.5)
    stamp = message.header.stamp
    for field, value in zip(("seconds", "nanos") if kind == "google" else ("sec", "nsec"), (17, 250), strict=True):
        setattr(stamp, field, value)
    message.took.seconds, message.took.nanos = 2, 500_000_000
    result, _ = decoded(schema, "M", [message, schema.new("M")(x=2)])
    assert result.stamps.tolist() == [17 * 10**9 + 250, 0]
    assert set(result.columns) == {"/t.header.n", "/t.x", "/t.took"}
    np.testing.assert_array_equal(result.columns["/t.took"], [2.5, np.nan])


@pytest.mark.parametrize("syntax", ["proto2", "proto3"])
def test_what_a_message_does_not_have_is_no_number(syntax):
    schema = Schema(syntax).message("P", x="double").message("M", plain="double", given="?double", part=".t.P")
    kind = schema.new("M")
    result, _ = decoded(schema, "M", [kind(given=0.0, plain=1.0), kind(part={})])
    implied = 0.0 if syntax == "proto3" else np.nan
    np.testing.assert_array_equal(result.columns["/t.plain"], [1.0, implied])
    np.testing.assert_array_equal(result.columns["/t.given"], [0.0, np.nan])
    if syntax == "proto3":
        np.testing.assert_array_equal(result.columns["/t.part.x"], [np.nan, 0.0])


def test_elements_that_tell_their_names_are_followed_by_them():
    schema = Schema().message("J", name="string", torque="double").message("M", joints="*.t.J")
    joints = [{"name": "a", "torque": 1.5}, {"name": "b", "torque": 2.5}]
    kind = schema.new("M")
    messages = [kind(joints=some) for some in (joints, joints[::-1], [joints[0]] * 2)]
    found, _ = decoded(schema, "M", messages)
    np.testing.assert_array_equal(found.columns["/t.joints[a].torque"], [1.5, 1.5, np.nan])
    np.testing.assert_array_equal(found.columns["/t.joints[b].torque"], [2.5, 2.5, np.nan])
    np.testing.assert_array_equal(found.columns["/t.joints[1].torque"], [np.nan, np.nan, 1.5])


def test_what_is_no_signal_is_listed_with_the_reason():
    schema = Schema().message("M", x="double", s="string", b="bytes", image="*uint32", e="int32", m="*.t.M.MEntry")
    entry = schema.file.message_type[0].nested_type.add(name="MEntry")
    entry.options.map_entry = True
    for number, (field, kind) in enumerate((("key", F.TYPE_STRING), ("value", F.TYPE_DOUBLE)), 1):
        entry.field.add(name=field, number=number, type=kind, label=F.LABEL_OPTIONAL)
    enum = schema.file.message_type[0].enum_type.add(name="E")
    enum.value.add(name="OFF", number=0)
    enum.value.add(name="ON", number=7)
    field = schema.file.message_type[0].field[4]
    field.type, field.type_name = F.TYPE_ENUM, ".t.M.E"
    message = schema.new("M")(x=1, s="a", b=b"b", image=range(65), e=7, m={"a": 1.0})
    result, decoder = decoded(schema, "M", [message])
    assert {name: values[0] for name, values in result.columns.items()} == {"/t.x": 1, "/t.e": 7}
    reasons = {"/t.s": "text", "/t.b": "bytes", "/t.image": "array of 65 values", "/t.m": "a map"}
    assert decoder.unread == reasons


def test_types_of_the_library_may_be_left_out():
    schema = Schema().message("M", timestamp=".google.protobuf.Timestamp", x="double")
    decoder = ProtobufDecoder("t.M", schema.data(with_library=False), "/t", None)
    message = schema.new("M")(x=2)
    message.timestamp.seconds = 3
    assert decoder.decode(Messages.of([message.SerializeToString()])).stamps.tolist() == [3 * 10**9]


def test_a_type_that_holds_itself_is_followed_so_far():
    schema = Schema().message("M", x="double", m=".t.M")
    message = top = schema.new("M")()
    for i in range(60):
        message.x = i
        message = message.m
    message.x = 60
    result, decoder = decoded(schema, "M", [top])
    assert [values[0] for values in result.columns.values()] == list(range(32))
    assert list(decoder.unread.values()) == ["nested more than 32 deep"]
    raw = b""
    for _ in range(500):  # deeper than the library follows
        raw = b"\x12" + bytes([*_varint(len(raw))]) + raw
    assert not decoded(schema, "M", [raw])[0].good.any()


def _varint(value):
    while value > 127:
        yield value & 127 | 128
        value >>= 7
    yield value


def test_field_names_of_the_library_are_names_like_others():
    names = ("HasField", "ListFields", "DESCRIPTOR", "FromString", "SerializeToString", "lambda", "seconds")
    schema = Schema().message("M", **dict.fromkeys(names, "double"))
    raw = b"".join(bytes([8 * (i + 1) + 1]) + np.float64(i + 1).tobytes() for i in range(len(names)))
    result, _ = decoded(schema, "M", [raw])
    assert {name: values[0] for name, values in result.columns.items()} == {
        f"/t.{n}": i + 1 for i, n in enumerate(names)
    }


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("t.M", b"\xff\xff", "damaged"),
        ("t.M", bytes(PIECE_BYTES + 1), "are not read"),
        ("t.Other", Schema().message("M", x="double").data(), "not complete or not sound"),
        ("t.M", Schema().message("M", x=".t.Missing").data(), "not complete or not sound"),
        ("", b"", "not complete or not sound"),
    ],
)
def test_descriptors_that_cannot_be_read_say_why(name, data, words):
    with pytest.raises(DefinitionError, match=words):
        ProtobufDecoder(name, data, "/t", None)


def test_files_that_import_one_another_are_refused():
    files = descriptor_pb2.FileDescriptorSet()
    for one, other in (("a", "b"), ("b", "a")):
        files.file.add(name=one, dependency=[other], package=one).message_type.add(name="M")
    with pytest.raises(DefinitionError, match="not complete or not sound"):
        ProtobufDecoder("a.M", files.SerializeToString(), "/t", None)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=200), st.integers(0, 2**31), st.integers(1, 255))
def test_damaged_descriptors_and_messages_are_no_crash(raw, place, flip):
    data = bytearray(SINK.data())
    data[place % len(data)] ^= flip
    try:
        decoder = ProtobufDecoder("t.Deep", bytes(data), "/t", None)
    except DefinitionError:
        decoder = ProtobufDecoder("t.Deep", SINK.data(), "/t", None)
    decoder.decode(Messages.of([raw, b""]))


def test_without_the_package_its_name_is_reported(tmp_path, monkeypatch):
    schema = Schema().message("M", x="double")
    log = McapLog(profile="")
    number = log.writer.register_schema("t.M", "protobuf", schema.data())
    log.raw(log.writer.register_channel("/t", "protobuf", number), b"", START)
    path = log.save(tmp_path / "log")
    assert read(path).channel("/t.x").values.tolist() == [0.0]
    for name in [name for name in sys.modules if name.startswith("google.protobuf")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "google.protobuf", None)
    recording = read(path)
    assert "vsalog[protobuf]" in recording.unread["/t"]
    assert not recording.channels


@pytest.mark.parametrize("path", ["header", ""])
def test_frames_by_turns_are_streams_of_their_own(tmp_path, path):
    schema = Schema().message("Header", stamp=".google.protobuf.Timestamp", frame_id="string")
    own = {"header": ".t.Header"} if path else {"timestamp": ".google.protobuf.Timestamp", "frame_id": "string"}
    schema.message("P", **own, x="double")
    kind, log = schema.new("P"), McapLog(profile="")
    channel = log.writer.register_channel(
        "/p", "protobuf", log.writer.register_schema("t.P", "protobuf", schema.data())
    )
    for i in range(60):
        for k, frame in enumerate(("left", "")):
            message = kind(x=i + 1000 * k)
            head = message.header if path else message
            head.frame_id = frame
            log.raw(channel, message.SerializeToString(), START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    for k, name in enumerate(("left", "unnamed")):
        np.testing.assert_array_equal(recording.channel(f"/p@{name}.x").values, np.arange(60) + 1000 * k)
