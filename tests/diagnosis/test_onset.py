"""Since when a number differs from log to log, and how fast it grows: drawn series, and a line fitted by numpy."""

import numpy as np
import pytest

from vsalog.diagnosis.onset import onset_of

DAYS = np.array([0.0, 29.0, 61.0, 88.0, 121.0, 150.0, 178.0, 212.0, 240.0, 271.0])
NOISE = 0.01


def grown(begins, rate=0.001):
    return rate * np.clip(DAYS - DAYS[begins], 0.0, None)


def seen(away, rng, noise=NOISE):
    return away + noise * rng.standard_normal(away.size)


def told(away, times=DAYS, noise=NOISE):
    return onset_of(away, noise**2 * np.eye(away.size), 0.1, times)


def test_growth_is_dated_within_one_log_and_its_rate_is_in_its_interval():
    rng, right, held, before = np.random.default_rng(0), 0, 0, 0
    for _ in range(200):
        begins = int(rng.integers(0, 7))
        found = told(seen(grown(begins), rng))
        right += abs(found.since - (begins + 1)) <= 1
        before += found.earliest <= begins + 1 <= found.latest
        held += found.rate[1] <= 0.001 <= found.rate[2]
    assert right >= 190
    assert before >= 190
    assert held >= 182  # 95 % of 200, less three standard deviations of that count


def test_the_rate_is_that_of_the_line_through_the_logs_since_then():
    away = seen(grown(4, 0.01), np.random.default_rng(1))
    found = told(away)
    assert found.since == found.latest == 5
    assert found.earliest in (4, 5)  # the line passes through nothing at the fourth
    (slope, _), covariance = np.polyfit(DAYS[5:], away[5:], 1, w=np.full(5, 1.0 / NOISE), cov="unscaled")
    assert found.rate[0] == pytest.approx(slope, rel=0.01)
    assert found.rate[2] - found.rate[0] == pytest.approx(1.96 * np.sqrt(covariance[0, 0]), rel=0.2)


def test_nothing_that_differs_has_no_onset_and_no_rate():
    rng = np.random.default_rng(2)
    found = [told(seen(np.zeros(10), rng)) for _ in range(200)]
    assert sum(one.since < 10 for one in found) <= 19  # 5 % of 200, and three standard deviations of that count
    assert sum(one.rate is not None for one in found) <= 19


def test_what_jumps_is_dated_and_values_that_scatter_make_a_wider_interval():
    rng = np.random.default_rng(3)
    jump = np.where(np.arange(10) >= 6, 0.3, 0.0)
    assert told(seen(jump, rng)).since == 6
    scattered = np.where(np.arange(10) >= 2, 0.5 + 0.1 * rng.standard_normal(10), 0.0)
    found = told(scattered)
    assert found.since == 2
    assert found.rate[2] - found.rate[0] > 5.0 * 1.96 * NOISE / np.sqrt(np.sum((DAYS[2:] - DAYS[2:].mean()) ** 2))


def test_what_all_logs_have_in_common_is_no_scatter_and_no_growth():
    away = seen(grown(3), np.random.default_rng(4))
    common = onset_of(away + 0.02, NOISE**2 * np.eye(10) + 0.05**2, 0.1, DAYS)
    alone = told(away)
    assert common.since in (3, 4, 5)
    assert common.rate[0] == pytest.approx(alone.rate[0], abs=2.0 * (alone.rate[2] - alone.rate[0]))


def test_without_dates_the_logs_are_in_their_order_and_there_is_no_rate():
    found = told(seen(grown(4, 0.01), np.random.default_rng(5)), None)
    assert found.since == 5
    assert found.rate is None
