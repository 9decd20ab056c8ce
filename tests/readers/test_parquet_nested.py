"""Parquet files with structures and lists, and with clocks in parts."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import codes, found, values_of

from vsalog.core.errors import ReadError
from vsalog.readers import read

N = 1000
TIME = np.arange(N) / 100


def stored(tmp_path, **columns):
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(columns), path, row_group_size=300)
    return read(path)


def test_members_of_structures_are_channels(tmp_path):
    stamps = [{"stamp": {"sec": 1_700_000_000 + i // 100, "nanosec": i % 100 * 10**7}} for i in range(N)]
    states = [None if i == 500 else {"pos": i, "inner": {"x": -i}} for i in range(N)]
    log = stored(tmp_path, header=stamps, js=states)
    assert list(log.channels) == ["js.pos", "js.inner.x"]
    assert log.channels["js.pos"].stamps[101] == 1_700_000_001_010_000_000
    expected = np.where(np.arange(N) == 500, np.nan, -np.arange(N))
    np.testing.assert_array_equal(log.channels["js.inner.x"].values, expected)


@pytest.mark.parametrize("kind", [pa.list_(pa.float64()), pa.list_(pa.float64(), 2), pa.large_list(pa.float32())])
def test_elements_of_lists_are_channels(tmp_path, kind):
    log = stored(tmp_path, time=TIME, pos=pa.array([None if i == 400 else [i, 2 * i] for i in range(N)], kind))
    for k in range(2):
        expected = np.where(np.arange(N) == 400, np.nan, (k + 1) * np.arange(N))
        np.testing.assert_array_equal(log.channels[f"pos[{k}]"].values, expected)


def test_lists_that_become_longer_are_reported(tmp_path):
    log = stored(tmp_path, time=TIME, pos=[[i] if i % 3 else [] for i in range(N - 1)] + [[1.0, 2.0, 3.0]])
    assert list(log.channels) == ["pos[0]"]
    assert len(log.channels["pos[0]"].values) == N - N // 3
    assert values_of(log, "recording.elements_left_out") == [1]


@pytest.mark.parametrize("dated", [True, False])
def test_a_time_of_day_goes_on_at_midnight(tmp_path, dated):
    """Next to a date or alone."""
    moments = [dt.datetime(2026, 1, 31, 23, 59, 58) + dt.timedelta(seconds=i / 100) for i in range(N)]
    days = {"date": [moment.date() for moment in moments]} if dated else {}
    log = stored(tmp_path, **days, time=[moment.time() for moment in moments], pos=TIME)
    pos = log.channels["pos"]
    assert (np.diff(pos.stamps) == 10**7).all()
    assert len(pos.values) == N
    assert log.absolute_time == dated
    assert ("clock.restarts" in codes(log)) != dated


def test_numbers_that_are_text_are_numbers(tmp_path):
    words = ["?!" if i == 700 else f"{i / 4}" for i in range(N)]
    log = stored(tmp_path, time=[f"{t:.3f}" for t in TIME], pos=words, mode=["run"] * N)
    np.testing.assert_array_equal(log.channels["pos"].values, np.where(np.arange(N) == 700, np.nan, np.arange(N) / 4))
    assert log.unread == {"mode": "text"}
    assert values_of(log, "table.cells_without_number") == [1]


@pytest.mark.parametrize("rate", [1e-9, 1e10])
def test_absurd_rates_are_refused(tmp_path, rate):
    """Times would leave 64 bits, or be all the same."""
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"pos": TIME}), path)
    with pytest.raises(ReadError, match="give the sample rate in Hz"):
        read(path, rate=rate)


def test_whole_numbers_beyond_53_bits_are_reported(tmp_path):
    log = stored(tmp_path, time=TIME, enc=2**60 + np.arange(N), even=2**60 + 1024 * np.arange(N))
    (rounded,) = found(log, "table.numbers_rounded")
    assert (rounded.part, rounded.evidence["number"]) == ("enc", str(2**60 + 1))


def test_an_index_without_a_name_is_the_clock_or_a_hint_is_given(tmp_path):
    """Pandas stores it under a name of its own."""
    log = stored(tmp_path, pos=TIME**2 - TIME, __index_level_0__=pa.array(np.arange(N) * 10_000, pa.duration("us")))
    assert log.channels["pos"].stamps[1] == 10**7
    log = stored(tmp_path, pos=TIME**2 - TIME, __index_level_0__=TIME)
    assert "clock.perhaps" in codes(log)
