"""What an SQLite bag, its log of changes and its metadata say of how much there has to be."""

from __future__ import annotations

import shutil
import sqlite3
import struct

import numpy as np
import pytest
from finding_codes import codes, found, values_of
from rosbags import rosbag2
from test_bags import COUNT, write_bag2
from write_logs import MS, START, joint_state, serialised

from vsalog.readers import read, sampling
from vsalog.readers.sqlite_damage import damaged_changes, missing_bytes

ELBOW = "/joint_states.position[elbow]"


def incomplete(recording):
    return [one.evidence["topics"] for one in found(recording, "recording.topics_incomplete")]


def bag(folder, plugin=rosbag2.StoragePlugin.SQLITE3):
    folder = write_bag2(folder, plugin)
    (path,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    return path


def add(writer, begin, count):
    for i in range(begin, begin + count):
        message = serialised(joint_state(START + i * MS, ["elbow", "knee"], [i, -i]))
        writer.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (START + i * MS, message))
    writer.commit()


@pytest.mark.parametrize("folder", [True, False])
def test_fewer_messages_than_the_metadata_count_are_reported(tmp_path, folder):
    path = bag(tmp_path / "bag")
    log = path.parent if folder else path
    for part in read(log), read(log, time="log", start=0, end=0.01), read(log, wanted=[ELBOW]):
        assert not part.findings
    with sqlite3.connect(path) as database:
        database.execute(f"DELETE FROM messages WHERE timestamp >= {START + (COUNT - 3) * MS}")
    database.close()
    assert incomplete(read(log)) == [f"/joint_states {COUNT - 3} of {COUNT}"]
    assert not incomplete(read(log, wanted=["/none.x"]))


def test_a_bag_of_mcap_files_is_held_against_its_metadata_too(tmp_path):
    path = bag(tmp_path / "bag", rosbag2.StoragePlugin.MCAP)
    metadata = path.with_name("metadata.yaml")
    assert not read(path.parent).findings
    metadata.write_text(metadata.read_text().replace(f"message_count: {COUNT}", f"message_count: {COUNT + 5}"))
    for log in path, path.parent:
        assert incomplete(read(log)) == [f"/joint_states {COUNT} of {COUNT + 5}"] * (log is not path)


def test_metadata_as_ros_writes_them(tmp_path):
    path = bag(tmp_path / "bag")
    path.with_name("metadata.yaml").write_text(
        f"""rosbag2_bagfile_information:
  relative_file_paths:
    - {path.name}
  message_count: {COUNT + 8}
  topics_with_message_count:
    - topic_metadata:
        name: /tf
        type: tf2_msgs/msg/TFMessage
        offered_qos_profiles: "- history: 3\\n  depth: 0"
      message_count: 1
    - topic_metadata:
        name: "/joint_states"
        type: sensor_msgs/msg/JointState
        offered_qos_profiles:
          - history: keep_last
      message_count: {COUNT + 7}
  compression_format: ""
  files:
    - path: {path.name}
      message_count: 99999
"""
    )
    assert incomplete(read(path)) == [f"/tf 0 of 1, /joint_states {COUNT} of {COUNT + 7}"]


def test_a_sample_is_not_held_against_the_metadata(tmp_path, monkeypatch):
    path = bag(tmp_path / "bag")
    with sqlite3.connect(path) as database:
        add(database, COUNT, 500)
    database.close()
    metadata = path.with_name("metadata.yaml")
    metadata.write_text(metadata.read_text().replace(f"message_count: {COUNT}", f"message_count: {COUNT + 500}"))
    monkeypatch.setattr(sampling, "LOOK_BYTES", 2 * 4000)
    for log in path, path.parent:
        recording, sample = sampling.read_sample(log)
        assert sample is not None
        assert not incomplete(recording)


@pytest.mark.parametrize("cut", [1, 2, 50, 100, 4096])
def test_a_database_that_lacks_its_last_bytes_is_reported(tmp_path, cut):
    path = bag(tmp_path / "bag")
    assert missing_bytes(path) == []
    path.write_bytes(path.read_bytes()[:-cut])
    path.with_name("metadata.yaml").unlink()
    assert values_of(read(path), "recording.database_truncated") == [cut]


@pytest.fixture
def changed(tmp_path):
    """A bag whose recorder was killed: five times three messages are in its log of changes."""
    path = bag(tmp_path / "bag")
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA journal_mode=WAL")
    writer.execute("PRAGMA wal_autocheckpoint=0")
    for k in range(5):
        add(writer, COUNT + 3 * k, 3)
    (tmp_path / "killed").mkdir()
    for ending in ("", "-wal"):
        shutil.copy(f"{path}{ending}", tmp_path / "killed" / f"{path.name}{ending}")
    writer.close()
    return tmp_path / "killed" / path.name


def frames(raw):
    return range(32, len(raw), 24 + struct.unpack_from(">I", raw, 8)[0])


@pytest.mark.parametrize("place", [4, 8, 17, 24, 2000])
@pytest.mark.parametrize("frame", [0, 1, -2])
def test_messages_behind_damage_in_a_log_of_changes_are_reported(changed, place, frame):
    log = changed.with_name(f"{changed.name}-wal")
    raw = bytearray(log.read_bytes())
    assert damaged_changes(log) == []
    assert read(changed).channel(ELBOW).values.size == COUNT + 15
    assert not read(changed).findings
    raw[frames(raw)[frame] + place] ^= 0x10
    log.write_bytes(raw)
    recording = read(changed)
    assert recording.channel(ELBOW).values.size < COUNT + 15
    (damage,) = recording.findings
    assert (damage.code, damage.part) == ("recording.changes_damaged", log.name)


def test_a_damaged_head_of_a_log_of_changes_is_reported(changed):
    log = changed.with_name(f"{changed.name}-wal")
    sound = log.read_bytes()
    for place in range(32):
        raw = bytearray(sound)
        raw[place] ^= 1
        log.write_bytes(raw)
        recording = read(changed)
        assert recording.channel(ELBOW).values.size == COUNT
        assert "recording.changes_unreadable" in codes(recording)


def test_what_a_killed_recorder_leaves_is_no_damage(tmp_path, changed):
    log = changed.with_name(f"{changed.name}-wal")
    raw = log.read_bytes()
    log.write_bytes(raw[:-100])  # a page that was being written
    assert not read(changed).findings
    # Written back and begun again: frames of the first round remain behind those of the second.
    path = bag(tmp_path / "again")
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA journal_mode=WAL")
    add(writer, COUNT, 400)
    writer.execute("PRAGMA wal_checkpoint(FULL)")
    add(writer, COUNT + 400, 3)
    for ending in ("", "-wal"):
        shutil.copy(f"{path}{ending}", tmp_path / f"left.db3{ending}")
    writer.close()
    left = tmp_path / "left.db3-wal"
    salts = {left.read_bytes()[at + 8 : at + 16] for at in frames(left.read_bytes())}
    assert len(salts) == 2
    recording = read(tmp_path / "left.db3")
    np.testing.assert_array_equal(recording.channel(ELBOW).values, np.arange(COUNT + 403))
    assert not recording.findings
