"""Several logs in one file, as `cat a.mcap b.mcap` makes it: the first is read, and the others do not get into it."""

from __future__ import annotations

import numpy as np
import pytest
from finding_codes import codes
from mcap.writer import CompressionType, IndexType
from random_messages import STORES
from rosbags import rosbag1
from write_logs import JOINT_STATE, MS, START, McapLog, joint_state, serialised

from vsalog.readers import read

COUNT = 300
BARE = {
    "index_types": IndexType.NONE,
    "use_statistics": False,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_summary_offsets": False,
    "enable_data_crcs": False,
}


def mcap(path, topic, begin, **options):
    """The topics of all these logs have the same number in them."""
    log = McapLog(**options)
    for i in range(begin, begin + COUNT):
        log.add(topic, joint_state(START + i * MS, ["x"], [i]), START + i * MS)
    return log.save(path)


def bag1(path, topic, begin):
    with rosbag1.Writer(path) as writer:
        node = writer.add_connection(topic, JOINT_STATE, typestore=STORES[True])
        for i in range(begin, begin + COUNT):
            message = joint_state(START + i * MS, ["x"], [i], ros1=True)
            writer.write(node, START + i * MS, serialised(message, ros1=True))
    return path


def joined(folder, write, *logs, **options):
    raws = [write(folder / f"part{k}", *log, **options).read_bytes() for k, log in enumerate(logs)]
    path = folder / "log"
    path.write_bytes(b"".join(raws))
    return path, raws


def assert_all_there(recording, logs):
    assert set(recording.streams) == {topic for topic, _ in logs}
    for topic in recording.streams:
        expected = np.concatenate([np.arange(begin, begin + COUNT) for name, begin in logs if name == topic])
        np.testing.assert_array_equal(recording.channel(f"{topic}.position[x]").values, expected)


OPTIONS = [
    {},
    {"enable_crcs": False},
    {"compression": CompressionType.NONE},
    {"use_chunking": False},
    {"use_statistics": False},
    BARE,
]


@pytest.mark.parametrize(("write", "options"), [*((mcap, options) for options in OPTIONS), (bag1, {})])
def test_the_first_log_in_a_file_is_read_and_the_next_one_told(tmp_path, write, options):
    path, raws = joined(tmp_path, write, ("/a", 0), ("/b", COUNT), **options)
    for recording in (read(path), read(path, room=0), read(path, start=0)):
        assert_all_there(recording, [("/a", 0)])
        (further,) = recording.findings
        assert (further.code, further.value) == ("recording.joined", len(raws[0]))


@pytest.mark.parametrize("cut", [0, 5])
def test_a_log_attached_to_another_one_is_no_further_one(tmp_path, cut):
    inner = mcap(tmp_path / "inner", "/inner", 0).read_bytes()
    log = McapLog()
    log.writer.add_attachment(START, START, "calibration.mcap", "application/octet-stream", inner)
    for i in range(COUNT):
        log.add("/a", joint_state(START + i * MS, ["x"], [i]), START + i * MS)
    path = tmp_path / "log"
    path.write_bytes(log.bytes()[: -cut or None])
    recording = read(path)
    assert_all_there(recording, [("/a", 0)])
    assert "recording.joined" not in codes(recording)


def test_a_log_whose_end_is_damaged_up_to_its_mark_is_cut_off_not_joined(tmp_path):
    """An MCAP file ends with the bytes it begins with."""
    raw = mcap(tmp_path / "log", "/a", 0, compression=CompressionType.NONE, use_chunking=False).read_bytes()
    for damage in (bytes(5000), b"\xff" * 5000):
        (tmp_path / "log").write_bytes(raw[:20_000] + damage + raw[-8:])
        assert {"recording.truncated"} == {*codes(read(tmp_path / "log"))}


def test_damage_ahead_of_the_next_log_is_reported(tmp_path):
    path, (raw, other) = joined(tmp_path, mcap, ("/a", 0), ("/b", COUNT), use_chunking=False, **BARE)
    path.write_bytes(raw[:20_000] + bytes(5000) + other)
    assert {"recording.bytes_skipped", "recording.joined"} <= {*codes(read(path))}
