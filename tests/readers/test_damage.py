"""Logs with changed bytes and cut off logs of every container: what can be read is right, and what is lost is reported.

Only some places are tried; ``VSALOG_DAMAGE_PLACES=1000 pytest tests/readers/test_damage.py`` tries so many of each log.
"""

from __future__ import annotations

import os
import shutil
import time

import numpy as np
import pytest
from mcap.writer import CompressionType
from random_messages import STORES
from rosbags import rosbag1, rosbag2
from write_logs import MS, START, McapLog, joint_state, serialised

from vsalog.core.errors import ReadError
from vsalog.readers import read

PLACES = int(os.environ.get("VSALOG_DAMAGE_PLACES", "12"))
COUNT = 240
LATE = 50_000
SECONDS = 20.0
ELBOW, KNEE, OTHER = "/joint_states.position[elbow]", "/joint_states.position[knee]", "/number.data"
FLOAT = "std_msgs/msg/Float64"


def messages(ros1):
    """Yield topic, log time and bytes: joints at i and -i, a number i * 0.1, both the i-th millisecond."""
    types = STORES[ros1].types
    for i in range(COUNT):
        stamp = START + i * MS
        yield "/joint_states", stamp + LATE, joint_state(stamp, ["elbow", "knee"], [i, -i], ros1=ros1)
        yield "/number", stamp + LATE, types[FLOAT](0.1 * i)


def write_mcap(path, **options):
    log = McapLog(**{"chunk_size": 2048, **options})
    for topic, stamp, message in messages(ros1=False):
        log.add(topic, message, stamp)
    log.save(path)


def write_rosbag1(path, compression=None):
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = 2048
    if compression:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for topic, stamp, message in messages(ros1=True):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORES[True])
            writer.write(connections[topic], stamp, serialised(message, ros1=True))


def write_rosbag2(path, storage):
    folder = path.with_name("folder")
    with rosbag2.Writer(folder, version=9, storage_plugin=storage) as writer:
        connections = {}
        for topic, stamp, message in messages(ros1=False):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORES[False])
            writer.write(connections[topic], stamp, serialised(message))
    (file,) = (file for file in folder.iterdir() if file.name != "metadata.yaml")
    file.rename(path)
    shutil.rmtree(folder)


Rosbag1 = rosbag1.Writer.CompressionFormat
LOGS = {
    "mcap-zstd": lambda path: write_mcap(path),
    "mcap-lz4": lambda path: write_mcap(path, compression=CompressionType.LZ4),
    "mcap-none": lambda path: write_mcap(path, compression=CompressionType.NONE),
    "mcap-loose": lambda path: write_mcap(path, use_chunking=False, enable_data_crcs=True),
    "rosbag1-none": lambda path: write_rosbag1(path),
    "rosbag1-bz2": lambda path: write_rosbag1(path, Rosbag1.BZ2),
    "rosbag1-lz4": lambda path: write_rosbag1(path, Rosbag1.LZ4),
    "sqlite3": lambda path: write_rosbag2(path, rosbag2.StoragePlugin.SQLITE3),
}
# Their contents have no checksum: a changed number in them is as good as any other.
TRUSTING = ("rosbag1-none", "rosbag1-lz4", "sqlite3")
IN_A_CHUNK = 64  # or on a page of SQLite
"""No more messages may be lost to one byte than a chunk, or a page, has."""

MAY_BE_REFUSED = {"sqlite3": 4096 * 12, "rosbag1": 13, "mcap": 8}
"""Where changes may make a whole log unreadable: at its head."""


@pytest.fixture(scope="module", params=LOGS)
def log(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("damage") / "log"
    LOGS[request.param](path)
    return request.param, path.read_bytes(), path


def read_soon(path):
    """Return the recording, or the words of its refusal."""
    begin = time.perf_counter()
    try:
        return read(path)
    except ReadError as error:
        return str(error)
    finally:
        assert time.perf_counter() - begin < SECONDS


def rightly_refused(words, kind, place, path):
    """Tell whether a damaged log was refused; only damage to its head may do that."""
    if not isinstance(words, str):
        return False
    assert words.startswith(str(path))
    assert place < MAY_BE_REFUSED[kind.partition("-")[0]], (place, words)
    return True


def wrong_and_found(recording):
    """Return how many samples of the recording were never recorded, and how many joints and numbers are right."""
    wrong, found = 0, []
    for names, factor in (((ELBOW, KNEE), (1, -1)), ((OTHER,), (0.1,))):
        right = np.zeros(0)
        for name, by in zip(names, factor, strict=True):
            if name not in recording.channels:
                continue
            channel = recording.channel(name)
            late = 0 if name != OTHER and recording.streams[channel.stream].time_source == "header" else LATE
            index = (channel.stamps - START - late) / MS
            good = (index == np.round(index)) & (index >= 0) & (index < COUNT) & (channel.values == by * index)
            wrong += int((~good).sum())
            right = index[good]
        found.append(right.astype(int))
    known = {ELBOW, KNEE, OTHER, "/joint_states.header.seq"}
    return wrong + sum(channel.values.size for name, channel in recording.channels.items() if name not in known), found


def test_the_whole_log(log):
    recording = read(log[2])
    assert recording.findings == ()
    wrong, (joints, numbers) = wrong_and_found(recording)
    assert wrong == 0
    np.testing.assert_array_equal(joints, np.arange(COUNT))
    np.testing.assert_array_equal(numbers, np.arange(COUNT))


def test_changed_bytes(log):
    kind, raw, path = log
    rng = np.random.default_rng(7)
    for place in rng.choice(len(raw), min(PLACES, len(raw)), replace=False).tolist():
        damaged = bytearray(raw)
        damaged[place] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        recording = read_soon(path)
        if rightly_refused(recording, kind, place, path):
            continue
        wrong, (joints, numbers) = wrong_and_found(recording)
        missing = 2 * COUNT - joints.size - numbers.size
        told = bool(recording.findings) or bool(recording.unread)
        if kind not in TRUSTING:
            assert not wrong or told, (place, wrong)
        assert not missing or told or wrong, (place, missing)
        if kind != "sqlite3" or place >= MAY_BE_REFUSED[kind]:
            assert missing <= (2 if kind == "mcap-loose" else IN_A_CHUNK), (place, missing)


def test_cut_off(log):
    kind, raw, path = log
    rng = np.random.default_rng(8)
    for place in sorted(rng.choice(len(raw), max(3, PLACES // 5), replace=False).tolist()):
        path.write_bytes(raw[:place])
        recording = read_soon(path)
        if rightly_refused(recording, kind, place, path):
            continue
        wrong, (joints, numbers) = wrong_and_found(recording)
        assert wrong <= 2 * (kind == "sqlite3")  # the row at the cut
        assert joints.size + numbers.size == 2 * COUNT or recording.findings
        if kind != "sqlite3":
            np.testing.assert_array_equal(joints, np.arange(joints.size))
            assert joints.size >= COUNT * place / len(raw) * 0.6 - 45
