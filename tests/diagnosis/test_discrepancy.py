"""Model error in the weights: correlation times in closed form, covariances of synthetic rows, blocks left out by brute force."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from written_out import Truth, channels, joint_of

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.discrepancy import correlation_time, factor_of, left_out, weighted_by
from vsalog.diagnosis.linear import formed_of, linearised, variants_of
from vsalog.diagnosis.setting import setting_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system

LONG = 20_000


def autoregressive(a, seed, n=LONG):
    """x_t = a x_{t−1} + e_t, stationary from its first value."""
    noise = np.random.default_rng(seed).standard_normal(n)
    noise[0] /= np.sqrt(1.0 - a * a)
    return lfilter([1.0], [1.0, -a], noise)


@pytest.mark.parametrize("a", [0.3, 0.6, 0.9])
def test_correlation_time_of_an_autoregressive_series(a):
    """1 + 2 Σ aᵏ = (1 + a)/(1 − a); of twenty series the mean is known to some per cent."""
    times = [correlation_time(autoregressive(a, seed)) for seed in range(20)]
    assert np.mean(times) == pytest.approx((1.0 + a) / (1.0 - a), rel=0.08)


def test_correlation_time_of_white_noise_is_one():
    times = [correlation_time(np.random.default_rng(seed).standard_normal(LONG)) for seed in range(20)]
    assert min(times) >= 1.0
    assert np.mean(times) == pytest.approx(1.0, abs=0.05)


def test_correlation_time_is_the_variance_of_a_mean():
    """What it is for: n/τ independent rows have a mean as uncertain as that of n correlated ones."""
    a, n = 0.8, 2000
    series = np.stack([autoregressive(a, seed, n) for seed in range(400)])
    worth = np.mean([correlation_time(x) for x in series[:50]])
    assert np.var(series.mean(axis=1)) == pytest.approx(np.var(series) * worth / n, rel=0.25)


def test_correlation_time_of_what_has_none():
    assert correlation_time(np.zeros(100)) == 1.0
    assert correlation_time(np.ones(1)) == 1.0
    # Rows that change their sign each time are worth more than independent ones; no more is made of it.
    assert correlation_time(np.tile([1.0, -1.0], 500)) == 1.0


def test_a_factor_of_a_covariance():
    A = np.random.default_rng(0).standard_normal((4, 4)) * [1e-6, 1.0, 1e3, 1.0]
    L = factor_of(A.T @ A)
    np.testing.assert_allclose(L @ L.T, A.T @ A, rtol=1e-6, atol=1e-12)
    # Without variance in a direction it can still be divided by.
    singular = factor_of(np.ones((2, 2)))
    np.testing.assert_allclose(singular @ singular.T, np.ones((2, 2)), atol=2e-6)
    assert np.isfinite(np.linalg.inv(singular)).all()


@cache
def system():
    found = channels(duration=20.0, seed=3).thinned()
    joint = joint_of()
    return build_system(joint, found, balance_for(joint))


def drawn(covariance, seed):
    """Rows of Gaussian noise of a covariance, where the system has rows."""
    s = system()
    rows = np.random.default_rng(seed).multivariate_normal(np.zeros(3), covariance, s.centres.size)
    return np.where(s.weights > 0.0, rows, 0.0)


def in_noise(covariance):
    """A covariance with the noise's as the unit."""
    L = np.linalg.cholesky(system().covariance)
    return np.linalg.solve(L, np.linalg.solve(L, covariance).T)


def test_rows_of_noise_alone_leave_the_weights_as_they_are():
    s = system()
    weights = weighted_by(s, drawn(s.covariance, 0))
    np.testing.assert_allclose(in_noise(weights.system.covariance), np.eye(3), atol=0.25)
    np.testing.assert_allclose(weights.times, 1.0, atol=0.3)


@pytest.mark.parametrize("size", [0.0, 0.1, 0.9])
def test_the_weights_are_never_less_than_the_noises(size):
    s = system()
    for seed in range(5):
        shape = np.random.default_rng(seed).uniform(0.0, 4.0 * size, 3)
        weights = weighted_by(s, drawn(s.covariance * np.outer(shape, shape), seed))
        assert np.linalg.eigvalsh(in_noise(weights.system.covariance)).min() > 1.0 - 1e-9
        assert np.all(weights.times >= 1.0)
        # Nor do whitened rows ever weigh more.
        rows = drawn(s.covariance, 50 + seed)
        assert np.sum(weights.system.white(rows) ** 2) <= np.sum(s.white(rows) ** 2) * (1.0 + 1e-6)


def test_the_weights_are_those_of_noise_and_model_error():
    """Model error in one direction of the three equations: the covariance is the sum's, and what is whitened is white."""
    s = system()
    L = np.linalg.cholesky(s.covariance)
    error = L @ np.array([3.0, -4.0, 2.0])
    both = s.covariance + np.outer(error, error)
    rows = drawn(both, 1)
    weights = weighted_by(s, rows)
    count = np.sum(np.all(s.weights > 0.0, axis=1))
    np.testing.assert_allclose(in_noise(weights.system.covariance), in_noise(both), atol=4 * 30 * np.sqrt(2 / count))
    white = weights.system.white(drawn(both, 2))[np.all(s.weights > 0.0, axis=1)] * np.sqrt(weights.times)
    np.testing.assert_allclose(white.T @ white / count, np.eye(3), atol=4 * np.sqrt(2 / count))


def test_correlated_rows_count_for_as_many_as_are_independent():
    """The same model error, once independent from row to row and once coloured: the weights differ by its correlation time."""
    s, a = system(), 0.8
    n = s.centres.size
    slow = np.stack([autoregressive(a, seed, n) for seed in range(3)], axis=1) * np.sqrt(1.0 - a * a)
    rows = np.where(s.weights > 0.0, 10.0 * s.deviation * slow, 0.0)
    weights = weighted_by(s, rows)
    expected = (1.0 + a) / (1.0 - a)
    np.testing.assert_allclose(weights.times, expected, rtol=0.5)
    whole = np.sum(weights.system.white(rows) ** 2)
    assert whole == pytest.approx(np.sum(np.count_nonzero(rows, axis=0) / weights.times), rel=0.05)


@pytest.mark.parametrize("coloured", [False, True])
def test_the_deviance_of_the_joint_itself_is_that_of_its_weights(coloured):
    """Where the noise is that of the system, as it is at its own joint, the deviance is the sum of the whitened squares."""
    s = system()
    rows = drawn(9.0 * s.covariance, 4)
    if coloured:
        rows = np.where(s.weights > 0.0, lfilter(np.ones(8) / 2, [1.0], rows, axis=0), 0.0)
    weights = weighted_by(s, rows)
    plain = np.sum(weights.system.white(s.averaged(joint_of())) ** 2)
    assert weights.deviance(formed_of(weights.system, joint_of(), ())) == pytest.approx(plain, rel=0.02)


def test_each_block_is_predicted_from_the_others():
    """By brute force: fits of priors and rows together, each without one block; of columns without noise."""
    joint, s = joint_of(), system()
    setting = setting_of(joint, s)
    plain = [site for c in catalogue().values() for site in c.sites(setting) if site.starts is None][:12]
    model = linearised(s, joint, (), variants_of(plain, setting, None, (), {}))
    # Data with more in it than noise, and blocks of unequal lengths.
    rng = np.random.default_rng(0)
    rows = model.residual + np.where(s.weights > 0.0, 5.0 * s.deviation * rng.standard_normal(s.weights.shape), 0.0)
    model = replace(
        model, residual=rows, noise_columns=model.noise_columns[:0], noise_residual=model.noise_residual[:0]
    )
    p = model.columns.shape[-1]
    blocks = np.sort(rng.integers(0, 6, s.centres.size))
    chosen = np.arange(p) % 4 != 2
    found = left_out(model, s, chosen, blocks)
    for b in range(6):
        other = blocks != b
        J = np.concatenate([s.whiteners[k] @ model.columns[r][:, chosen]
                            for r, k in enumerate(s.pattern) if other[r] and k in s.whiteners])  # fmt: skip
        r = np.concatenate([s.whiteners[k] @ rows[r] for r, k in enumerate(s.pattern) if other[r] and k in s.whiteners])
        k = J.shape[1]
        delta = np.linalg.lstsq(np.vstack([J, np.eye(k)]), np.concatenate([-r, np.zeros(k)]))[0]
        expected = rows[~other] + model.columns[~other][:, :, chosen] @ delta
        np.testing.assert_allclose(found[~other], np.where(s.weights[~other] > 0.0, expected, 0.0), atol=1e-8)
    assert np.all(found[s.weights == 0.0] == 0.0)


def test_a_model_error_shows_in_blocks_that_were_not_seen():
    """A magnetic detent, which no smooth cause has: the residual is above the noise, at the motor alone."""
    truth = Truth(at_motor=lambda a, da: 0.1 * np.exp(-(((a - 0.3) / 0.05) ** 2)))
    found, joint = channels(truth, duration=20.0, seed=3).thinned(), joint_of()
    s = build_system(joint, found, balance_for(joint))
    setting = setting_of(joint, s)
    model = linearised(s, joint, (), variants_of([], setting, None, (), {}))
    rows = left_out(model, s, np.zeros(0, dtype=bool), np.arange(s.centres.size) * 8 // s.centres.size)
    inflation = np.diag(in_noise(weighted_by(s, rows).system.covariance))
    motor = s.names.index("motor")
    assert inflation[motor] > 4.0
    assert np.all(np.delete(inflation, motor) < 2.0)
