"""Scores against plain formulas, and their intervals against what repeated experiments give."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.signal import lfilter

from vsalog.core.correlation import effective_samples
from vsalog.validation.dependence import dependences
from vsalog.validation.scores import bins_of, score


def correlated(rng, count, time):
    """Noise of standard deviation one that stays alike for `time` samples: a first-order process."""
    a = np.exp(-1.0 / time)
    return lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], rng.standard_normal(count + 50 * int(time)))[50 * int(time) :]


def test_values_are_the_textbook_s():
    rng = np.random.default_rng(1)
    y = np.sin(np.arange(5000) * 0.01) * 3.0
    p = 1.02 * y + 0.1 + 0.05 * rng.standard_normal(y.size)
    s = score(p, y, least=0.05)
    e = p - y
    assert s.mse.value == pytest.approx(np.mean(e**2))
    assert s.rmse.value == pytest.approx(np.sqrt(np.mean(e**2)))
    assert s.nrmse.value == pytest.approx(100 * np.sqrt(np.mean(e**2)) / np.ptp(y))
    assert s.r2.value == pytest.approx(1 - np.mean(e**2) / np.var(y))
    assert s.bias.value == pytest.approx(e.mean())
    assert s.largest == pytest.approx(np.abs(e).max())
    big = np.abs(y) >= 0.05 * np.abs(y).max()
    assert s.msrep.value == pytest.approx(100 * np.mean((e[big] / y[big]) ** 2))


def test_what_is_missing_is_left_out_and_too_little_is_no_score():
    y, p = np.arange(100.0), np.arange(100.0) + 1.0
    y[10:20], p[50:60] = np.nan, np.nan
    assert score(p, y).samples == 80
    assert score(p[3:20], y[3:20]) is None


@pytest.mark.parametrize("time", [1, 10, 100])
def test_effective_samples_of_a_first_order_process(time):
    """N (1 − a)/(1 + a), the textbook's, a = exp(−1/time)."""
    e = correlated(np.random.default_rng(time), 200_000, time)
    a = np.exp(-1.0 / time)
    assert effective_samples(e) == pytest.approx(e.size * (1 - a) / (1 + a), rel=0.25)


@pytest.mark.parametrize(("alike", "told"), [(30, False), (60, True)])
def test_what_is_alike_for_four_times_as_long_is_not_the_filters_doing(alike, told):
    """A mean of so many white samples, where the filter makes ten alike."""
    rng = np.random.default_rng(0)
    error = np.convolve(rng.standard_normal(40_000), np.ones(alike), "same")
    found = dependences(error, rng.standard_normal(error.size), {}, smoothing=10.0)
    assert [one.code for one in found] == ["error.not_white"] * told


@pytest.mark.parametrize("time", [1, 20, 100])
def test_intervals_cover_the_true_value(time):
    """400 experiments with noise that stays alike for a while: the 95 % interval holds the true value as often as it says."""
    rng = np.random.default_rng(7 * time)
    y = np.sin(np.arange(5_000) * 2 * np.pi / 1000)
    hits = 0
    for _ in range(400):
        s = score(y + 0.1 * correlated(rng, y.size, time), y)
        hits += s.nrmse.low <= 100 * 0.1 / 2.0 <= s.nrmse.high
    assert 0.90 <= hits / 400 <= 0.98


@given(st.integers(20, 400), st.integers(0, 10_000))
def test_bins_hold_every_sample_once(count, seed):
    rng = np.random.default_rng(seed)
    x, e = rng.normal(size=count).round(1), rng.normal(size=count)
    bins = bins_of(e, x)
    assert sum(b.samples for b in bins) == count
    assert sum(b.samples * b.bias.value for b in bins) == pytest.approx(e.sum(), abs=1e-9 * count)
    assert sum(b.samples * b.rmse.value**2 for b in bins) == pytest.approx(np.sum(e**2))


def test_intervals_of_the_error_over_a_variable_hold_the_true_values():
    """An error of 0.1 x + noise that stays alike for 20 samples, x in turn from −1 to 1: of each interval the truth is known."""
    rng, hits, count = np.random.default_rng(5), np.zeros(2), 0
    x = np.sin(np.arange(8_000) * 2 * np.pi / 800)
    for _ in range(60):
        for b in bins_of(0.1 * x + 0.05 * correlated(rng, x.size, 20), x):
            inside = (x >= b.low) & (x <= b.high)
            bias, power = 0.1 * x[inside].mean(), 0.01 * np.mean(x[inside] ** 2) + 0.05**2
            hits += b.bias.low <= bias <= b.bias.high, b.rmse.low <= np.sqrt(power) <= b.rmse.high
            count += 1
    assert np.all(hits / count >= 0.90)
    assert np.all(hits / count <= 0.995)


def test_of_few_blocks_an_interval_is_as_wide_as_student_s():
    """Errors that are constant over each of eight blocks: t₇ s / √8 with the textbook's s; without n − 1 in it 6 % less."""
    random, ratios = np.random.default_rng(4), []
    for _ in range(100):
        means = random.normal(size=8)
        error = np.repeat(means, 50)
        found = score(error, np.zeros(error.size)).bias
        textbook = 2.0 * stats.t.ppf(0.975, 7) * means.std(ddof=1) / np.sqrt(8)
        ratios.append((found.high - found.low) / textbook)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)
