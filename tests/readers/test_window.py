"""The part of a log that is asked for with start and end."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import numpy as np
import pytest
from click.testing import CliRunner
from write_logs import MS, START, McapLog, joint_state

from vsalog.cli import cli
from vsalog.errors import ReadError
from vsalog.readers import read
from vsalog.readers.window import Moment

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
def test_a_part_is_told_in_many_ways(log, start, end, first, last):
    assert kept(read(log, start=start, end=end)) == (first, last)


def test_the_beginning_is_that_of_the_log_whatever_is_read_of_it(log):
    name = "/late.position[b]"
    assert kept(read(log, start="0.4", end="0.5"), name) == (400, 500)
    assert kept(read(log, wanted={name}, start="0.4", end="0.5"), name) == (400, 500)


def test_it_counts_on_the_clock_that_is_used(log):
    stamps = read(log, time="log", start="0.1", end="0.2").channel("/j.position[a]").stamps
    assert (stamps[0], stamps[-1]) == (START + 105 * MS, START + 205 * MS)


def test_what_has_no_sample_there_is_told(log):
    recording = read(log, start="0", end="0.1")
    assert list(recording.channels) == ["/j.position[a]"]
    assert list(recording.streams) == ["/j"]
    assert "no sample lies between" in recording.unread["/late.position[b]"]


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
def test_what_cannot_be_is_said(log, start, end, words):
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
