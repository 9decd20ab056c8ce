"""MCAP files, whole and damaged."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from finding_codes import codes, values_of
from hypothesis import given, settings
from hypothesis import strategies as st
from random_messages import STORES
from write_logs import MS, START, McapLog, at, joint_state, joints_mcap, serialised

from vsalog.core.errors import ReadError
from vsalog.readers import open_reader, read
from vsalog.readers.reach import Stamp


def test_joints_by_name_with_header_stamps(tmp_path):
    recording = read(joints_mcap(tmp_path / "log"))
    assert recording.format == "mcap"
    assert recording.absolute_time
    elbow = recording.channel("/joint_states.position[elbow]")
    np.testing.assert_array_equal(elbow.values, np.arange(100.0))
    np.testing.assert_array_equal(recording.channel("/joint_states.position[knee]").values, -np.arange(100.0))
    np.testing.assert_array_equal(elbow.stamps, START + np.arange(100) * MS)
    assert elbow.stamps.dtype == np.int64
    assert recording.channel("/joint_states.velocity[elbow]").stamps is elbow.stamps
    assert "/joint_states.effort[elbow]" not in recording.channels
    assert not any("frame_id" in name for name in [*recording.channels, *recording.unread])
    stream = recording.streams["/joint_states"]
    assert (stream.count, stream.time_source, stream.time_finding) == (100, "header", None)
    assert stream.delay_median == pytest.approx(1e-4)
    assert stream.delay_spread == pytest.approx(0, abs=1e-9)
    assert recording.findings == ()


def test_joints_that_come_go_and_change_places(tmp_path):
    log = McapLog()
    orders = [["a", "b"], ["b", "a"], ["b"], ["c", "a", "b"]]
    value = {"a": 1.0, "b": 2.0, "c": 3.0}
    for i in range(40):
        names = orders[i % 4]
        effort = [] if i % 3 else [10 * value[n] for n in names]
        log.add("/j", joint_state(START + i * MS, names, [value[n] + i for n in names], effort=effort), START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    i = np.arange(40)
    for name, present in (("a", i % 4 != 2), ("b", i >= 0), ("c", i % 4 == 3)):
        expected = np.where(present, value[name] + i, np.nan)
        np.testing.assert_array_equal(at(recording.channel(f"/j.position[{name}]"), START + i * MS), expected)
        torque = np.where(present & (i % 3 == 0), 10 * value[name], np.nan)
        np.testing.assert_array_equal(at(recording.channel(f"/j.effort[{name}]"), START + i * MS), torque)


def test_names_that_name_nothing_fall_back_to_the_index(tmp_path):
    log = McapLog()
    log.add("/a", joint_state(START, ["", ""], [1, 2]), START)
    log.add("/b", joint_state(START, ["x", "x"], [1, 2]), START)
    log.add("/c", joint_state(START, [], [1, 2]), START)
    recording = read(log.save(tmp_path / "log"))
    assert list(recording.channels) == [f"/{t}.position[{i}]" for t in "abc" for i in (0, 1)]
    assert {name for name, reason in recording.unread.items() if "empty or repeated" in reason} == {
        "/a.name",
        "/b.name",
    }


@pytest.mark.parametrize("bad", [["", "b"], ["x", "x", "b"]])
def test_a_bad_name_does_not_take_the_good_ones_away(tmp_path, bad):
    log = McapLog()
    for i in range(40):
        names = bad[:: (-1) ** i]
        log.add(
            "/j", joint_state(START + i * MS, names, [10 + i if name == "b" else -1 for name in names]), START + i * MS
        )
        log.add_json("/json", {"names": names, "q": [10 + i if name == "b" else -1 for name in names]}, START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    for name in ("/j.position[b]", "/json.q[b]"):
        np.testing.assert_array_equal(recording.channel(name).values, 10 + np.arange(40))
    assert "empty or repeated" in recording.unread["/j.name"]
    assert "empty or repeated" in recording.unread["/json.names"]


def test_dynamic_joint_state(tmp_path):
    text = (
        "std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values\n"
        + "=" * 80
        + "\nMSG: control_msgs/InterfaceValue\nstring[] interface_names\nfloat64[] values\n"
        + "=" * 80
        + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    )
    raw = Cdr().stamp(START).text("").texts(["elbow", "knee"]).word(2)
    raw.texts(["position", "effort"]).doubles([1.5, 2.5]).texts(["position"]).doubles([3.5])
    log = McapLog()
    log.raw(log.channel("/dyn", "control_msgs/msg/DynamicJointState", text=text), raw.data(), START)
    recording = read(log.save(tmp_path / "log"))
    assert {name: channel.values[0] for name, channel in recording.channels.items()} == {
        "/dyn.interface_values[elbow].values[position]": 1.5,
        "/dyn.interface_values[elbow].values[effort]": 2.5,
        "/dyn.interface_values[knee].values[position]": 3.5,
    }


def test_what_is_no_signal_is_listed_with_the_reason(tmp_path):
    log = McapLog()
    text = "uint8[] image\nfloat64[3] short\nstring remark\nbuiltin_interfaces/Duration d\nbool on\n"
    raw = Cdr().word(100).bytes(bytes(100)).doubles([1, 2, 3], counted=False).text("hello").word(2).word(500_000_000)
    log.raw(log.channel("/t", "a/msg/T", text=text), raw.bytes(b"\1").data(), START)
    log.raw(log.channel("/proto", "a.P", encoding="protobuf", language="protobuf", text="x"), b"x", START)
    log.raw(log.channel("/bad", "a/msg/Bad", text="]]"), b"x", START)
    log.channel("/never", "a/msg/Never", text="float64 x")
    recording = read(log.save(tmp_path / "log"))
    assert recording.unread["/t.image"] == "array of 100 values"
    assert recording.unread["/t.remark"] == "text"
    assert "descriptors of a.P are damaged" in recording.unread["/proto"]
    assert "not understood" in recording.unread["/bad"]
    assert recording.unread["/never"] == "no messages"
    values = {name: channel.values[0] for name, channel in recording.channels.items()}
    assert values == {"/t.short[0]": 1, "/t.short[1]": 2, "/t.short[2]": 3, "/t.d": 2.5, "/t.on": 1}


def test_only_wanted_channels(tmp_path):
    path = joints_mcap(tmp_path / "log")
    recording = read(path, wanted=["/joint_states.position[knee]", "/nothing.of[it]"])
    assert list(recording.channels) == ["/joint_states.position[knee]"]


def test_catalogue_lists_the_channels_of_a_full_read(tmp_path):
    path = joints_mcap(tmp_path / "log")
    catalogue = open_reader(path).catalogue()
    assert list(catalogue.channels) == list(read(path).channels)
    assert catalogue.channels["/joint_states.position[elbow]"].type == "sensor_msgs/msg/JointState"


def test_units_of_types_and_of_channel_metadata(tmp_path):
    types = STORES[False].types
    vector = types["geometry_msgs/msg/Vector3"]
    wrench = types["geometry_msgs/msg/Wrench"](vector(1, 2, 3), vector(4, 5, 6))
    log = McapLog()
    log.add("/w", wrench, START)
    log.add("/x", types["std_msgs/msg/Float64"](2.0), START, metadata={"unit": "mN*m"})
    log.add("/j", joint_state(START, ["a"], [1], [2]), START, metadata={"unit:position": "deg"})
    recording = read(log.save(tmp_path / "log"))
    assert recording.channel("/w.force.x").unit == "N"
    assert recording.channel("/w.torque.z").unit == "N*m"
    assert recording.channel("/x.data").unit == "mN*m"
    assert recording.channel("/j.position[a]").unit == "deg"
    assert recording.channel("/j.velocity[a]").unit is None


def test_rig_in_the_log(tmp_path):
    log = McapLog()
    log.add("/j", joint_state(START, ["a"], [1]), START)
    log.writer.add_metadata("vsalog.rig", {"toml": "rig = 'Ω'"})
    path = log.save(tmp_path / "log")
    assert open_reader(path).rig_text == "rig = 'Ω'"
    assert read(path).rig_text == "rig = 'Ω'"
    cut = tmp_path / "cut"
    cut.write_bytes(path.read_bytes()[:-40])
    assert open_reader(cut).rig_text == "rig = 'Ω'"


def test_json_messages(tmp_path):
    log = McapLog(profile="")
    for i in range(3):
        stamp = {"sec": 1_700_000_000, "nanosec": i * MS}
        content = {"header": {"stamp": stamp}, "name": ["a", "b"], "q": [i, 2 * i], "deep": {"x": [True]}, "s": "x"}
        log.add_json("/json", content, START + i)
    log.raw(log.channel("/json", "", encoding="json"), b"{broken", START + 9)
    recording = read(log.save(tmp_path / "log"))
    np.testing.assert_array_equal(recording.channel("/json.q[b]").values, [0, 2, 4])
    np.testing.assert_array_equal(recording.channel("/json.deep.x[0]").values, 1)
    assert recording.channel("/json.q[a]").stamps.tolist() == [1_700_000_000 * 10**9 + i * MS for i in range(3)]
    assert recording.unread["/json.s"] == "text"
    assert values_of(recording, "recording.messages_damaged") == [1]


def test_json_objects_that_tell_their_names(tmp_path):
    log = McapLog(profile="")
    for i in range(4):
        joints = [{"name": "a", "pos": i}, {"name": "b", "pos": 10 + i}]
        log.add_json(
            "/json",
            {"joints": joints[:: (-1) ** i], "other": [{"name": "x", "q": 1}, {"name": "x", "q": 2}]},
            START + i,
        )
    recording = read(log.save(tmp_path / "log"))
    np.testing.assert_array_equal(recording.channel("/json.joints[a].pos").values, np.arange(4))
    np.testing.assert_array_equal(recording.channel("/json.joints[b].pos").values, np.arange(10, 14))
    np.testing.assert_array_equal(recording.channel("/json.other[1].q").values, 2)


def test_json_with_numbers_that_json_has_not(tmp_path):
    log = McapLog(profile="")
    for i, value in enumerate((1.0, float("nan"), float("-inf"))):
        log.add_json("/json", {"q": value, "i": i, "s": "NaN"}, START + i)
        log.add_json("/nan", {"q": float("nan")}, START + i)
    log.raw(log.channel("/json", "", encoding="json"), b'{"q": NaN', START + 9)
    log.raw(log.channel("/broken", "", encoding="json"), b"[NaN]", START)
    recording = read(log.save(tmp_path / "log"))
    np.testing.assert_array_equal(recording.channel("/json.q").values, [1, np.nan, -np.inf])
    np.testing.assert_array_equal(recording.channel("/json.i").values, [0, 1, 2])
    assert np.isnan(recording.channel("/nan.q").values).all()
    assert recording.unread["/broken"] == "no message is a JSON object"
    assert values_of(recording, "recording.messages_damaged") == [1]


@pytest.mark.parametrize("others", [0, 50])
def test_json_beyond_numbers_and_characters_is_read_as_python_does(tmp_path, others):
    log = McapLog(profile="")
    channel = log.channel("/q", "", encoding="json")
    for i in range(others):
        log.raw(channel, b'{"q": %d, "tau": 1}' % i, START + i * MS)
    for i, raw in enumerate(
        [
            rb'{"q": 1e400, "tau": 2}',
            rb'{"q": -1e999, "tau": 2, "note": "\ud800"}',
            rb'{"q": 7, "tau": 2, "header": {"frame_id": "\udc80"}}',
            rb'{"q": 1e400, "tau": 2',
        ]
    ):
        log.raw(channel, raw, START + (others + i) * MS)
    recording = read(log.save(tmp_path / "log"))
    np.testing.assert_array_equal(recording.channel("/q.q").values, [*range(others), np.inf, -np.inf, 7])
    np.testing.assert_array_equal(recording.channel("/q.tau").values, [1] * others + [2] * 3)
    (unfit,) = recording.findings
    assert (unfit.code, unfit.part, unfit.value) == ("recording.messages_damaged", "/q", 1)
    assert unfit.evidence["messages"] == others + 4


def test_halves_of_characters_in_json_names_cannot_disturb_anything(tmp_path):
    log = McapLog(profile="")
    for i in range(40):
        frame = (rb"\ud800", b"right")[i % 2]
        raw = rb'{"\ud800": 1, "header": {"frame_id": "%s"}, "name": ["\udfff"], "x": [2]}' % frame
        log.raw(log.channel("/q", "", encoding="json"), raw, START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    assert sorted(channel.values.size for channel in recording.channels.values()) == [20] * 4
    assert all(text.encode() for text in (*recording.channels, *recording.streams, *recording.notes))


def test_one_topic_with_two_types(tmp_path):
    types = STORES[False].types
    log = McapLog()
    log.add("/t", types["std_msgs/msg/Float64"](1.0), START)
    log.add("/t", types["std_msgs/msg/Int32"](2), START)
    recording = read(log.save(tmp_path / "log"))
    assert list(recording.channels) == ["/t (std_msgs/msg/Float64).data", "/t (std_msgs/msg/Int32).data"]
    one = read(tmp_path / "log", wanted=["/t (std_msgs/msg/Int32).data"])
    assert one.channel("/t (std_msgs/msg/Int32).data").values.tolist() == [2]


@pytest.mark.parametrize("chunked", [True, False])
def test_a_log_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path, chunked):
    path = joints_mcap(tmp_path / "log", 200, chunk_size=4096, use_chunking=chunked)
    raw = path.read_bytes()
    counts = []
    for fraction in (0.2, 0.5, 0.8):
        path.write_bytes(raw[: int(len(raw) * fraction)])
        recording = read(path)
        values = recording.channel("/joint_states.position[elbow]").values
        counts.append(len(values))
        np.testing.assert_array_equal(values, np.arange(len(values)))
        assert "recording.truncated" in codes(recording)
    assert 0 < counts[0] < counts[1] < counts[2] < 200


def test_the_summary_may_be_missing(tmp_path):
    path = joints_mcap(tmp_path / "log", use_summary_offsets=False, use_statistics=False, repeat_channels=False)
    assert read(path).streams["/joint_states"].count == 100


def test_a_damaged_chunk_does_not_hide_the_others(tmp_path):
    path = joints_mcap(tmp_path / "log", 300, chunk_size=4096)
    raw = bytearray(path.read_bytes())
    at = chunk_positions(raw)[2]
    raw[at + 200] ^= 0x55
    path.write_bytes(raw)
    recording = read(path)
    values = recording.channel("/joint_states.position[elbow]").values
    assert 200 < len(values) < 300
    assert values[0] == 0
    assert values[-1] == 299
    assert "recording.chunks_damaged" in codes(recording)


def test_a_flipped_bit_outside_of_chunks_is_noticed(tmp_path):
    path = joints_mcap(tmp_path / "log", use_chunking=False, enable_data_crcs=True)
    raw = bytearray(path.read_bytes())
    raw[raw.index(struct.pack("<d", 42.0))] ^= 1
    path.write_bytes(raw)
    assert "recording.bad_checksum" in codes(read(path))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 2**31), max_size=20), st.integers(0, 2**16))
def test_damage_anywhere_is_no_crash(tmp_path_factory, places, seed):
    path = tmp_path_factory.mktemp("damage") / "log"
    raw = bytearray(joints_mcap(path, 30, chunk_size=1024).read_bytes())
    rng = np.random.default_rng(seed)
    for place in places:
        raw[8 + place % (len(raw) - 8)] = rng.integers(0, 256)
    path.write_bytes(raw)
    try:
        recording = read(path)
    except ReadError:
        return
    for channel in recording.channels.values():
        assert (np.diff(channel.stamps) > 0).all()
        assert len(channel.values) == len(channel.stamps)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(width=64), min_size=1, max_size=50), st.integers(0, Stamp.FARTHEST - 50))
def test_any_number_comes_back_exactly(tmp_path_factory, values, start):
    log = McapLog()
    for i, value in enumerate(values):
        log.add("/x", STORES[False].types["std_msgs/msg/Float64"](value), start + i)
    channel = read(log.save(tmp_path_factory.mktemp("exact") / "log")).channel("/x.data")
    assert channel.values.tobytes() == np.array(values).tobytes() or np.isnan(values).any()
    np.testing.assert_array_equal(channel.values, values)
    np.testing.assert_array_equal(channel.stamps, start + np.arange(len(values)))


def test_names_in_the_log_cannot_disturb_a_terminal(tmp_path):
    log = McapLog()
    log.add("/j\x1b[2J", joint_state(START, ["\x07bell"], [1]), START)
    (name,) = read(log.save(tmp_path / "log")).channels
    assert name.isprintable()


def chunk_positions(raw):
    """Return where the chunks start, by a walk over the top records."""
    found, at = [], 8
    while at < len(raw):
        record, length = struct.unpack_from("<BQ", raw, at)
        if record == 6:
            found.append(at)
        if record == 2:
            break
        at += 9 + length
    return found


class Cdr:
    """Little-endian CDR, written by hand."""

    def __init__(self):
        self.raw = bytearray()

    def _align(self, size):
        self.raw += bytes(-len(self.raw) % size)

    def word(self, value):
        self._align(4)
        self.raw += struct.pack("<I", value)
        return self

    def stamp(self, nanoseconds):
        return self.word(nanoseconds // 10**9).word(nanoseconds % 10**9)

    def text(self, value):
        self.word(len(value) + 1)
        return self.bytes(value.encode() + b"\0")

    def texts(self, values):
        self.word(len(values))
        for value in values:
            self.text(value)
        return self

    def doubles(self, values, counted=True):
        if counted:
            self.word(len(values))
        self._align(8)
        self.raw += np.asarray(values, "<f8").tobytes()
        return self

    def bytes(self, value):
        self.raw += value
        return self

    def data(self):
        return b"\0\1\0\0" + bytes(self.raw)


def test_the_hand_written_cdr_is_what_rosbags_writes():
    message = joint_state(START, ["a", "bc"], [1, 2], [3, 4])
    raw = Cdr().stamp(START).text("base").texts(["a", "bc"]).doubles([1, 2]).doubles([3, 4]).word(0)
    assert raw.data() == serialised(message)


@pytest.mark.parametrize("start", [3, 2**40, 2**63, 2**64 - 1])
def test_a_footer_that_points_anywhere_is_passed_by(tmp_path, start):
    path = joints_mcap(tmp_path / "log")
    raw = bytearray(path.read_bytes())
    struct.pack_into("<Q", raw, len(raw) - 28, start)
    path.write_bytes(raw)
    assert read(path).streams["/joint_states"].count == 100


def test_large_robots_and_many_topics_are_read(tmp_path):
    """Twenty robots of 300 joints, three values each, next to 5000 topics of one value."""
    log = McapLog()
    names = [f"joint_{k}" for k in range(300)]
    for robot in range(20):
        values = robot + np.arange(300) / 1000
        log.add(f"/r{robot}/joint_states", joint_state(START, names, values, -values, 2 * values), START)
    for k in range(5000):
        log.add_json(f"/t{k}", {"value": k}, START)
    recording = read(log.save(tmp_path / "log"))
    assert len(recording.channels) == 20 * 300 * 3 + 5000
    assert recording.channel("/r19/joint_states.velocity[joint_299]").values.tolist() == [-19.299]
    assert recording.channel("/t4999.value").values.tolist() == [4999]
