"""Which clock a stream is on, and its order."""

from __future__ import annotations

import numpy as np
import pytest
from finding_codes import codes, found, values_of
from hypothesis import given
from hypothesis import strategies as st
from random_messages import STORES
from write_logs import MS, START, McapLog, joint_state, serialised

from vsalog.core.errors import ReadError
from vsalog.readers import read
from vsalog.readers.header_stamps import HeaderStamps
from vsalog.readers.reach import Nanoseconds
from vsalog.readers.sample_order import put_in_order
from vsalog.readers.stream_clock import choose_clock


def log_of(tmp_path, stamps, values=None, log_times=None):
    log = McapLog()
    for i, stamp in enumerate(stamps):
        time = START + i * MS if log_times is None else log_times[i]
        value = i if values is None else values[i]
        log.add("/j", joint_state(stamp, ["a"], [value]), time)
    return log.save(tmp_path / "log")


@pytest.mark.parametrize(
    ("stamps", "code", "value"),
    [
        ([0, 0, 0, 0], "clock.stamps_zero", 4),
        ([START, 0, START + 2 * MS, START], "clock.stamps_zero", 1),
        ([10 * MS, 11 * MS, 12 * MS, 13 * MS], "clock.stamps_before_2000", None),
        ([START - 2 * Nanoseconds.DAY + i for i in range(4)], "clock.stamps_far", 4),
        ([START, START - 2 * Nanoseconds.DAY, START + MS, START], "clock.stamps_far", 1),
        ([START] * 4, "clock.stamps_all_same", None),
    ],
)
def test_implausible_stamps_give_way_to_log_time_for_the_whole_stream(tmp_path, stamps, code, value):
    recording = read(log_of(tmp_path, stamps))
    stream = recording.streams["/j"]
    assert stream.time_source == "log"
    reason = stream.time_finding
    assert (reason.code, reason.part, reason.value, reason.evidence["used"]) == (code, "/j", value, "log")
    assert reason in recording.findings
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
    assert choose_clock(clocks, "auto").reason is None
    missing = choose_clock(clocks, "header").reason
    assert (missing.code, missing.evidence["asked"]) == ("clock.not_recorded", "header")
    assert choose_clock({"column": np.arange(3)}, "log").source == "column"


def test_order_duplicates_and_conflicts(tmp_path):
    stamps = [START + t * MS for t in (0, 2, 1, 2, 2, 3)]
    recording = read(log_of(tmp_path, stamps, values=[0, 20, 10, 20, 99, 30]))
    stream = recording.streams["/j"]
    assert (stream.count, stream.inversions, stream.duplicates, stream.conflicts) == (4, 1, 1, 1)
    channel = recording.channel("/j.position[a]")
    np.testing.assert_array_equal(channel.stamps, START + np.arange(4) * MS)
    np.testing.assert_array_equal(channel.values, [0, 10, 20, 30])
    assert codes(recording) == ["clock.out_of_order", "recording.copies_dropped", "recording.conflicts_dropped"]


def test_plausible_stamps_have_no_reason():
    log = START + np.arange(5) * MS
    assert HeaderStamps.of(log - 1000, log).doubt() is None
    assert HeaderStamps.of(log[:0], log[:0]).doubt() is None


NUMBERS = st.sampled_from([0.0, 1.0, float("nan")])


@given(st.lists(st.tuples(st.integers(-5, 5), NUMBERS, NUMBERS), max_size=60))
def test_order_keeps_the_first_of_each_stamp_and_what_it_lacks(samples):
    """Held against a walk from sample to sample."""
    stamps = np.array([s for s, *_ in samples], dtype=np.int64)
    columns = [np.array([sample[k] for sample in samples], dtype=np.float64) for k in (1, 2)]
    order = put_in_order(stamps, columns)
    kept = slice(None) if order.keep is None else order.keep
    first = {}
    for stamp, *values in samples:
        known = first.setdefault(stamp, [np.nan, np.nan])
        first[stamp] = [value if np.isnan(old) else old for old, value in zip(known, values, strict=True)]
    assert stamps[kept].tolist() == sorted(first)
    for k, column in enumerate(columns):
        np.testing.assert_array_equal(column[kept], [first[s][k] for s in sorted(first)])
    conflicts = sum(
        any(not np.isnan(value) and value != known for value, known in zip(values, first[stamp], strict=True))
        for stamp, *values in samples
    )
    assert order.conflicts == conflicts
    assert order.duplicates <= len(samples) - len(first) - conflicts
    assert order.inversions == sum(stamp < max(stamps[: i + 1]) for i, stamp in enumerate(stamps))


@given(st.lists(st.integers(-5, 5), max_size=60))
def test_samples_that_are_alike_are_copies(numbers):
    stamps = np.array(numbers, dtype=np.int64)
    order = put_in_order(stamps, [np.where(stamps > 2, np.nan, stamps)])
    assert (order.duplicates, order.conflicts) == (stamps.size - np.unique(stamps).size, 0)


ROUNDED = "time,a\n" + "".join(f"{1.7e9 + 64 * (k // 8)},{k}\n" for k in range(4000))


def test_a_clock_lost_to_rounding_is_refused_in_memory_and_on_disk(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(ROUNDED)
    for recording in (read(path), read(path, room=0)):
        assert not recording.channels
        assert "500 stamps for 4000 rows" in recording.unread["a"]


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


def set_ahead_a_little(stamps):
    stamps[900:] += 5000 * MS


def set_right(stamps):
    stamps[:900] -= 2000 * MS


def ahead_for_a_while(stamps):
    stamps[900:1300] += 5000 * MS


@pytest.mark.parametrize(
    ("change", "way", "size"),
    [
        (set_ahead_a_little, "ahead", 5.0),
        (set_right, "ahead", 2.0),
        (ahead_for_a_while, "back", 5.0),
        (set_back, "back", 0.3),
        (set_back_twice, "back", None),
        (set_back_at_the_end, "back", 3.0),
        (set_ahead, "ahead", 3600.0),
    ],
)
def test_a_clock_that_is_set_gives_way_to_log_time_in_memory_and_on_disk(tmp_path, monkeypatch, change, way, size):
    monkeypatch.setattr("vsalog.core.column.PART", 301)
    path = log_of(tmp_path, stamps_that(change))
    short, long = read(path), read(path, room=0)
    assert long.in_file
    for recording in (short, long):
        stream = recording.streams["/j"]
        assert (stream.time_source, stream.inversions, stream.count) == ("log", 0, 2000)
        reason = stream.time_finding
        assert (reason.code, reason.evidence["way"]) == ("clock.stamps_step", way)
        assert size is None or reason.value == pytest.approx(size, rel=1e-5)
    np.testing.assert_array_equal(short.channel("/j.position[a]").values, np.arange(2000))


def test_a_clock_that_is_set_can_be_insisted_on_but_not_silently(tmp_path):
    path = log_of(tmp_path, stamps_that(set_back))
    for recording in (read(path, time="header"), read(path, time="header", room=0)):
        stream = recording.streams["/j"]
        assert (stream.time_source, stream.inversions, stream.conflicts) == ("header", 299, 300)
        (doubt,) = found(recording, "clock.stamps_step")
        assert doubt.evidence == {"way": "back", "used": "header"}


def zeros_at_the_start(stamps):
    stamps[:40] = 0


def zeros_here_and_there(stamps):
    stamps[::25] = 0


def an_hour_ahead(stamps):
    stamps[[0, 298, 299, 700, 701, 702, 1500, -1]] += 3_600_000 * MS  # at the border of parts on disk, too


def years_ahead(stamps):
    stamps[700] = 2**60


@pytest.mark.parametrize(
    ("change", "count"),
    [(zeros_at_the_start, 40), (zeros_here_and_there, 80), (an_hour_ahead, 8), (years_ahead, 1)],
)
@pytest.mark.parametrize("time", ["auto", "header"])
def test_a_few_stamps_that_are_none_cost_their_samples(tmp_path, monkeypatch, change, count, time):
    monkeypatch.setattr("vsalog.core.column.PART", 301)
    right, changed = np.array(stamps_that(lambda stamps: None)), np.array(stamps_that(change))
    path = log_of(tmp_path, changed.tolist())
    short, long = read(path, time=time), read(path, time=time, room=0)
    kept = np.flatnonzero(right == changed)
    assert kept.size == 2000 - count
    for recording in (short, long):
        stream = recording.streams["/j"]
        assert (stream.time_source, stream.time_finding, stream.inversions) == ("header", None, 0)
        assert values_of(recording, "clock.stamps_left_out") == [count]
    channel, column = short.channel("/j.position[a]"), long.channel("/j.position[a]")
    for stamps, values in ((channel.stamps, channel.values), (column.stamps[:], column.values[:])):
        np.testing.assert_array_equal(stamps, right[kept])
        np.testing.assert_array_equal(values, kept)


def test_samples_are_kept_where_log_time_is_asked_for_or_needed(tmp_path):
    def back_and_zero(stamps):
        set_back(stamps)
        stamps[7] = 0

    path = log_of(tmp_path, stamps_that(zeros_at_the_start))
    assert read(path, time="log").streams["/j"].count == 2000
    stepping = read(log_of(tmp_path, stamps_that(back_and_zero))).streams["/j"]
    assert (stepping.time_source, stepping.count) == ("log", 2000)


def test_nanoseconds_beyond_a_second_are_no_stamp(tmp_path):
    """Taken as they are, they would move a sample by up to four seconds, or add one to its second."""
    for ros1 in (False, True):
        log, odd = McapLog(profile="ros1" if ros1 else "ros2"), [10, 20, 30]
        name = "sensor_msgs/JointState" if ros1 else "sensor_msgs/msg/JointState"
        text = STORES[ros1].generate_msgdef("sensor_msgs/msg/JointState", ros_version=1 if ros1 else 2)[0]
        channel = log.channel("/j", name, "ros1" if ros1 else "cdr", "ros1msg" if ros1 else "ros2msg", text)
        for i in range(100):
            message = joint_state(START + i * MS, ["a"], [i], ros1=ros1)
            message.header.stamp.nanosec += 10**9 * (i in odd)
            log.raw(channel, serialised(message, ros1), START + i * MS)
        recording = read(log.save(tmp_path / "log"))
        values = recording.channel("/j.position[a]").values
        np.testing.assert_array_equal(values, np.delete(np.arange(100), odd))
        assert values_of(recording, "clock.stamps_left_out") == [3]


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
    monkeypatch.setattr("vsalog.core.column.PART", 301)
    path = log_of(tmp_path, stamps_that(change))
    assert read(path).streams["/j"].time_source == "header"
    assert read(path, room=0).streams["/j"].time_source == "header"


def test_stamps_that_wait_in_a_queue_are_right(tmp_path):
    log_times = START + np.arange(2000) * MS
    log_times[900:1500] = log_times[1500]  # the network stood still, then all came at once
    path = log_of(tmp_path, stamps_that(lambda stamps: None), log_times=log_times.tolist())
    assert read(path).streams["/j"].time_source == "header"


def test_many_stamps_that_are_off_cost_the_clock(tmp_path):
    rows = np.random.default_rng(1).choice(np.arange(5, 1995), 180, replace=False)

    def change(stamps):
        stamps[rows] += 3_600_000 * MS

    path = log_of(tmp_path, stamps_that(change))
    for recording in (read(path), read(path, room=0)):
        stream = recording.streams["/j"]
        assert (stream.time_source, stream.count) == ("log", 2000)
        assert (stream.time_finding.code, stream.time_finding.limit) == ("clock.many_stamps_far", 20)


def on_a_slow_network(kept):
    """Stamps and log times [ms] of samples that wait for five seconds, twice, while some of them get lost."""
    stamps = np.arange(20_000)
    times = stamps + 2 + np.random.default_rng(2).exponential(0.3, stamps.size)
    which = np.ones(stamps.size, bool)
    for begin in (4000, 12_000):
        waits = np.arange(begin, begin + 5000)
        times[waits] = begin + 5000 + 0.05 * np.arange(waits.size)
        which[waits] = kept(np.arange(5000))
    return stamps[which], np.maximum.accumulate(times)[which]


def backlog():
    """Samples come later and later, then always three seconds late, until those that wait are thrown away."""
    stamps = np.arange(30_000)
    times = stamps + 2 + np.minimum(np.clip((stamps - 5000) / 2, 0, None), 3000) * (stamps < 20_000)
    kept = (stamps < 17_000) | (stamps >= 20_000)
    return stamps[kept], times[kept]


def late_ones():
    stamps = np.arange(5000)
    times = stamps + 2.0
    times[[700, 1500, 1501, 4000]] += 2000
    order = np.argsort(times, kind="stable")
    return stamps[order], times[order]


def a_first_one_of_old():
    return np.concatenate(([0], np.arange(7000, 12_000))), np.concatenate(([7001.5], np.arange(7000, 12_000) + 2))


@pytest.mark.parametrize(
    "samples",
    [
        lambda: on_a_slow_network(lambda k: k >= 0),
        lambda: on_a_slow_network(lambda k: k < 20),
        lambda: on_a_slow_network(lambda k: k < 500),
        lambda: on_a_slow_network(lambda k: k >= 4980),
        lambda: on_a_slow_network(lambda k: k < 0),
        backlog,
        late_ones,
        a_first_one_of_old,
    ],
)
def test_samples_that_had_to_wait_keep_their_stamps(samples):
    stamps, times = (START + np.round(np.asarray(part) * MS).astype(np.int64) for part in samples())
    clock = choose_clock({"header": stamps, "log": times}, "auto")
    assert (clock.source, clock.off.size, clock.reason) == ("header", 0, None)


@pytest.mark.parametrize("log_time", [0, START, START + 5 * 10**9])
@pytest.mark.parametrize("time", ["auto", "header"])
def test_a_log_time_that_stands_still_is_no_clock(tmp_path, log_time, time):
    stamps = [START + i * MS for i in range(300)]
    path = log_of(tmp_path, stamps, log_times=[log_time] * 300)
    for recording in (read(path, time=time), read(path, time=time, room=0)):
        channel = recording.channel("/j.position[a]")
        assert channel.stamps.tolist() == stamps
        assert recording.streams["/j"].time_source == "header"
        assert codes(recording) == ["clock.log_stands"]
    assert read(path, start=0.1, end=0.2).channel("/j.position[a]").stamps.tolist() == stamps[100:201]
    assert read(path, time="log").streams["/j"].time_source == "log"


def test_a_clock_that_stands_still_next_to_another_one_that_does_is_kept():
    still, moving = np.full(5, START), START + np.arange(5) * MS
    assert choose_clock({"header": still, "log": still}, "auto").source == "header"
    assert choose_clock({"header": still, "log": moving}, "auto").source == "log"
    assert choose_clock({"header": still, "log": still, "publish": moving}, "auto").source == "publish"
    assert choose_clock({"log": still, "publish": moving}, "log").source == "log"
