"""What a residual depends on: as many false alarms as are stated, and what is there is found with its size."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from vsalog.core.dependence import (
    MOST_BLOCKS,
    association,
    block_index,
    block_moments,
    hats,
    least_squares,
    mean_above_zero,
    one_more_above,
)
from vsalog.core.significance import FALSE_ALARM
from vsalog.validation.dependence import gain_of
from vsalog.validation.scores import binned

ROWS = 640


def motion(rng, rows=ROWS):
    t = np.arange(rows) / rows
    return sum(np.sin(2.0 * np.pi * rng.uniform(2.0, 30.0) * t + rng.uniform(0.0, 6.0)) for _ in range(4))


def powers(x, count):
    """Legendre polynomials over the range of x, shape (R, k)."""
    return np.polynomial.legendre.legvander(x / np.abs(x).max(), count)[:, 1:]


def white(rng, x):
    return rng.standard_normal(x.size)


def correlated(rng, x):
    """First-order autoregression that remembers over some three rows, a third of a block."""
    return lfilter([1.0], [1.0, -0.7], rng.standard_normal(x.size + 100))[100:]


def non_stationary(rng, x):
    """Noise whose size changes hundredfold over the log, and with what it is compared with."""
    return (
        rng.standard_normal(x.size)
        * np.exp(2.0 * np.sin(5.0 * np.arange(x.size) / x.size + rng.uniform(0.0, 6.0)))
        * (1 + x**2)
    )


@pytest.mark.every(2)
@pytest.mark.parametrize("columns", [1, 8])
@pytest.mark.parametrize("noise", [white, correlated, non_stationary])
def test_false_alarms_are_as_rare_as_stated(noise, columns):
    """At 1 % over 400 logs: no more than binomial chance makes of it."""
    p = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        x = motion(rng)
        z = np.column_stack((powers(x, columns), noise(rng, x)))
        found = association(block_moments(z, block_index(ROWS)), range(columns))
        p.append(1.0 if found is None else found.p_value)
    assert np.count_nonzero(np.array(p) < 0.01) <= stats.binom.isf(1e-3, len(p), 0.01)
    # And it is no test that never alarms.
    assert np.count_nonzero(np.array(p) < 0.2) >= 0.05 * len(p)


@pytest.mark.parametrize("size", [0.5, 0.75, 1.0])
def test_of_one_column_and_one_coefficient_it_is_students_t(size):
    """Where all blocks are alike but for a sign, and neighbours share nothing, the score is that of a t-test."""
    alike, tried = 1.0, 0
    # What is learnt from other blocks makes neighbours' scores alike by 2/B of their squares.
    while alike > -0.05:
        r = np.random.default_rng(tried).standard_normal((MOST_BLOCKS, 30)) + size / 5.0
        left = r.mean(axis=1) - r.mean()
        alike, tried = float(left[1:] @ left[:-1] / (left @ left)), tried + 1
    z = np.column_stack((np.ones(r.size), r.ravel()))
    found = association(block_moments(z, block_index(r.size)), [0], join=False)
    expected = stats.ttest_1samp(r.mean(axis=1), 0.0).pvalue
    # A score has both signs of a coefficient, and loses the pairs of neighbours.
    assert np.log(found.p_value) == pytest.approx(np.log(expected), rel=0.3)


@pytest.mark.parametrize("strength", [0.3, 1.0])
def test_a_hidden_effect_is_found_with_its_size_next_to_a_control(strength):
    found = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x, other = motion(rng), motion(rng)
        e = strength * x + 3.0 * other + rng.standard_normal(ROWS)
        one = association(block_moments(np.column_stack((other, x, e)), block_index(ROWS)), [1], [0])
        found += one.p_value < FALSE_ALARM
        assert one.coefficients[0] == pytest.approx(strength, abs=5.0 / np.sqrt(ROWS * np.var(x)))
        power = strength**2 * np.var(x)
        assert one.share == pytest.approx(power / (power + 1.0), abs=0.15)
    assert found == 20


def test_what_controls_explain_is_no_dependence():
    rng = np.random.default_rng(1)
    x = motion(rng)
    z = np.column_stack((x, 2.0 * x, 3.0 * x + rng.standard_normal(ROWS)))
    found = association(block_moments(z, block_index(ROWS)), [1], [0])
    assert found is None or (found.p_value > 0.5 and found.rank == 0)


def test_noise_that_remembers_a_sixth_of_the_log_accuses_nothing():
    """Blocks are joined until they are independent, or nothing is reported."""
    accused = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        x, noise = motion(rng), lfilter([1.0], [1.0, -0.99], rng.standard_normal(3 * ROWS))[-ROWS:]
        found = association(block_moments(np.column_stack((x, noise)), block_index(ROWS)), [0])
        accused += found is not None and found.p_value < FALSE_ALARM
    assert accused <= stats.binom.isf(1e-3, 100, 0.01)


def test_blocks_of_a_shape_of_many_columns_are_not_joined_without_a_memory():
    """The fits for neighbours share what they err by; chance exceeds one standard error in 16 of 100 logs."""
    joined, logs = 0, 200
    for seed in range(logs):
        rng = np.random.default_rng(seed)
        x = motion(rng)
        moments = block_moments(np.column_stack((hats(x, binned(x)[0]), white(rng, x))), block_index(ROWS))
        each, some = (association(moments, range(moments.shape[1] - 1), join=join) for join in (False, True))
        joined += each.share != some.share
    assert joined <= stats.binom.isf(1e-3, logs, stats.norm.sf(1.0))


def test_what_never_returns_is_not_predicted():
    """A step that each block has for itself: learnt from others it is none."""
    z = np.column_stack(
        (np.repeat(np.eye(16), 40, axis=0), np.repeat(np.random.default_rng(2).standard_normal(16), 40))
    )
    found = association(block_moments(z, np.arange(640) // 40), range(16))
    assert found.p_value == 1.0
    assert found.share == pytest.approx(0.0, abs=1e-9)


def test_too_few_blocks_tell_nothing():
    z = np.column_stack((np.ones(100), np.ones(100)))
    assert association(block_moments(z, np.arange(100) * 7 // 100), [0]) is None
    assert association(block_moments(z, np.arange(100) * 8 // 100), [0]) is not None


def test_of_many_rows_there_are_64_blocks_and_of_few_one_each():
    assert np.unique(block_index(6400), return_counts=True)[1].tolist() == [100] * 64
    assert block_index(10).tolist() == [*range(10)]


def test_a_curve_in_24_intervals_follows_what_swings_six_times():
    x = np.linspace(0.0, 1.0, 2000)
    y = np.sin(2.0 * np.pi * 6.0 * x)
    columns = hats(x, binned(x)[0])
    left = y - columns @ np.linalg.lstsq(columns, y)[0]
    assert np.mean(left**2) < 0.05 * np.mean(y**2)


@pytest.mark.parametrize(("share", "told"), [(0.07, True), (0.035, False)])
def test_what_explains_less_than_a_twentieth_of_a_residual_is_not_reported(share, told):
    rng = np.random.default_rng(7)
    torque, noise = rng.standard_normal((2, 64_000))
    strength = np.sqrt(share / (1.0 - share))
    gain = gain_of(strength * torque + noise, torque)
    assert gain == (pytest.approx(1.0 - strength, abs=0.02) if told else None)


def test_moments_are_sums_of_squares():
    rng = np.random.default_rng(4)
    z, blocks = rng.standard_normal((50, 3)), np.repeat([0, 1, 4], [10, 25, 15])
    moments = block_moments(z, blocks)
    np.testing.assert_allclose(moments.sum(axis=0), z.T @ z)
    np.testing.assert_allclose(moments[1], z[10:35].T @ z[10:35])
    np.testing.assert_allclose(least_squares(moments.sum(axis=0), [0, 1]), np.linalg.lstsq(z[:, :2], z[:, 2])[0])


def test_a_mean_above_zero_is_students():
    scores = np.random.default_rng(5).standard_normal(12) + 0.5
    assert mean_above_zero(scores) == pytest.approx(stats.ttest_1samp(scores, 0.0, alternative="greater").pvalue)


def test_one_more_above_others_is_students_prediction():
    rng = np.random.default_rng(6)
    p = np.array([one_more_above(x[0], x[1:]) for x in rng.standard_normal((4000, 9))])
    assert stats.kstest(p, "uniform").pvalue > 1e-3
