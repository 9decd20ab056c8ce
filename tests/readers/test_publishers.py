"""Several publishers of one topic."""

from __future__ import annotations

from itertools import chain

import numpy as np
import pytest
from finding_codes import codes, found, values_of
from random_messages import STORES
from rosbags import rosbag1
from write_logs import JOINT_STATE, MS, START, McapLog, joint_state, serialised

from vsalog.readers import open_reader, read, topic_streams
from vsalog.readers.header_frames import Frames, header_frames
from vsalog.readers.json_messages import JsonDecoder
from vsalog.readers.limits import MOST_PARTS
from vsalog.readers.packets import Messages

COUNT = 40


def publications(joints, shift):
    """What two publishers send, the second one `shift` samples later: (which, time, joint, value)."""
    both = [
        (which, START + round((i + which * shift) * MS), joints[which], i + 1000 * which)
        for which in (0, 1)
        for i in range(COUNT)
    ]
    return sorted(both, key=lambda one: one[1])


def mcap(path, sent):
    log = McapLog()
    for which, time, joint, value in sent:
        log.add("/j", joint_state(time, [joint], [value]), time, again=which, metadata={"number": str(which)})
    return log.save(path)


def bag1(path, sent):
    with rosbag1.Writer(path) as writer:
        nodes = [writer.add_connection("/j", JOINT_STATE, typestore=STORES[True], callerid=f"/node{k}") for k in (0, 1)]
        for which, time, joint, value in sent:
            message = joint_state(time, [joint], [value], ros1=True)
            writer.write(nodes[which], time, serialised(message, ros1=True))
    return path


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("shift", [0, 0.5, 15])
@pytest.mark.parametrize(("write", "names"), [(mcap, "12"), (bag1, ["/node0", "/node1"])])
def test_the_same_joint_of_two_at_a_time_is_two_streams(tmp_path, monkeypatch, write, names, shift, large):
    if large:
        monkeypatch.setattr(topic_streams, "PACKED_BYTES", 0)
        monkeypatch.setattr("vsalog.readers.message_reader.LOOK_BYTES", 0)
    path = write(tmp_path / "log.bag", publications("aa", shift))
    for recording in (read(path), read(path, room=0), read(path, start=0)):
        assert set(recording.streams) == {f"/j@{name}" for name in names}
        assert values_of(recording, "recording.publishers_apart") == [2]
    for which, name in enumerate(names):
        values = read(path, wanted=[f"/j@{name}.position[a]"]).channel(f"/j@{name}.position[a]").values
        np.testing.assert_array_equal(values, np.arange(COUNT) + 1000 * which)
    assert {info.stream for info in open_reader(path).catalogue().channels.values()} == set(recording.streams)


@pytest.mark.parametrize("shift", [COUNT, COUNT - 2])
@pytest.mark.parametrize("write", [mcap, bag1])
def test_one_after_the_other_is_one_stream(tmp_path, write, shift):
    recording = read(write(tmp_path / "log.bag", publications("aa", shift)))
    assert set(recording.streams) == {"/j"}
    assert "recording.publishers_apart" not in codes(recording)


def framed(path, sent, ros1=False):
    """One channel that several publishers share: (frame, time, value) of each message."""
    messages = []
    for frame, time, value in sent:
        message = joint_state(time, ["a"], [value], ros1=ros1)
        message.header.frame_id = frame
        messages.append((time, message))
    if ros1:
        with rosbag1.Writer(path) as writer:
            node = writer.add_connection("/j", JOINT_STATE, typestore=STORES[True])
            for time, message in messages:
                writer.write(node, time, serialised(message, ros1=True))
        return path
    log = McapLog()
    for time, message in messages:
        log.add("/j", message, time)
    return log.save(path)


def of_two(frames, shift):
    both = [
        (frames[which], START + round((i + which * shift) * MS), i + 1000 * which)
        for which in (0, 1)
        for i in range(COUNT)
    ]
    return sorted(both, key=lambda one: one[1])


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize(
    ("frames", "names"), [(("left", "right"), ("left", "right")), (("", "imü"), ("unnamed", "imü"))]
)
def test_two_frames_at_a_time_in_one_channel_are_two_streams(tmp_path, monkeypatch, frames, names, ros1, large):
    if large:
        monkeypatch.setattr(topic_streams, "PACKED_BYTES", 0)
    path = framed(tmp_path / "log.bag", of_two(frames, 0.5), ros1)
    for recording in (read(path), read(path, room=0), read(path, start=0)):
        assert set(recording.streams) == {f"/j@{name}" for name in names}
        assert values_of(recording, "recording.publishers_apart") == [2]
        assert not any(reason == "no messages" for reason in recording.unread.values())
    for which, name in enumerate(names):
        channel = read(path, wanted=[f"/j@{name}.position[a]"]).channel(f"/j@{name}.position[a]")
        np.testing.assert_array_equal(channel.values, np.arange(COUNT) + 1000 * which)
        np.testing.assert_array_equal(channel.stamps, START + np.arange(COUNT) * MS + which * MS // 2)
    assert {info.stream for info in open_reader(path).catalogue().channels.values()} == set(recording.streams)


@pytest.mark.parametrize(
    "sent",
    [
        of_two(("left", "right"), COUNT),  # one after the other
        of_two(("left", "left"), 0.5),
        [("" if i in (3, 20) else "left", START + i * MS, i) for i in range(30)],  # not set up at first
        [("tool" if i in range(200, 300) else "left", START + i * MS, i) for i in range(400)],  # for a while
        [(f"frame{i}", START + i * MS, i) for i in range(100)],  # a counter
        [("x" * (300 + i % 2), START + i * MS, i) for i in range(100)],
    ],
)
def test_frames_that_are_no_publishers_are_one_stream(tmp_path, sent):
    recording = read(framed(tmp_path / "log", sent))
    assert set(recording.streams) == {"/j"}
    assert recording.channel("/j.position[a]").values.size == len(sent)
    assert "recording.publishers_apart" not in codes(recording)


def at(frame, times, base):
    """What a publisher sends: (frame, time, value), at some milliseconds."""
    return [(frame, START + round(t * MS), base + k) for k, t in enumerate(times)]


def in_time(*publishers):
    return sorted(chain(*publishers), key=lambda one: one[1])


BY_TURNS = {
    "1:30": in_time(at("left", range(600), 0), at("right", np.arange(20) * 30 + 0.5, 5000)),
    "1:30, same stamps": in_time(at("left", range(600), 0), at("right", np.arange(20) * 30, 5000)),
    "rare bursts": in_time(
        at("left", range(900), 0), at("right", [t + k / 20 for t in (200, 500, 800) for k in range(9)], 0)
    ),
    "rare, irregular": in_time(
        at("left", np.cumsum(np.random.default_rng(1).exponential(1, 800)), 0), at("right", range(9, 800, 40), 0)
    ),
    "bursts": [(f"{'left' if i // 10 % 2 else 'right'}", START + i * MS, i) for i in range(400)],
    "put together later": [*at("left", range(100), 0), *at("right", range(100), 1000)],
    "many": in_time(*(at(f"imu{k}", np.arange(9) + k / 100, 100 * k) for k in range(40))),
}


@pytest.mark.parametrize("sent", BY_TURNS.values(), ids=BY_TURNS)
@pytest.mark.parametrize("json", [False, True])
def test_frames_by_turns_are_streams_of_their_own(tmp_path, sent, json):
    path = (as_json if json else framed)(tmp_path / "log", sent)
    recording = read(path)
    for frame in {frame for frame, _, _ in sent}:
        own = sorted((time, value) for name, time, value in sent if name == frame)
        channel = recording.channel(f"/j@{frame}.{'value' if json else 'position[a]'}")
        assert [*zip(channel.stamps.tolist(), channel.values.tolist(), strict=True)] == own
    assert set(recording.streams) == {f"/j@{frame}" for frame, _, _ in sent}
    assert len(found(recording, "recording.publishers_apart")) == 1


@pytest.mark.parametrize("more", [1, 4])
def test_frames_beyond_those_separated_are_a_stream_together(tmp_path, more):
    names = [f"imu{k}" for k in range(MOST_PARTS + more)]
    sent = in_time(*(at(name, np.arange(6) + k / 1000, 100 * k) for k, name in enumerate(names)))
    recording = read(framed(tmp_path / "log", sent))
    assert set(recording.streams) == {*(f"/j@{name}" for name in names[:MOST_PARTS]), "/j"}


def as_json(path, sent, place="header"):
    log = McapLog()
    for frame, time, value in sent:
        stamp = {"sec": time // 10**9, "nanosec": time % 10**9}
        header = (
            {"header": {"frame_id": frame, "stamp": stamp}}
            if place == "header"
            else {"frame_id": frame, "timestamp": stamp}
        )
        log.add_json("/j", {**header, "value": float(value)}, time)
    return log.save(path)


def test_frames_next_to_the_values_of_json_are_reported(tmp_path):
    assert set(read(as_json(tmp_path / "log", BY_TURNS["1:30"], "")).streams) == {"/j@left", "/j@right"}


def test_frames_of_json_in_all_places():
    raws = [
        b'{"header": {"frame_id": "a"}, "frame_id": "b"}',
        b'{"frame_id": "b", "x": [1]}',
        b'{"header": 3, "frame_id": "b"}',
        b'{"header": {"frame_id": "a"}, "x": NaN}',
        b'{"header": {"stamp": 1}, "frame_id": "b"}',
        b'{"header": {"frame_id": 5}}',
        b'{"frame_id": null}',
        b'["frame_id"]',
        b'{"frame_id": ',
        b'{"x": 1}',
    ]
    frames = Frames()
    assert frames.numbers(JsonDecoder("/j", None).frames(Messages.of(raws))).tolist() == [0, 1, 1, 0] + 6 * [-1]
    assert frames.names == ["a", "b"]


@pytest.mark.parametrize("ros1", [False, True])
def test_a_frame_that_changes_for_a_moment_or_for_good_is_one_publishers(tmp_path, ros1):
    rng = np.random.default_rng(1)
    times = START + (np.arange(2000) + rng.uniform(-0.2, 0.2, 2000)) * MS
    for k, frames in enumerate(
        (
            ["left" if i < 900 else "right" for i in range(2000)],
            ["left" if i < 900 or i > 1200 else "right" for i in range(2000)],
            ["left" if i < 500 or 900 < i < 1200 else "right" for i in range(2000)],
        )
    ):
        sent = [(frame, round(time), i) for i, (frame, time) in enumerate(zip(frames, times, strict=True))]
        recording = read(framed(tmp_path / f"log{k}", sent, ros1))
        assert set(recording.streams) == {"/j"}
        assert recording.channel("/j.position[a]").values.size == len(sent)
        assert not recording.findings


def test_frames_in_messages_of_either_byte_order():
    messages = []
    for k in range(6):
        message = joint_state(START, ["a"], [k])
        message.header.frame_id = ("left", "r", "")[k % 3]
        messages.append(bytes(STORES[False].serialize_cdr(message, JOINT_STATE, little_endian=k < 3)))
    frames = Frames()
    found = frames.numbers(header_frames(Messages.of([*messages, messages[0][:18], messages[0][:14], b""]), cdr=True))
    assert [frames.names[k] for k in found[:6]] == 2 * ["left", "r", ""]
    assert found[6:].tolist() == [-1, -1, -1]
