"""Formats are detected from content, and what cannot be read is refused in words."""

from __future__ import annotations

import gzip
import os

import numpy as np
import pytest
from finding_codes import codes
from hypothesis import given
from hypothesis import strategies as st
from write_logs import START, McapLog, joints_mcap

from vsalog.core.column import Column
from vsalog.core.errors import ReadError
from vsalog.readers import read


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "log.mcap")
    with pytest.raises(ReadError, match="is a pipe or a device"):
        read(tmp_path / "log.mcap")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"   \n\n  ", "no known format"),
        (b"just some words", "no table"),
        (bytes(range(256)) * 20, "no known format"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(200), "-v7"),
        (b"\x89HDF\r\n\x1a\n" + bytes(200), "HDF5"),
        (b"PK\x03\x04" + bytes(200), "spreadsheet"),
        (b"ULog\x01\x12\x35" + bytes(200), "ulog2csv"),
        (b"\x1f\x8bnothing", "damaged"),
        (gzip.compress(b"\x89MCAP0\r\n", mtime=0), "a log compressed with gzip"),
        (gzip.compress(b"#ROSBAG V2.0\n", mtime=0), "a log compressed with gzip"),
        (b"\x89MCAP0\r\n", "cut off"),
        (b"SQLite format 3\0" + b"\xa5" * 5000, "database"),
        (b"\x28\xb5\x2f\xfd" + b"\xa5" * 100, "decompressed"),
        (b"MATLAB 5.0 MAT-file" + b"\xa5" * 500, "damaged"),
        (b"PAR1" + b"\xa5" * 500, "Parquet"),
    ],
)
def test_what_cannot_be_read_is_refused_in_words(tmp_path, content, words):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    try:
        recording = read(path)
    except ReadError as error:
        message = str(error)
        assert message.startswith(str(path))
    else:
        message = " ".join(recording.notes)
    assert words in message
    assert message.isprintable()


def test_missing_file_and_folder_without_a_bag(tmp_path):
    with pytest.raises(ReadError, match="no such file"):
        read(tmp_path / "nothing")
    (tmp_path / "remark.txt").write_text("hello")
    with pytest.raises(ReadError, match="no ROS 2 bag, and no file in it is a table"):
        read(tmp_path)


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    path = joints_mcap(tmp_path / "log", 1)

    def refuse(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "open", refuse)
    with pytest.raises(ReadError, match="permission denied"):
        read(path)


def test_the_name_of_a_file_means_nothing(tmp_path):
    for name in ("log.csv", "log.bag", "log.parquet", "log"):
        assert read(joints_mcap(tmp_path / name, 3)).format == "mcap"


@given(st.binary(max_size=400))
def test_any_bytes_are_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("bytes") / "log"
    path.write_bytes(content)
    try:
        recording = read(path)
    except ReadError as error:
        message = str(error)
    else:
        message = " ".join(recording.notes)
    assert message == "" or message.isprintable()


@pytest.mark.parametrize("head", [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0", b"PAR1"])
@given(content=st.binary(max_size=400))
def test_any_bytes_behind_a_magic_are_read_or_refused(tmp_path_factory, head, content):
    path = tmp_path_factory.mktemp("bytes") / "log"
    path.write_bytes(head + content)
    try:
        recording = read(path)
    except ReadError:
        return
    assert all(len(channel.values) == len(channel.stamps) for channel in recording.channels.values())


def test_memory_stays_near_the_wanted_columns(tmp_path):
    path = joints_mcap(tmp_path / "log", 20_000)
    recording = read(path, wanted=["/joint_states.position[elbow]"])
    channel = recording.channel("/joint_states.position[elbow]")
    assert channel.values.flags.c_contiguous
    assert channel.values.base is None
    np.testing.assert_array_equal(channel.values, np.arange(20_000))


def test_columns_grow_with_zeros_gaps_and_signs():
    """Zeros are not written before another number comes."""
    i = np.arange(60_000)
    for whole in (
        np.where(i == i[-1], 1.5, 0.0),
        np.where(i == 0, 1.5, 0.0),
        np.where(i == 30_000, -0.0, 0.0),
        0.0 * i,
    ):
        for first, room in ((0, 0), (0, 70_000), (25_000, 0)):
            column = Column(np.float64, room)
            for at in range(first, i.size, 1000):
                column.add(at, whole[at : at + 1000])
            values = column.whole(i.size + 10)
            assert np.isnan(values[:first]).all()
            assert np.isnan(values[i.size :]).all()
            assert values[first : i.size].tobytes() == whole[first:].tobytes()


def test_a_rate_that_is_not_used_is_reported(tmp_path):
    log = McapLog()
    log.add_json("/x", {"x": 1}, START)
    path = log.save(tmp_path / "log")
    assert read(path).findings == ()
    assert "clock.rate_not_used" in codes(read(path, rate=100.0))
