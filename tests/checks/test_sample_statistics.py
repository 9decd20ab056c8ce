"""What checks ask of samples: closed forms, and cases on either side of each bound."""

import numpy as np
import pytest
from scipy.stats import norm

from vsalog.checks.samples import beyond_noise, go_together, is_fine, is_noisy, rests, span, unlikely_run
from vsalog.core.signals import JointSignals


def signals_of(period=1e-3, **roles):
    made = {name: np.asarray(values, dtype=float) for name, values in roles.items()}
    count = len(next(iter(made.values())))
    return JointSignals(
        joint="j",
        period=period,
        stamps=np.arange(count) * round(period * 1e9),
        time=np.arange(count) * period,
        roles=made,
        starts=np.arange(count) == 0,
        run=np.zeros(count, np.int32),
    )


def test_a_run_that_is_no_chance_is_as_long_as_its_probability_says():
    """2¹⁰ samples that stay with 1/2: 2¹⁰ · 2⁻ⁿ⁺¹ is below a millionth from n = 31 on."""
    assert unlikely_run(0.5, 1024) == 31
    assert unlikely_run(1.0, 1024) > 1024
    assert unlikely_run(0.0, 1024) == 4


def test_what_noise_does_not_exceed_is_the_normal_quantile_for_that_many_steps():
    steps = np.tile([norm.ppf(0.75), -norm.ppf(0.75)], 5000)
    x = np.concatenate(([0.0], np.cumsum(steps)))
    assert beyond_noise(x) == pytest.approx(norm.isf(0.5e-6 / 10_000), rel=1e-9)


@pytest.mark.parametrize(("turns", "noisy"), [(0.2, False), (0.3, True)])
def test_a_signal_is_noisy_that_turns_back_at_a_quarter_of_its_steps(turns, noisy):
    """White noise turns back at two thirds of them, a smooth motion at hardly any."""
    pairs = round(turns * 1000) // 2
    signs = np.ones(1000)
    signs[3 : 3 + 3 * pairs : 3] = -1.0
    x = np.concatenate(([0.0], np.cumsum(signs)))
    assert is_noisy(x, np.ones(x.size, dtype=bool)) == noisy


@pytest.mark.parametrize(("still", "noisy"), [(0.2, True), (0.3, False)])
def test_a_noisy_signal_seldom_stays_where_it_is(still, noisy):
    steps = np.tile([1.0, -1.0], 500)
    steps[: round(still * 1000)] = 0.0
    x = np.concatenate(([0.0], np.cumsum(steps)))
    assert is_noisy(x, np.ones(x.size, dtype=bool)) == noisy


@pytest.mark.parametrize(("seconds", "found"), [(0.4, 0), (0.6, 1)])
def test_a_rest_is_half_a_second(seconds, found):
    x = np.arange(2000.0)
    x[500 : 501 + round(seconds * 1000)] = 500.0
    stretches, resting = rests(signals_of(x=x), x)
    assert len(stretches) == found
    assert resting.sum() == found * (1 + round(seconds * 1000))


@pytest.mark.parametrize(("steps", "fine"), [(15, False), (25, True)])
def test_a_signal_of_twenty_steps_is_fine(steps, fine):
    x = np.tile(np.arange(steps + 1.0), 10)
    assert is_fine(signals_of(x=x), "x") == fine


@pytest.mark.parametrize(("share", "high"), [(0.007, 1.0), (0.015, 9.0)])
def test_one_sample_in_a_hundred_is_an_outlier(share, high):
    x = np.tile([0.0, 1.0], 500)
    x[: round(share * 1000)] = 9.0
    assert span(x) == (0.0, high)


@pytest.mark.parametrize(("correlation", "same"), [(0.8, False), (0.95, True)])
def test_signals_go_together_from_a_correlation_of_nine_tenths(correlation, same):
    t = np.arange(1000) * 2.0 * np.pi / 1000
    y = correlation * np.sin(t) + np.sqrt(1.0 - correlation**2) * np.cos(t)
    assert go_together(np.sin(t), y) == same
