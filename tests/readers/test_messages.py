"""The decoder against rosbags, over every message type that ROS ships."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from random_messages import STORES, make, numbers, same_number, stamp_of

from vsalog.readers.limits import MOST_PARTS, MOST_STEPS
from vsalog.readers.message_definitions import DefinitionError, parse_definition
from vsalog.readers.message_layout import DamagedMessageError, places_in
from vsalog.readers.messages import RosDecoder
from vsalog.readers.packets import Messages

UNSUPPORTED = ("wstring", "float128")


def serialise(store, message, name, ros1, little=True):
    if ros1:
        return bytes(store.serialize_ros1(message, name))
    return bytes(store.serialize_cdr(message, name, little_endian=little))


def definition(store, name, ros1):
    return store.generate_msgdef(name, ros_version=1 if ros1 else 2)[0]


@pytest.mark.parametrize("ros1", [False, True])
def test_every_type_decodes_as_rosbags_does(ros1):
    store = STORES[ros1]
    rng = np.random.default_rng(20)
    checked = 0
    for name in store.fielddefs:
        if name.startswith("builtin_interfaces/msg/"):
            continue
        root = parse_definition(name, definition(store, name, ros1), "msg", ros1)
        messages = [make(rng, store, name) for _ in range(2)]
        raws = [serialise(store, message, name, ros1, little) for message in messages for little in (True, False)]
        decoded = RosDecoder(root, not ros1, "t", None).decode(Messages.of(raws))
        assert decoded.good.all(), name
        for i, message in enumerate(m for m in messages for _ in range(2)):
            expected = numbers(store, message, name)
            got = {k.removeprefix("t."): v[i] for k, v in decoded.columns.items()}
            for path, value in expected.items():
                assert same_number(got.pop(path), value), (name, path)
            assert all(np.isnan(rest) for rest in got.values()), (name, got)
            if decoded.stamps is not None:
                stamp = message.header.stamp if hasattr(message, "header") else message.stamp
                assert decoded.stamps[i] == stamp_of(store, stamp)
            checked += len(expected)
    assert checked > 4000


def test_built_in_types_are_used_where_the_log_has_no_definition():
    store = STORES[False]
    rng = np.random.default_rng(1)
    message = make(rng, store, "sensor_msgs/msg/Imu")
    root = parse_definition("sensor_msgs/Imu", "", "", False)
    raw = serialise(store, message, "sensor_msgs/msg/Imu", False)
    decoded = RosDecoder(root, True, "/imu", None).decode(Messages.of([raw]))
    assert decoded.columns["/imu.angular_velocity.y"][0] == message.angular_velocity.y
    assert decoded.units["/imu.angular_velocity.y"] == "rad/s"
    assert decoded.units["/imu.linear_acceleration.x"] == "m/s^2"


def test_idl_definitions():
    idl = (
        f"{'=' * 80}\nIDL: a/msg/P\nmodule a {{ module msg {{ struct P {{ double x; float y; }}; }}; }};\n"
        f"{'=' * 80}\nIDL: a/msg/Q\nmodule a {{ module msg {{ struct Q {{ long n; a::msg::P p; }}; }}; }};\n"
    )
    root = parse_definition("a/msg/Q", idl, "idl", False)
    raw = b"\0\1\0\0" + np.array([7], "<i4").tobytes() + bytes(4) + np.array([1.5], "<f8").tobytes()
    raw += np.array([2.5], "<f4").tobytes()
    decoded = RosDecoder(root, True, "q", None).decode(Messages.of([raw]))
    assert {k: v[0] for k, v in decoded.columns.items()} == {"q.n": 7, "q.p.x": 1.5, "q.p.y": 2.5}


def test_windows_line_ends_in_a_definition():
    root = parse_definition("a/B", "float32 x\r\nfloat32 y # remark\r\n", "msg", True)
    decoded = RosDecoder(root, False, "b", None).decode(Messages.of([np.array([1, 2], "<f4").tobytes()]))
    assert decoded.columns["b.y"][0] == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("A again", "contains itself"),
        ("Missing m", "lacks the definition of a/msg/Missing"),
        ("wstring w", "wstring"),
        ("]]]", "not understood"),
    ],
)
def test_definitions_that_cannot_be_read_say_why(text, words):
    with pytest.raises(DefinitionError, match=words):
        parse_definition("a/A", text, "msg", False)


def test_damaged_messages_are_left_out():
    store = STORES[False]
    rng = np.random.default_rng(3)
    name = "sensor_msgs/msg/JointState"
    message = serialise(store, make(rng, store, name), name, False)
    root = parse_definition(name, "", "", False)
    huge = bytearray(message)
    huge[12:16] = b"\xff\xff\xff\x7f"  # length of the frame's name
    bad = [message[:-9], b"", message + bytes(8), bytes(huge), b"\0\7\0\0" + message[4:]]
    decoded = RosDecoder(root, True, "j", None).decode(Messages.of([*bad, message]))
    assert decoded.good.tolist() == [False] * 5 + [True]
    for raw in bad:
        with pytest.raises(DamagedMessageError):
            places_in(raw, root, True)


@pytest.mark.parametrize(
    ("of_one_length", "numbers_in_all"), [(1, MOST_STEPS), (MOST_PARTS, 500), (MOST_PARTS, MOST_STEPS)]
)
def test_more_shapes_than_are_remembered(monkeypatch, of_one_length, numbers_in_all):
    monkeypatch.setattr("vsalog.readers.messages.MOST_PARTS", of_one_length)
    monkeypatch.setattr("vsalog.readers.messages.MOST_STEPS", numbers_in_all)
    root = parse_definition("a/B", "uint8 n\nfloat64[] values\nstring tail", "msg", True)
    rng = np.random.default_rng(4)
    shapes = [(int(a), int(b)) for a, b in rng.integers(0, 30, (6 * MOST_PARTS, 2))]
    raws = []
    for count, tail in shapes:
        values = np.arange(count, dtype="<f8") + tail
        raws.append(
            bytes([count]) + np.array([count], "<u4").tobytes() + values.tobytes()
            + np.array([tail], "<u4").tobytes() + b"x" * tail
        )  # fmt: skip
    decoded = RosDecoder(root, False, "b", None).decode(Messages.of(raws))
    assert decoded.good.all()
    assert decoded.columns["b.n"].tolist() == [count for count, _ in shapes]
    for i in range(30):
        expected = [i + tail if i < count else np.nan for count, tail in shapes]
        got = decoded.columns.get(f"b.values[{i}]", np.full(len(raws), np.nan))
        np.testing.assert_array_equal(got, expected)


def test_only_wanted_fields_are_kept():
    store = STORES[False]
    name = "sensor_msgs/msg/Imu"
    raw = serialise(store, make(np.random.default_rng(5), store, name), name, False)
    root = parse_definition(name, "", "", False)
    decoded = RosDecoder(root, True, "/imu", {"/imu.orientation.w"}).decode(Messages.of([raw]))
    assert list(decoded.columns) == ["/imu.orientation.w"]


def test_names_in_another_order_in_every_message():
    store, name, rng = STORES[False], "sensor_msgs/msg/JointState", np.random.default_rng(6)
    log = []
    for _ in range(400):
        count = int(rng.integers(1, 30))
        names = [f"joint_{i}" for i in rng.permutation(count)]
        header = make(rng, store, "std_msgs/msg/Header")
        log.append(store.types[name](header, names, *rng.standard_normal((3, count))))
    root = parse_definition(name, "", "", False)
    raws = [serialise(store, message, name, False) for message in log]
    decoded = RosDecoder(root, True, "j", None).decode(Messages.of([*raws[:300], raws[0][:-9], *raws[300:]]))
    assert np.flatnonzero(~decoded.good).tolist() == [300]
    for i, message in zip((*range(300), *range(301, 401)), log, strict=True):
        expected = numbers(store, message, name)
        assert all(same_number(decoded.columns[f"j.{path}"][i], value) for path, value in expected.items())
        assert np.isfinite([values[i] for values in decoded.columns.values()]).sum() == len(expected)


@pytest.mark.parametrize("remember", [False, True])
@pytest.mark.parametrize("ros1", [False, True])
def test_seconds_beyond_2038(ros1, remember):
    """ROS 1 counts a date's seconds without a sign, those of a duration and its nanoseconds with one."""
    date, duration = ("time", "duration") if ros1 else ("builtin_interfaces/Time", "builtin_interfaces/Duration")
    root = parse_definition("a/msg/T", f"{date} stamp\n{date} when\n{duration} ago\n", "msg", ros1)
    seconds = 2**31 + 5
    raw = (b"" if ros1 else b"\0\1\0\0") + struct.pack("<IIIIii", seconds, 7, seconds, 500_000_000, -1, -250_000_000)
    decoded = RosDecoder(root, not ros1, "t", None, remember=remember).decode(Messages.of([raw] * 3))
    shown = seconds if ros1 else seconds - 2**32
    assert decoded.stamps.tolist() == [shown * 10**9 + 7] * 3
    assert decoded.columns["t.when"].tolist() == pytest.approx([shown + 0.5] * 3, abs=1e-6)
    ago = -1.25 if ros1 else -1 + (2**32 - 250_000_000) / 1e9
    assert decoded.columns["t.ago"].tolist() == pytest.approx([ago] * 3)


NAMED = f"J[] joints\nfloat64 last\n{'=' * 80}\nMSG: a/J\nfloat64 torque\nstring name\nfloat64[] pos\n"


def named_joints(joints):
    """A ROS 1 message of joints: (name, torque)."""
    raw = struct.pack("<I", len(joints))
    for name, torque in joints:
        raw += struct.pack("<dI", torque, len(name)) + name.encode() + struct.pack("<Id", 1, -torque)
    return raw + struct.pack("<d", 7)


@pytest.mark.parametrize("remember", [False, True])
def test_elements_that_tell_their_names_are_followed_by_them(remember):
    orders = [[("b", 10.0), ("a", 20.0)], [("a", 21.0), ("b", 11.0)], [("b", 12.0)], [("c", 30.0), ("a", 23.0)]]
    raws = [named_joints(joints) for joints in orders] * 3
    root = parse_definition("a/msg/T", NAMED, "msg", True)
    columns = RosDecoder(root, False, "t", None, remember=remember).decode(Messages.of(raws)).columns
    nan = np.nan
    for name, torque in ("a", [20, 21, nan, 23]), ("b", [10, 11, 12, nan]), ("c", [nan, nan, nan, 30]):
        np.testing.assert_array_equal(columns[f"t.joints[{name}].torque"], torque * 3)
        np.testing.assert_array_equal(columns[f"t.joints[{name}].pos[0]"], -np.array(torque * 3, dtype=float))
    assert columns["t.last"].tolist() == [7] * 12


def test_names_that_do_not_tell_elements_apart_are_not_taken_for_those_that_do():
    raws = [named_joints([("a", 1.0), (second, 2.0)]) for second in "aba"]
    root = parse_definition("a/msg/T", NAMED, "msg", True)
    columns = RosDecoder(root, False, "t", None).decode(Messages.of(raws)).columns
    np.testing.assert_array_equal(columns["t.joints[1].torque"], [2, np.nan, 2])
    np.testing.assert_array_equal(columns["t.joints[b].torque"], [np.nan, 2, np.nan])
