"""Rows of tables that come in another order, and stamps that are none."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import found, values_of

from vsalog.readers import read

N, STEP = 12_000, 10**6
TODAY = 1_750_000_000 * 10**9
TRUE = TODAY + STEP * np.arange(N)
Q = np.sin(np.arange(N) / 40)


@pytest.fixture(params=["csv", "parquet"])
def log(request, tmp_path):
    """Read a table of times [ns] and of the numbers of rows."""

    def log(times, numbers, header="time [ns]"):
        columns = {header: times, "x": np.asarray(numbers, float), "q": Q[np.asarray(numbers)]}
        if request.param == "parquet":
            pq.write_table(pa.table(columns), tmp_path / "log")
        else:
            rows = zip(*(column.tolist() for column in columns.values()), strict=True)
            (tmp_path / "log").write_text(",".join(columns) + "\n" + "".join(f"{t},{x},{q}\n" for t, x, q in rows))
        return read(tmp_path / "log")

    return log


LATE = [
    np.r_[0:6000, 6000 + late : 6000 + late + ahead, 6000 : 6000 + late, 6000 + late + ahead : N]
    for late, ahead in ((1, 1), (1, 40), (4, 14), (9, 5), (14, 10), (20, 5), (12, 12), (200, 200), (20, 300))
]


@pytest.mark.parametrize("order", [*LATE, np.r_[6000:N, 0:6000], np.r_[0:3000, 6000:9000, 3000:6000, 9000:N]])
def test_rows_in_another_order_are_sorted(log, order):
    """Packets that are late, and logs that were put together in another order."""
    recording = log(TRUE[order], order)
    assert recording.channel("x").values.tolist() == list(range(N))
    assert recording.channel("x").stamps.tolist() == TRUE.tolist()


def test_rows_that_were_written_twice_are_dropped(log):
    order = np.r_[0:6000, 5000:N]
    recording = log(TRUE[order], order)
    assert recording.channel("x").values.tolist() == list(range(N))
    assert recording.streams["log"].duplicates == 1000


def test_a_log_appended_to_another_is_put_behind_it(log):
    """Of Parquet files as of text."""
    recording = log(np.r_[TRUE[:6000], TRUE[:6000]] - TODAY, range(N))
    assert recording.channel("x").values.tolist() == list(range(N))
    assert values_of(recording, "clock.log_appended") == [1]


def left_out(recording):
    return found(recording, "clock.times_left_out")


@pytest.mark.parametrize("unset", [np.arange(1), np.arange(900), np.array([50, 6000, 6001, N - 1])])
@pytest.mark.parametrize("since", ["zero", "switched on"])
def test_samples_of_before_the_clock_was_set_are_left_out(log, unset, since):
    """They would make a log of half a century."""
    times = TRUE.copy()
    times[unset] = 0 if since == "zero" else unset * STEP
    kept = np.delete(np.arange(N), unset)
    recording = log(times, range(N))
    assert recording.channel("x").values.tolist() == kept.tolist()
    assert recording.channel("x").stamps.tolist() == TRUE[kept].tolist()
    assert [one.value for one in left_out(recording)] == [unset.size]
    assert not recording.streams["log"].inversions


@pytest.mark.parametrize("begin", [TODAY, 10**12])
def test_single_stamps_that_are_far_off_are_left_out(log, begin):
    times = TRUE - TODAY + begin
    wrong = [700, 3000, 9000, 9001]
    times[wrong] += [3 * 10**18, -100 * 10**9, 2 * 10**12, 2 * 10**12]
    recording = log(times, range(N))
    assert recording.channel("x").values.tolist() == np.delete(np.arange(N), wrong).tolist()
    assert left_out(recording)


@pytest.mark.parametrize("begin", [TODAY, 0])
def test_pauses_and_slow_rows_are_believed(log, begin):
    times = begin + np.cumsum(np.random.default_rng(2).choice([STEP, 200 * 10**9], N, p=[0.9, 0.1]))
    recording = log(times, range(N))
    assert recording.channel("x").stamps.tolist() == times.tolist()
    assert recording.findings == ()


def test_stamps_from_end_to_end_of_64_bits(log):
    times = TRUE.copy()
    times[[100, 5000, 9000]] = [-(2**63), 2**63 - 1, -(2**62)]
    recording = log(times, range(N))
    assert (np.diff(recording.channel("x").values) > 0).all()
    assert recording.channel("x").values.size >= N - 3
