"""Which clock a stream is on, and its order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from write_logs import MS, START, McapLog, joint_state

from vsalog.errors import ReadError
from vsalog.long_recording import LongRecording
from vsalog.readers import read, read_within
from vsalog.readers.timing import ONE_DAY, choose_clock, implausible, put_in_order


def log_of(tmp_path, stamps, values=None, log_times=None):
    log = McapLog()
    for i, stamp in enumerate(stamps):
        time = START + i * MS if log_times is None else log_times[i]
        value = i if values is None else values[i]
        log.add("/j", joint_state(stamp, ["a"], [value]), time)
    return log.save(tmp_path / "log")


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        ([0, 0, 0, 0], "all zero"),
        ([START, 0, START + 2 * MS, START], "1 of its 4 header stamps is zero"),
        ([10 * MS, 11 * MS, 12 * MS, 13 * MS], "before the year 2000"),
        ([START - 2 * ONE_DAY + i for i in range(4)], "more than a day apart"),
        ([START, START - 2 * ONE_DAY, START + MS, START], "1 of its 4 header stamps is more than a day off"),
        ([START] * 4, "all the same"),
    ],
)
def test_implausible_stamps_give_way_to_log_time_for_the_whole_stream(tmp_path, stamps, words):
    recording = read(log_of(tmp_path, stamps))
    stream = recording.streams["/j"]
    assert stream.time_source == "log"
    assert words in stream.time_reason
    assert any(words in note for note in recording.notes)
    np.testing.assert_array_equal(recording.channel("/j.position[a]").stamps, START + np.arange(4) * MS)


def test_a_clock_can_be_insisted_on(tmp_path):
    path = log_of(tmp_path, [5, 6, 7])
    assert read(path, time="header").channel("/j.position[a]").stamps.tolist() == [5, 6, 7]
    assert read(path, time="publish").streams["/j"].time_source == "publish"
    with pytest.raises(ReadError, match="time is one of"):
        read(path, time="noon")


def test_a_simulated_log_counts_from_its_start(tmp_path):
    stamps = [i * MS for i in range(5)]
    recording = read(log_of(tmp_path, stamps, log_times=[s + 10 for s in stamps]))
    assert recording.streams["/j"].time_source == "header"
    assert not recording.absolute_time
    assert recording.channel("/j.position[a]").stamps.tolist() == stamps


def test_streams_without_a_header_say_so_only_where_one_was_asked_for():
    clocks = {"log": np.arange(3), "publish": np.arange(3)}
    assert choose_clock(clocks, "auto").reason == ""
    assert choose_clock(clocks, "header").reason == "it has no header time"
    assert choose_clock({"column": np.arange(3)}, "log").source == "column"


def test_order_duplicates_and_conflicts(tmp_path):
    stamps = [START + t * MS for t in (0, 2, 1, 2, 2, 3)]
    recording = read(log_of(tmp_path, stamps, values=[0, 20, 10, 20, 99, 30]))
    stream = recording.streams["/j"]
    assert (stream.count, stream.inversions, stream.duplicates, stream.conflicts) == (4, 1, 1, 1)
    channel = recording.channel("/j.position[a]")
    np.testing.assert_array_equal(channel.stamps, START + np.arange(4) * MS)
    np.testing.assert_array_equal(channel.values, [0, 10, 20, 30])
    assert len(recording.notes) == 3


def test_plausible_stamps_have_no_reason():
    log = START + np.arange(5) * MS
    assert implausible(log - 1000, log) == ""
    assert implausible(log[:0], log[:0]) == ""


@given(st.lists(st.tuples(st.integers(-5, 5), st.sampled_from([0.0, 1.0, float("nan")])), max_size=60))
def test_order_keeps_the_first_of_each_stamp(samples):
    stamps = np.array([s for s, _ in samples], dtype=np.int64)
    values = np.array([v for _, v in samples], dtype=np.float64)
    order = put_in_order(stamps, [values])
    kept = slice(None) if order.keep is None else order.keep
    first = {}
    duplicates = conflicts = 0
    for stamp, value in samples:
        if stamp not in first:
            first[stamp] = value
        elif np.array_equal([value], [first[stamp]], equal_nan=True):
            duplicates += 1
        else:
            conflicts += 1
    assert stamps[kept].tolist() == sorted(first)
    np.testing.assert_array_equal(values[kept], [first[s] for s in sorted(first)])
    assert (order.duplicates, order.conflicts) == (duplicates, conflicts)
    assert order.inversions == sum(stamp < max(stamps[: i + 1]) for i, stamp in enumerate(stamps))


ROUNDED = "time,a\n" + "".join(f"{1.7e9 + 64 * (k // 8)},{k}\n" for k in range(4000))


def test_a_clock_lost_to_rounding_is_refused_in_memory_and_on_disk(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(ROUNDED)
    short, long = read(path), read_within(0, path)
    assert isinstance(long, LongRecording)
    for recording in (short, long.look):
        assert not recording.channels
        assert "500 stamps for 4000 rows" in recording.unread["a"]
    assert not long.columns


def stamps_that(change, count=2000):
    """Header stamps that follow the log's times, but for a change."""
    stamps = START + np.arange(count) * MS
    change(stamps)
    return stamps.tolist()


def set_back(stamps):
    stamps[900:] -= 300 * MS


def set_back_twice(stamps):
    set_back(stamps)
    stamps[1000:] -= 700 * MS


def set_back_at_the_end(stamps):
    stamps[-5:] -= 3000 * MS


def set_ahead(stamps):
    stamps[900:] += 3_600_000 * MS


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (set_back, "step back by 0.3 s"),
        (set_back_twice, "step back by"),
        (set_back_at_the_end, "step back by 3 s"),
        (set_ahead, "step ahead by 3600 s"),
    ],
)
def test_a_clock_that_is_set_gives_way_to_log_time_in_memory_and_on_disk(tmp_path, monkeypatch, change, words):
    monkeypatch.setattr("vsalog.readers.spool.PART", 301)
    monkeypatch.setattr("vsalog.readers.clock_steps._PIECE", 1000)
    path = log_of(tmp_path, stamps_that(change))
    short, long = read(path), read_within(0, path)
    assert isinstance(long, LongRecording)
    for recording in (short, long.look):
        stream = recording.streams["/j"]
        assert (stream.time_source, stream.inversions, stream.count) == ("log", 0, 2000)
        assert words in stream.time_reason
    np.testing.assert_array_equal(short.channel("/j.position[a]").values, np.arange(2000))


def test_a_clock_that_is_set_can_be_insisted_on_but_not_silently(tmp_path):
    path = log_of(tmp_path, stamps_that(set_back))
    for recording in (read(path, time="header"), read_within(0, path, time="header").look):
        stream = recording.streams["/j"]
        assert (stream.time_source, stream.inversions, stream.conflicts) == ("header", 299, 300)
        assert any("header time is used" in note and "step back" in note for note in recording.notes)


def swapped(stamps):
    stamps[900:902] = stamps[901:899:-1]


def late(stamps):
    stamps[900] -= 500 * MS


def blocks_swapped(stamps):
    stamps[900:950] = np.concatenate((stamps[925:950], stamps[900:925]))


def two_clocks(stamps):
    stamps[1::2] -= 3000 * MS


def slower_network(stamps):
    stamps[900:] -= 3 * MS


@pytest.mark.parametrize("change", [swapped, late, blocks_swapped, two_clocks, slower_network])
def test_samples_that_come_late_are_no_step_of_the_clock(tmp_path, monkeypatch, change):
    monkeypatch.setattr("vsalog.readers.spool.PART", 301)
    monkeypatch.setattr("vsalog.readers.clock_steps._PIECE", 1000)
    path = log_of(tmp_path, stamps_that(change))
    assert read(path).streams["/j"].time_source == "header"
    assert read_within(0, path).look.streams["/j"].time_source == "header"


def test_stamps_that_wait_in_a_queue_are_right(tmp_path):
    log_times = START + np.arange(2000) * MS
    log_times[900:1500] = log_times[1500]  # the network stood still, then all came at once
    path = log_of(tmp_path, stamps_that(lambda stamps: None), log_times=log_times.tolist())
    assert read(path).streams["/j"].time_source == "header"
