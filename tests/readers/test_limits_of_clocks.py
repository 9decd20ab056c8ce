"""Clocks, on both sides of what tells a slip from a delay, and one unit from another."""

import numpy as np
import pytest

from vsalog.readers.header_stamps import HeaderStamps, far_from_others
from vsalog.readers.tables.time_units import guessed_unit
from vsalog.readers.values_by_turns import alternating

MS = 10**6
EVENLY = np.arange(1000) * 10 * MS


@pytest.mark.parametrize(("ahead", "found"), [(0.7, 0.0), (1.5, 1.5)])
def test_delays_vary_by_a_second(ahead, found):
    header = EVENLY + (EVENLY[500] <= EVENLY) * round(ahead * 1000) * MS
    assert HeaderStamps.of(header, EVENLY).ahead == found * 1000 * MS


@pytest.mark.parametrize(("late", "off"), [(45, False), (80, True)])
def test_what_comes_a_minute_late_is_none(late, off):
    delay = np.zeros(1000, np.int64)
    delay[500] = late * 1000 * MS
    assert np.flatnonzero(far_from_others(delay)).tolist() == [500] * off


@pytest.mark.parametrize(("swing", "found"), [(1.6, True), (3.0, False)])
def test_an_encoders_last_digit_is_not_two_publishers(swing, found):
    k = np.arange(256)
    values = swing * np.sin(2.0 * np.pi * k / 256) + 0.5 * (-1.0) ** k
    assert [one.code for one in alternating("t", {"x": values})] == ["recording.values_alternate"] * found


@pytest.mark.parametrize(
    ("first", "step", "unit", "doubts"),
    [
        (1.6e9, 0.4, "s", []),
        (1.6e9, 0.7, "s", ["clock.unit_by_size"]),
        (1.6e9, 7.0, "s", ["clock.unit_by_size"]),
        (1.6e9, 14.0, "ms", ["clock.unit_by_steps"]),
        (0.0, 0.4, "s", []),
        (0.0, 0.7, "ms", ["clock.unit_by_steps"]),
        (0.0, 100.0, "ms", ["clock.unit_by_steps"]),
        (0.0, 200.0, "us", ["clock.unit_by_steps"]),
        (40_000.0, 1.4e-5, "serial", ["clock.counts_days"]),
        (40_000.0, 3e-5, "s", []),
        (700_000.0, 0.1, "s", []),
        (1_200_000.0, 0.1, "ms", ["clock.unit_by_steps"]),
    ],
)
def test_sizes_and_steps_tell_a_unit(first, step, unit, doubts):
    found, findings = guessed_unit("t", first + step * np.arange(20))
    assert (found, [one.code for one in findings]) == (unit, doubts)
