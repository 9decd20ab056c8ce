"""The part of a log that is asked for with start and end."""

from __future__ import annotations

import json
import struct
from datetime import UTC, datetime

import numpy as np
import pytest
from click.testing import CliRunner
from random_messages import STORES
from rosbags import rosbag2
from write_logs import MS, START, McapLog, joint_state, serialised

from vsalog.cli import cli
from vsalog.core.errors import ReadError
from vsalog.readers import mcap_walk, read
from vsalog.readers.time_window import Moment

S = 10**9
DATE = "2023-11-14T22:13:20"
"""1 700 000 000 s after the epoch."""


@pytest.fixture
def log(tmp_path):
    """Two topics at 1 kHz for a second; /late begins 300 ms after the other. Log times are 5 ms behind the stamps."""
    log = McapLog()
    for i in range(1000):
        stamp = START + i * MS
        log.add("/j", joint_state(stamp, ["a"], [i]), stamp + 5 * MS)
        if i >= 300:
            log.add("/late", joint_state(stamp, ["b"], [i]), stamp + 5 * MS)
    return log.save(tmp_path / "log")


def kept(recording, name="/j.position[a]"):
    values = recording.channel(name).values
    assert recording.channel(name).stamps.tolist() == [START + int(v) * MS for v in values]
    assert recording.streams[recording.channel(name).stream].count == values.size
    return values[0], values[-1]


@pytest.mark.parametrize(
    ("start", "end", "first", "last"),
    [
        ("0.1", None, 100, 999),
        (None, "0.1", 0, 100),
        (0.1, 0.2, 100, 200),
        ("0.0995", "0.1005", 100, 100),
        ("100 ms", "0.01 min", 100, 600),
        ("2023-11-14T22:13:20.223456789Z", None, 100, 999),
        ("2023-11-14 23:13:20.223456789+01:00", "2023-11-14T22:13:20.323456788", 100, 199),
        ("1700000000.223456789", "0.2", 100, 200),
        ("1700000000223", "1700000000323456", 100, 199),
        ("1700000000223456789", None, 100, 999),
        ("0", "1e5", 0, 999),
    ],
)
def test_a_part_is_reported_in_many_ways(log, start, end, first, last):
    assert kept(read(log, start=start, end=end)) == (first, last)


def test_the_beginning_is_that_of_the_log_whatever_is_read_of_it(log):
    name = "/late.position[b]"
    assert kept(read(log, start="0.4", end="0.5"), name) == (400, 500)
    assert kept(read(log, wanted={name}, start="0.4", end="0.5"), name) == (400, 500)


def test_it_counts_on_the_clock_that_is_used(log):
    stamps = read(log, time="log", start="0.1", end="0.2").channel("/j.position[a]").stamps
    assert (stamps[0], stamps[-1]) == (START + 105 * MS, START + 205 * MS)


def headerless(path, sqlite, **options):
    """Two topics without stamps of their own; the second ends early."""
    kind = STORES[False].types["std_msgs/msg/Float64"]
    log = McapLog(chunk_size=2048, **options)
    if sqlite:
        with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
            topics = [
                writer.add_connection(t, "std_msgs/msg/Float64", typestore=STORES[False]) for t in ("/x", "/early")
            ]
            for i in range(1000):
                for topic in topics[: 2 if i < 500 else 1]:
                    writer.write(topic, START + i * MS, serialised(kind(float(i))))
        return path
    for i in range(1000):
        for topic in ("/x", "/early")[: 2 if i < 500 else 1]:
            log.add(topic, kind(float(i)), START + i * MS)
    return log.save(path)


@pytest.fixture
def unpacked(monkeypatch):
    """What was unpacked of chunks, or read of rows."""
    seen = []
    own = mcap_walk.decompress
    monkeypatch.setattr(mcap_walk, "decompress", lambda kind, data, size: seen.append(size) or own(kind, data, size))
    return seen


@pytest.mark.parametrize("sqlite", [False, True])
@pytest.mark.parametrize(("start", "end"), [("0.7", None), ("0.2", "0.2035"), (None, "0.1"), ("0.499", "0.5")])
def test_only_what_can_lie_there_is_read_where_the_clock_is_the_logs(tmp_path, unpacked, sqlite, start, end):
    path = headerless(tmp_path / "log", sqlite)
    whole = read(path)
    everything = sum(unpacked)
    unpacked.clear()
    part = read(path, start=start, end=end)
    assert sum(unpacked) <= 0.45 * everything
    low = int(float(start or 0) * 1000)
    high = int(float(end or 1) * 1000)
    for name in ("/x.data", "/early.data"):
        full = whole.channel(name)
        inside = (full.values >= low) & (full.values <= high)
        if inside.any():
            np.testing.assert_array_equal(part.channel(name).values, full.values[inside])
            np.testing.assert_array_equal(part.channel(name).stamps, full.stamps[inside])
        else:
            assert "no sample is between" in part.unread[name]
    assert part.findings == whole.findings
    with pytest.raises(
        ReadError, match=r"its samples are from 2023-11-14T22:13:20\.123456Z to 2023-11-14T22:13:21\.12"
    ):
        read(path, start="5")


def test_a_header_far_from_the_logs_time_is_found_in_whichever_chunk(tmp_path, unpacked, monkeypatch):
    monkeypatch.setattr("vsalog.readers.topic_streams.PACKED_BYTES", 0)
    log = McapLog(chunk_size=2048)
    for i in range(500):
        log.add("/j", joint_state(START + i * MS, ["a"], [i]), START + i * 60 * S)
    path = log.save(tmp_path / "log")
    assert kept(read(path, start="0.1", end="0.2")) == (100, 200)
    unpacked.clear()
    part = read(path, time="log", start="60", end="180").channel("/j.position[a]")
    assert part.values.tolist() == [1, 2, 3]
    assert sum(unpacked) < 30_000


def test_chunk_times_that_the_index_does_not_confirm_are_not_believed(tmp_path):
    path = headerless(tmp_path / "log", sqlite=False)
    raw = bytearray(path.read_bytes())
    (summary,) = struct.unpack_from("<Q", raw, len(raw) - 28)
    at = raw.index(struct.pack("<Q", START), summary)  # the first chunk's, in its index
    struct.pack_into("<QQ", raw, at, START + 5 * S, START + 6 * S)
    raw[-12:-8] = bytes(4)  # no checksum of the summary
    path.write_bytes(raw)
    assert read(path, start="0", end="0.005").channel("/x.data").values.tolist() == [0, 1, 2, 3, 4, 5]


def test_what_has_no_sample_there_is_reported(log):
    recording = read(log, start="0", end="0.1")
    assert list(recording.channels) == ["/j.position[a]"]
    assert list(recording.streams) == ["/j"]
    assert "no sample is between" in recording.unread["/late.position[b]"]


@pytest.mark.parametrize(
    ("start", "end", "words"),
    [
        ("5", None, "has no sample from 2023-11-14T22:13:25.123456Z; its samples are from"),
        (None, "2020-01-01", "has no sample to 2020-01-01"),
        ("0.2", "0.1", "is not after the start"),
        (f"{DATE}.5", "0.1", "is not after the start"),
        ("soon", None, "start 'soon' is no time: give seconds"),
        ("5 rad", None, "is no time"),
        (None, "nan", "end 'nan' is no time"),
        ("inf", None, "is no time"),
        ("-1", None, "is no time within any log"),
        ("1e400", None, "is no time"),
        ("2023-02-31", None, "is no time"),
        ("\x1b[31m", None, "�"),
    ],
)
def test_what_cannot_be_is_reported(log, start, end, words):
    with pytest.raises(ReadError, match=r".") as caught:
        read(log, start=start, end=end)
    assert words in str(caught.value)
    assert "\x1b" not in str(caught.value)


def test_tables_without_dates_or_without_time(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time [s],x\n" + "".join(f"{5 + i / 10},{i}\n" for i in range(20)))
    assert read(path, start="0.5", end="1").channel("x").values.tolist() == [5, 6, 7, 8, 9, 10]
    with pytest.raises(ReadError, match="no dates; give start and end in seconds"):
        read(path, start=DATE)
    path.write_text("x\n" + "".join(f"{i}.5\n" for i in range(20)))
    with pytest.raises(ReadError, match="no time, so there is no start"):
        read(path, start="1")
    assert read(path, rate=10.0, start="0.5", end="0.7").channel("x").values.tolist() == [5.5, 6.5, 7.5]


@pytest.mark.parametrize("seconds", [946684800, 1700000000, 4102444799])
def test_times_since_the_epoch_are_dates(seconds):
    expected = Moment(seconds * S, True)
    date = datetime.fromtimestamp(seconds, UTC)
    for text in (
        seconds,
        f"{seconds}000",
        f"{seconds}000000",
        f"{seconds}000000000",
        date.isoformat(),
        f"{date:%Y-%m-%d %H:%M:%S}",
    ):
        assert Moment.parse(text, "start") == expected


def test_the_command_line(log):
    done = CliRunner().invoke(cli, ["inspect", str(log), "--start", "0.1", "--end", "200 ms", "--json"])
    assert done.exit_code == 0
    report = json.loads(done.stdout)["logs"][0]
    assert report["duration"] == pytest.approx(0.1)
    assert [stream["count"] for stream in report["streams"]] == [101]
    assert done.stdout.count("/late") == 1  # as unread
    np.testing.assert_equal(report["streams"][0]["channels"][0]["minimum"], 100.0)


@pytest.mark.parametrize("command", ["estimate", "validate", "compare", "diagnose", "inspect", "init"])
def test_every_command_that_reads_a_log_has_it(command):
    text = CliRunner().invoke(cli, [command, "--help"], terminal_width=200).output
    assert "--start" in text
    assert "--end" in text
    assert "--time" in text
