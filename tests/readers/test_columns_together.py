"""Messages that carry some of a topic's values: of several publishers, or one per joint."""

from __future__ import annotations

import json
import sqlite3

import numpy as np
import pytest
from random_messages import STORES
from rosbags import rosbag1
from write_logs import JOINT_STATE, MS, START, McapLog, at, joint_state, serialised

from vsalog.readers import read
from vsalog.rig.guess_names import meaning_of

COUNT = 40
ARM = ["a1", "a2", "a3", "a4", "a5", "a6", "a7"]


def mcap(path, sent):
    log = McapLog()
    for log_time, stamp, names, values in sent:
        log.add("/j", joint_state(stamp, names, values), log_time)
    return log.save(path)


def bag1(path, sent):
    with rosbag1.Writer(path) as writer:
        node = writer.add_connection("/j", JOINT_STATE, typestore=STORES[True])
        for log_time, stamp, names, values in sent:
            writer.write(node, log_time, serialised(joint_state(stamp, names, values, ros1=True), ros1=True))
    return path


def db3(path, sent):
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        database.execute("INSERT INTO topics VALUES (1, '/j', ?, 'cdr')", (JOINT_STATE,))
        rows = [(log_time, serialised(joint_state(stamp, names, values))) for log_time, stamp, names, values in sent]
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", rows)
    database.close()
    return path


def value(name, i):
    return float(100 * i + int(name[1:]))


def messages(groups, apart, stamped):
    """What publishers of some joints each send: (log time, header stamp, names, values), each so much after the one before."""
    sent = []
    for i in range(COUNT):
        for k, group in enumerate(groups):
            names = group[i % len(group) :] + group[: i % len(group)]  # in another order each time
            time = START + i * MS + k * apart
            sent.append((time, time if stamped else 0, names, [value(name, i) for name in names]))
    return sent


@pytest.mark.parametrize("write", [mcap, bag1, db3])
@pytest.mark.parametrize("apart", [0, MS // 20])
@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize(
    "groups", [[ARM, ["g1"]], [["a1", "a2"], ["b1"], ["c1", "c2", "c3"]], [[name] for name in ARM]]
)
def test_joints_that_come_in_messages_of_their_own_keep_all_their_samples(tmp_path, write, groups, apart, stamped):
    path = write(tmp_path / "log", messages(groups, apart, stamped))
    for recording in (read(path), read(path, room=0), read(path, [f"/j.position[{groups[0][0]}]"])):
        whole = len(recording.channels) > 2  # the sequence number in headers of ROS 1 is a channel, too
        assert len(recording.streams) == (len(groups) if whole else 1)
        for k, group in enumerate(groups if whole else [groups[0][:1]]):
            for name in group:
                channel = recording.channel(f"/j.position[{name}]")
                np.testing.assert_array_equal(channel.stamps, START + np.arange(COUNT) * MS + k * apart)
                np.testing.assert_array_equal(channel.values, [value(name, i) for i in range(COUNT)])
        for stream in recording.streams.values():
            assert (stream.count, stream.conflicts, stream.duplicates) == (COUNT, 0, 0)
        assert stamped == (not recording.findings)


def test_publishers_of_different_rates_have_streams_of_their_own(tmp_path):
    sent = []
    for i in range(400):
        sent.append((START + i * MS, START + i * MS, ["a", "b"], [i, -i]))
        if i % 10 == 0:  # a tenth of the other's rate, and between its samples
            sent.append((START + i * MS + MS // 2, START + i * MS + MS // 2, ["gripper"], [i]))
    recording = read(mcap(tmp_path / "log", sent))
    counts = {name: stream.count for name, stream in recording.streams.items()}
    assert counts == {"/j": 400, "/j (position[gripper] …)": 40}
    np.testing.assert_array_equal(recording.channel("/j.position[a]").values, np.arange(400))
    gripper = recording.channel("/j.position[gripper]")
    np.testing.assert_array_equal(gripper.stamps, START + np.arange(40) * 10 * MS + MS // 2)
    assert meaning_of(gripper).quantity == meaning_of(recording.channel("/j.position[a]")).quantity == "position"
    assert recording.findings == ()


def test_messages_of_the_same_stamp_that_complete_one_another_lose_nothing(tmp_path):
    sent = []
    for i in range(COUNT):
        both = [["a", "b"]] if i % 8 else [["a"], ["b"]]  # once in a while one after the other
        sent += [(START + i * MS, START + i * MS, names, [{"a": i, "b": -i}[n] for n in names]) for names in both]
    recording = read(mcap(tmp_path / "log", sent))
    assert set(recording.streams) == {"/j"}
    for name, sign in ("a", 1), ("b", -1):
        np.testing.assert_array_equal(recording.channel(f"/j.position[{name}]").values, sign * np.arange(COUNT))
    assert recording.findings == ()


def test_a_number_that_was_sent_as_nan_and_a_few_that_were_not_sent_stay_in_the_stream(tmp_path):
    log = McapLog()
    for i in range(COUNT):
        velocity = [np.nan if i % 2 else i, np.nan]
        effort = [] if i % 8 == 0 else [i, i]
        log.add("/j", joint_state(START + i * MS, ["a", "b"], [i, i], velocity, effort), START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    assert {name: stream.count for name, stream in recording.streams.items()} == {"/j": COUNT}
    i = np.arange(COUNT)
    np.testing.assert_array_equal(recording.channel("/j.velocity[a]").values, np.where(i % 2, np.nan, i))
    assert np.isnan(recording.channel("/j.velocity[b]").values).all()
    np.testing.assert_array_equal(recording.channel("/j.effort[b]").values, np.where(i % 8, i, np.nan))
    assert recording.findings == ()


def test_values_that_are_sent_seldom_have_a_stream_of_their_own(tmp_path):
    log = McapLog()
    for i in range(COUNT):
        stamp = {"sec": i // 10, "nanosec": i % 10 * 10**8}
        log.add_json("/q", {"timestamp": stamp, "q": i, **({"temperature": 20 + i} if i % 10 == 0 else {})}, START)
    recording = read(log.save(tmp_path / "log"), time="header")
    counts = {name: stream.count for name, stream in recording.streams.items()}
    assert counts == {"/q": COUNT, "/q (temperature …)": COUNT // 10}
    np.testing.assert_array_equal(recording.channel("/q.temperature").stamps, np.arange(4) * 10**9)


def test_what_comes_seldom_is_not_told(tmp_path):
    log = McapLog()
    for i in range(1200):
        log.add_json("/q", {"q": i, "tau": -i, **({"error": 3} if i == 600 else {})}, START + i * MS)
        log.add_json("/r", {"r": i} if i != 5 else {"state": 1}, START + i * MS)
        log.add_json("/s", {f"key{i}": i}, START + i * MS)
    assert read(log.save(tmp_path / "log")).findings == ()


def test_thousands_of_names_are_parts_no_more_than_can_be_separated(tmp_path):
    log = McapLog()
    for i in range(600):
        log.raw(log.channel("/q", "", encoding="json"), json.dumps({f"q{i}": i}).encode(), START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    assert len(recording.channels) == 600
    for i in range(600):
        assert at(recording.channel(f"/q.q{i}"), [START + i * MS]).tolist() == [i]


def test_headers_go_with_the_values_that_are_in_most_messages(tmp_path):
    log = McapLog()
    for i in range(COUNT):
        log.add_json("/q", {"header": {"seq": i}, "ab"[i % 4 == 0]: i}, START + i * MS)
        log.add_json("/h", {"header": {"seq": i}} if i % 2 else {"text": "none"}, START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    assert {name: stream.count for name, stream in recording.streams.items()} == {
        "/q": 3 * COUNT // 4,
        "/q (b …)": COUNT // 4,
        "/h": COUNT,
    }
    np.testing.assert_array_equal(recording.channel("/q.header.seq").values, recording.channel("/q.a").values)
