"""A part of a log whose streams have header stamps: only what may hold it is read, and it is what reading all would give."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from random_messages import STORES
from rosbags import rosbag1, rosbag2
from write_logs import START, McapLog, joint_state, serialised

from vsalog.core.errors import ReadError
from vsalog.readers import header_delays, mcap_walk, read, rosbag1_walk
from vsalog.readers.messages import RosDecoder
from vsalog.readers.time_window import cut

S = 10**9
COUNT, STEP, LATE = 3000, S // 5, S // 50
NAME = "/j.position[a]"


def plain(i):
    return START + i * STEP


def messages(stamp, ros1, rare=plain):
    """Yield topic, log time and message: 600 s of joints, and a topic with five messages."""
    for i in range(COUNT):
        yield "/j", START + i * STEP + LATE, joint_state(stamp(i), ["a"], [i], ros1=ros1)
        if i % 600 == 300:
            yield "/rare", START + i * STEP + LATE, joint_state(rare(i), ["b"], [i], ros1=ros1)


def write(kind, path, stamp=plain, rare=plain):
    if kind == "mcap":
        log = McapLog(chunk_size=4096)
        for topic, time, message in messages(stamp, False, rare):
            log.add(topic, message, time)
        return log.save(path)
    ros1 = kind == "rosbag1"
    if ros1:
        writer = rosbag1.Writer(path)
        writer.chunk_threshold = 4096
        writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
    else:
        writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
    with writer:
        topics = {}
        for topic, time, message in messages(stamp, ros1, rare):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORES[ros1])
            writer.write(topics[topic], time, serialised(message, ros1))
    return path


KINDS = pytest.mark.parametrize("kind", ["mcap", "rosbag1", "sqlite3"])


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Small logs are read like large ones."""
    monkeypatch.setattr("vsalog.readers.message_reader.LOOK_BYTES", 0)
    monkeypatch.setattr("vsalog.readers.topic_streams.PACKED_BYTES", 0)
    monkeypatch.setattr(header_delays, "LARGEST_LEAP", 2 * S)


@pytest.fixture
def decoded(monkeypatch):
    """How many messages were decoded, each time."""
    seen = []
    own = RosDecoder.decode
    monkeypatch.setattr(RosDecoder, "decode", lambda self, part: seen.append(len(part)) or own(self, part))
    return seen


def equal_to_the_whole(path, begin, end, wanted=None, time="auto"):
    whole = read(path, wanted, time)
    first = min(int(channel.stamps[0]) for channel in whole.channels.values())
    expected = cut(whole, first + round(begin * S), first + round(end * S))
    found = read(path, wanted, time, start=begin, end=end)
    assert found.channels.keys() == expected.channels.keys()
    for name, channel in expected.channels.items():
        np.testing.assert_array_equal(found.channel(name).stamps, channel.stamps)
        np.testing.assert_array_equal(found.channel(name).values, channel.values)
    assert found.unread.keys() == expected.unread.keys()
    times = {name: stream.time_source for name, stream in expected.streams.items()}
    assert {name: stream.time_source for name, stream in found.streams.items()} == times
    return found


@pytest.mark.every(5)
@KINDS
@pytest.mark.parametrize("time", ["auto", "header", "log"])
@pytest.mark.parametrize(("begin", "end"), [(100, 110), (0, 5), (595, 700), (61, 65)])
def test_little_more_is_read_than_asked_for(tmp_path, kind, time, begin, end, decoded):
    path = write(kind, tmp_path / "log")
    equal_to_the_whole(path, begin, end, time=time)
    decoded.clear()
    read(path, {NAME}, start=begin, end=end, time=time)
    samples = (COUNT if kind == "sqlite3" else 100 * 25) * (time != "log")  # small chunks are looked at as a whole
    assert sum(decoded) < 600 + samples * 6


@KINDS
def test_a_rare_stream_is_read_throughout(tmp_path, kind, monkeypatch):
    monkeypatch.setattr("vsalog.readers.container.SAMPLE_ROWS", 10)
    monkeypatch.setattr("vsalog.readers.rosbag2_sqlite.SAMPLE_ROWS", 10)
    path = write(kind, tmp_path / "log", rare=lambda i: plain(i) - 150 * S * (i == 900))
    found = equal_to_the_whole(path, 25, 35)
    assert found.channel("/rare.position[b]").values.tolist() == [900]


@pytest.mark.every(3)
@KINDS
@pytest.mark.parametrize(
    ("begin", "end", "stamp"),
    [
        pytest.param(300, 310, lambda i: plain(i) - 5 * S * (i > 1000 and i % 2), id="late"),
        pytest.param(301.05, 310.05, lambda i: plain(i) - 5 * S * (i > 1000), id="set back"),
        pytest.param(300, 310, lambda i: plain(i) + (7 * S if i % 50 == 7 else 0), id="now and then"),
        pytest.param(300, 310, lambda i: plain(i) if i % 2 else 0, id="zero"),
        pytest.param(300, 310, lambda i: START + 300 * S if 1480 < i < 1600 else plain(i), id="standing"),
        pytest.param(0, 10, lambda i: plain(0), id="always standing"),
        pytest.param(300, 310, lambda i: 5 * S + i, id="of another epoch"),
    ],
)
def test_stamps_that_are_not_as_they_should_be(tmp_path, kind, begin, end, stamp):
    equal_to_the_whole(write(kind, tmp_path / "log", stamp), begin, end)


def test_a_stream_that_stands_still_in_that_part_alone(tmp_path, monkeypatch):
    """It has three messages at a time, of one stamp: such a stream has the log's time, if these were all."""
    log = McapLog(chunk_size=1)
    for i in range(180):
        log.add("/j", joint_state(START + i // 3 * 10 * S, ["a"], [i]), START + i // 3 * 10 * S + i % 3)
    found = equal_to_the_whole(log.save(tmp_path / "log"), 295, 305)
    assert found.streams["/j"].time_source == "header"


def test_what_was_not_among_the_samples_is_noticed_where_it_is_read(tmp_path, monkeypatch, decoded):
    monkeypatch.setattr("vsalog.readers.container.SAMPLE_ROWS", 10)
    path = write("mcap", tmp_path / "log", lambda i: plain(i) - (100 * S if i == 1525 else 0))
    equal_to_the_whole(path, 300, 310)
    decoded.clear()
    read(path, {NAME}, start=300, end=310)
    assert sum(decoded) > COUNT


def test_a_bag_whose_index_contradicts_itself_is_read_as_a_whole(tmp_path):
    path = write("rosbag1", tmp_path / "log")
    raw = bytearray(path.read_bytes())
    (index,) = struct.unpack_from("<Q", raw, raw.index(b"index_pos=") + 10)
    at, changed = raw.find(b"end_time=", index), 0
    while at > 0:  # every other chunk claims to lie in the first second
        if changed % 2:
            raw[at + 9 : at + 17] = struct.pack("<II", START // S, START % S)
            begin = raw.index(b"start_time=", at - 100) + 11
            raw[begin : begin + 8] = raw[at + 9 : at + 17]
        at, changed = raw.find(b"end_time=", at + 1), changed + 1
    assert changed > 30
    path.write_bytes(raw)
    whole = read(path, time="log")
    found = read(path, time="log", start=300, end=310).channel(NAME)
    assert found.values.tolist() == list(range(1500, 1551))
    assert whole.channel(NAME).values.size == COUNT


@pytest.mark.parametrize("kind", ["mcap", "rosbag1"])
def test_the_beginning_of_a_late_stream_is_found_through_the_index(tmp_path, kind, monkeypatch):
    """The log's beginning is that of all its streams, and one of them may come at its very end."""
    path = write(kind, tmp_path / "log", rare=lambda i: plain(i) - 700 * S)
    unpacked = []
    for module in (mcap_walk, rosbag1_walk):
        own = module.decompress
        monkeypatch.setattr(module, "decompress", lambda k, d, n, own=own: unpacked.append(n) or own(k, d, n))
    read(path, {NAME})
    everything = sum(unpacked)
    unpacked.clear()
    part = read(path, {NAME}, start=700, end=710)
    assert part.channel(NAME).values.tolist() == list(range(300, 351))
    assert sum(unpacked) < 0.5 * everything


def test_nothing_there(tmp_path):
    path = write("rosbag1", tmp_path / "log")
    with pytest.raises(ReadError, match="its samples are from"):
        read(path, start=1000)
