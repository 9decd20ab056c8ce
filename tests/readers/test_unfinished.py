"""Logs as they come: without a profile, with IDL, still being written, with garbage behind their end."""

from __future__ import annotations

import numpy as np
import pytest
from finding_codes import codes
from mcap.writer import CompressionType
from random_definitions import Definition, FieldOf
from random_messages import STORES, make, numbers
from rosbags import rosbag1
from write_logs import MS, START, McapLog, at, joint_state, serialised

from vsalog.readers import open_container, open_reader, read

ELBOW = "/joint_states.position[elbow]"
IDL = Definition(
    (
        (FieldOf("header", "header"), FieldOf("name", "string", "*"), FieldOf("x", "float64", "*"), FieldOf("part", "a/T1")),
        (FieldOf("on", "bool"), FieldOf("v", "float32", "3"), FieldOf("few", "int16", "<=3")),
    )
)  # fmt: skip


def add(log, rows):
    for i in rows:
        log.add("/joint_states", joint_state(START + i * MS, ["elbow"], [i]), START + i * MS)


def elbow(recording):
    values = recording.channel(ELBOW).values
    np.testing.assert_array_equal(values, np.arange(values.size))
    return values.size


@pytest.mark.parametrize("profile", ["", "ros1", "something else"])
@pytest.mark.parametrize("ending", [0, -37])
def test_the_profile_does_not_matter(tmp_path, profile, ending):
    log = McapLog(profile=profile)
    add(log, range(50))
    path = log.save(tmp_path / "log")
    path.write_bytes(path.read_bytes()[: ending or None])
    assert elbow(read(path)) == 50


def test_a_log_with_idl_definitions(tmp_path):
    store, rng = IDL.store(ros1=False), np.random.default_rng(2)
    log = McapLog()
    messages = []
    for i in range(20):
        message = make(rng, store, "a/msg/T0")
        message.name, message.x = ["p", "q"], np.array([i, -i], float)
        message.header.stamp.sec, message.header.stamp.nanosec = 1_700_000_000, i * MS
        messages.append(message)
        channel = log.channel("/idl", "a/msg/T0", language="ros2idl", text=IDL.idl())
        log.raw(channel, bytes(store.serialize_cdr(message, "a/msg/T0")), START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    assert recording.streams["/idl"].time_source == "header"
    np.testing.assert_array_equal(recording.channel("/idl.x[q]").values, -np.arange(20.0))
    rows = [numbers(store, message, "a/msg/T0") for message in messages]
    assert {name.removeprefix("/idl.") for name in recording.channels} == {path for row in rows for path in row}
    stamps = 1_700_000_000 * 10**9 + np.arange(20) * MS
    for name, channel in recording.channels.items():
        expected = [row.get(name.removeprefix("/idl."), np.nan) for row in rows]
        np.testing.assert_array_equal(at(channel, stamps), expected)


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.NONE])
def test_a_log_whose_writer_has_not_finished(tmp_path, chunked, compression):
    log = McapLog(chunk_size=2048, use_chunking=chunked, compression=compression)
    path, seen = tmp_path / "log", []
    for part in np.split(np.arange(400), 4):
        add(log, part)
        path.write_bytes(log.file.getvalue())  # what the writer keeps to itself is not there yet
        recording = read(path)
        seen.append(elbow(recording))
        assert "recording.truncated" in codes(recording)
        assert open_reader(path).catalogue().channels.keys() == recording.channels.keys()
    assert all(100 * (k + 1) - 40 < count <= 100 * (k + 1) for k, count in enumerate(seen))
    assert seen == sorted(set(seen))
    path.write_bytes(log.bytes())
    recording = read(path)
    assert elbow(recording) == 400
    assert recording.findings == ()


@pytest.mark.parametrize("change", ["grows", "shrinks"])
def test_a_log_that_changes_while_it_is_read(tmp_path, change):
    log = McapLog(chunk_size=2048)
    add(log, range(400))
    raw, path = log.bytes(), tmp_path / "log"
    path.write_bytes(raw[: len(raw) // 2])
    container = open_container(path, "mcap")
    (connection,) = container.connections()
    container.findings.clear()
    times = []
    with path.open("r+b") as file:
        for k, packet in enumerate(container.packets([connection.id])):
            times += packet.log.tolist()
            if change == "grows":
                file.seek(0, 2)
                file.write(raw[file.tell() : file.tell() + 700])
                file.flush()
            else:
                file.truncate(len(raw) // 2 - 1500 * k)
    assert 60 < len(times) < 400
    assert times == [START + i * MS for i in range(len(times))]
    assert "recording.truncated" in codes(container)


@pytest.mark.parametrize("garbage", [b"\0" * 4096, bytes(range(256)) * 16, b"\xff" * 100, b"\4\0\0\0op=\5" * 50])
@pytest.mark.parametrize("closed", [True, False])
def test_a_ros1_bag_with_garbage_at_its_end(tmp_path, garbage, closed):
    path = tmp_path / "log.bag"
    with rosbag1.Writer(path) as writer:
        writer.chunk_threshold = 2048
        connection = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=STORES[True])
        for i in range(200):
            message = joint_state(START + i * MS, ["elbow"], [i], ros1=True)
            writer.write(connection, START + i * MS, serialised(message, ros1=True))
    raw = path.read_bytes()
    if not closed:  # as a recorder leaves it: without an index
        index = int.from_bytes(raw[raw.index(b"index_pos=") + 10 :][:8], "little")
        raw = raw[:index].replace(b"index_pos=" + index.to_bytes(8, "little"), b"index_pos=" + bytes(8))
    path.write_bytes(raw + garbage)
    recording = read(path)
    assert elbow(recording) == 200
    assert {"recording.truncated", "recording.bytes_skipped"} & {*codes(recording)}
    assert closed or "recording.no_index" in codes(recording)
