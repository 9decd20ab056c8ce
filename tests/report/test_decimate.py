"""Thinned curves: never aliased, extremes and gaps kept, bounded in size, whatever the data."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vsalog.figures.chart import array
from vsalog.figures.decimation import band, decimated, gaps_of, one_after_the_other, scattered, spans

VALUES = st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(np.nan), st.just(np.inf)), min_size=1, max_size=400)
COLUMNS = st.integers(1, 30)


@given(VALUES, COLUMNS)
def test_a_line_keeps_extremes_order_and_ends_within_its_size(values, columns):
    y = np.array(values)
    x = np.arange(y.size) * 0.5
    known = np.isfinite(y)
    thin_x, thin_y = decimated(x, y, columns)
    assert thin_x.shape == thin_y.shape
    assert thin_x.size <= 4 * columns + 4
    assert np.all(np.diff(thin_x) > 0.0)
    kept = np.isfinite(thin_y)
    # What is drawn was measured: at that time, that value.
    assert set(zip(thin_x[kept], thin_y[kept], strict=True)) <= set(zip(x[known], y[known], strict=True))
    if known.any():
        assert np.nanmin(thin_y) == y[known].min()
        assert np.nanmax(thin_y) == y[known].max()
        assert (thin_x[kept][0], thin_x[kept][-1]) == (x[known][0], x[known][-1])


@given(VALUES, COLUMNS)
def test_no_line_is_drawn_across_what_is_missing(values, columns):
    y = np.array(values)
    x = np.arange(float(y.size))
    thin_x, thin_y = decimated(x, y, columns)
    kept = np.isfinite(thin_y)
    for i in range(thin_x.size - 1):
        if kept[i] and kept[i + 1]:
            assert np.isfinite(y[int(thin_x[i]) : int(thin_x[i + 1]) + 1]).all()


@given(VALUES, COLUMNS)
def test_extremes_of_every_pixel_column_are_kept(values, columns):
    y = np.array(values)
    x = np.arange(float(y.size))
    thin_x, thin_y = decimated(x, y, columns)
    known = np.flatnonzero(np.isfinite(y))
    if known.size < 2:
        return
    edges = np.linspace(x[known[0]], x[known[-1]], columns + 1)
    drawn = np.isfinite(thin_y)
    for i, (a, b) in enumerate(pairwise(edges)):
        last = i == columns - 1
        own = known[(x[known] >= a) & ((x[known] <= b) if last else (x[known] < b))]
        mine = thin_y[drawn & (thin_x >= a) & ((thin_x <= b) if last else (thin_x < b))]
        if own.size:
            assert mine.min() == y[own].min()
            assert mine.max() == y[own].max()


def test_an_alias_does_not_arise():
    """Every 1000th sample of a sine of 1000 samples' period is a constant; its envelope is not."""
    n = 1_000_000
    y = np.sin(2.0 * np.pi * np.arange(n) / 1000.0)
    _, thin = decimated(np.arange(float(n)), y, 100)
    assert thin.max() > 0.9999
    assert thin.min() < -0.9999
    assert thin.size <= 404


def test_a_single_spike_of_an_hour_is_seen():
    y = np.zeros(3_600_000)
    y[1_234_567] = 1.0
    x, thin = decimated(np.arange(y.size) * 1e-3, y, 800)
    assert x[thin == 1.0] == [1234.567]


def test_a_gap_of_time_breaks_the_line():
    x = np.concatenate([np.arange(100) * 0.01, 10.0 + np.arange(100) * 0.01])
    assert gaps_of(x).tolist() == [99]
    thin_x, thin_y = decimated(x, np.ones(200), 10, gaps_of(x))
    (hole,) = np.flatnonzero(np.isnan(thin_y))
    assert 0.99 < thin_x[hole] < 10.0


@given(
    st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(0.0, 10.0), st.booleans()), min_size=1, max_size=200), COLUMNS
)
def test_a_band_encloses_every_sample_of_it(rows, columns):
    middle, half, there = (np.array(c) for c in zip(*rows, strict=True))
    low, high = middle - half, np.where(there, middle + half, np.nan)
    x = np.arange(float(low.size))
    out_x, out_y = band(x, low, high, columns)
    known = np.isfinite(low) & np.isfinite(high)
    if not known.any():
        assert out_x.size == 0
        return
    assert np.nanmin(out_y) == low[known].min()
    assert np.nanmax(out_y) == high[known].max()
    assert out_x.size <= 12 * columns + 12
    assert set(out_x[np.isfinite(out_x)]) <= set(x[known])


@given(st.lists(st.booleans(), min_size=2, max_size=300), st.integers(2, 40))
def test_every_shaded_moment_lies_in_a_span(flags, columns):
    flags = np.array(flags)
    time = np.arange(flags.size) * 0.1
    found = spans(time, flags, columns)
    assert len(found) <= columns
    for t in time[flags]:
        assert any(a <= t <= b for a, b in found)
    if columns > flags.size:  # a column per sample: nothing is merged that is not one stretch
        for t in time[~flags]:
            assert not any(a <= t <= b for a, b in found)


@given(st.integers(0, 5000), st.integers(20, 500), st.integers(0, 9))
def test_scattered_points_keep_the_extremes_of_both(count, most, seed):
    random = np.random.default_rng(seed)
    x, y = random.standard_normal(count), random.standard_normal(count)
    x[::7] = np.nan
    at = scattered(x, y, most)
    assert at.size <= most + 4
    assert np.all(np.diff(at) > 0)
    known = np.isfinite(x)
    if known.any():
        for values in (x, y):
            assert values[at].min() == values[known].min()
            assert values[at].max() == values[known].max()


def test_arrays_survive_their_way_into_the_page():
    import base64

    def back(data):
        return np.frombuffer(base64.b64decode(data["bdata"]), data["dtype"])

    hour = np.arange(3_500_000, 3_500_100) * 1e-3
    np.testing.assert_allclose(back(array(hour)), hour, atol=2e-5, rtol=0)
    holes = np.array([1.0, np.nan, np.inf, 2.0])
    np.testing.assert_array_equal(back(array(holes)), [1.0, np.nan, np.nan, 2.0])
    assert np.isfinite(back(array(np.array([1e300, 1.0])))).all()


def test_runs_that_each_begin_at_zero_follow_one_another():
    run = np.arange(100) * 0.01
    time = one_after_the_other(np.concatenate([run, run, run[:50]]))
    assert np.all(np.diff(time) > 0.0)
    assert gaps_of(time).tolist() == [99, 199]
    for begin, end in ((0, 100), (100, 200), (200, 250)):
        np.testing.assert_allclose(np.diff(time[begin:end]), 0.01)
    assert one_after_the_other(run) is run


def test_points_of_a_figure_are_two_for_each_pixel_column_of_a_wide_screen():
    x, y = np.random.default_rng(0).random((2, 100_000))
    assert 500 < scattered(x, y).size <= 2404
