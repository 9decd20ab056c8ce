"""What the fuzz targets found, each as the smallest log that shows it; what they found in MATLAB files is in
tests/readers/test_matlab_damage.py, and in the times of whole logs in tests/cli/test_absurd_times.py.
"""

import warnings

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import values_of
from fuzz_contract import exercise, inspected
from fuzz_frames import sized
from fuzz_mcap import assemble, text

from vsalog.core.errors import ReadError
from vsalog.readers import read
from vsalog.readers.time_window import Moment

X = pa.array(np.arange(12.0))
T = np.arange(12) * 1_000_000


def write(path, **columns):
    return write_names(path, list(columns), list(columns.values()))


def write_names(path, names, arrays):
    pq.write_table(pa.Table.from_arrays(arrays, names=names), path)
    return path


def test_two_columns_of_one_name(tmp_path):
    """Arrow finds a column by its name, if only one has it."""
    names = ["time", "q", "q", "joint", "joint", "time"]
    texts = pa.array(["a"] * 12)
    recording = read(
        write_names(tmp_path / "log", names, [pa.array(T * 1e-9), X, pa.array(-np.arange(12.0)), texts, texts, X])
    )
    first, second = (c for name, c in recording.channels.items() if name.startswith("q"))
    np.testing.assert_array_equal(first.values, np.arange(12.0))
    np.testing.assert_array_equal(second.values, -np.arange(12.0))
    np.testing.assert_array_equal(first.stamps, T)


def test_durations_and_dates_beyond_64_bits(tmp_path):
    """One row must not cost all others, nor wrap around into another century."""
    durations = pa.array([2**60, *range(1, 12)], pa.duration("us"))
    recording = read(write(tmp_path / "log", time=durations, x=X, d=pa.array([5, 2**60, *range(10)], pa.duration("s"))))
    assert recording.channel("x").values.tolist() == list(range(1, 12))
    assert values_of(recording, "clock.rows_without_time") == [1]
    assert np.isnan(recording.channel("d").values[0])
    dates = pa.array([*range(11), 2**40], pa.timestamp("s"))
    assert read(write(tmp_path / "log", time=dates, x=X)).channel("x").stamps[-1] == 10 * 10**9


def test_unsigned_numbers_beyond_64_bits(tmp_path):
    stamps = pa.array([*(10**18 + T).tolist()[:-1], 2**64 - 1], pa.uint64())
    recording = read(write(tmp_path / "log", stamp=stamps, x=X))
    assert recording.channel("x").values.size == 11


def test_seconds_and_nanoseconds_whose_sum_is_beyond_64_bits(tmp_path):
    rows = "".join(f"{s},{n},1\n" for s, n in ((9223372036, 2 * 10**9), (1, 5), (2, 6), (3, 7)))
    (tmp_path / "log").write_text("header.stamp.sec,header.stamp.nanosec,x\n" + rows)
    recording = read(tmp_path / "log")
    assert recording.channel("x").stamps.tolist() == [10**9 + 5, 2 * 10**9 + 6, 3 * 10**9 + 7]


@pytest.mark.parametrize("value", [1e200, 1e308, -1.7e308])
def test_numbers_whose_squares_are_infinite(tmp_path, value):
    """`inspect` and `init` say nothing of numpy's troubles with them."""
    column = pa.array([value, *np.sin(np.arange(11.0))])
    names = ["time", "q [rad]", "tau [N*m]", "motor_position [rad]"]
    path = write_names(tmp_path / "log", names, [pa.array(T * 1e-9), column, X, column])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        inspected(read(path))


@pytest.mark.parametrize("word", ["9e999999", "-9e999999", "\udcbe", "1\x00", "nan", "sNaN", "inf", "1e19"])
def test_moments_that_are_none(word):
    with pytest.raises(ReadError, match="is no time"):
        Moment.parse(word, "start")


def test_a_moment_too_small_to_tell_from_the_beginning():
    assert Moment.parse("1e-999999", "start").time == 0


def test_log_times_beyond_64_bits(tmp_path):
    """Compiled loops let them wrap around: the log would begin in 1969."""
    schema = b"\1\0" + text("a/msg/T") + text("ros2msg") + sized(b"float64 x")
    channel = b"\1\0\1\0" + text("/t") + text("cdr") + text("")
    times = [10**18 + 10**6 * i for i in range(4)] + [2**64 - 1, 2**63]
    head = b"\1\0" + bytes(4)
    data = b"\0\1\0\0" + np.float64(1.5).tobytes()
    messages = [(5, head + 2 * t.to_bytes(8, "little") + data) for t in times]
    (tmp_path / "log").write_bytes(assemble(0, [(3, schema), (4, channel), *messages]))
    recording = read(tmp_path / "log")
    assert recording.channel("/t.x").stamps.tolist() == times[:4]
    assert values_of(recording, "clock.beyond_reach") == [2]
    exercise(tmp_path / "log", 0x78)
