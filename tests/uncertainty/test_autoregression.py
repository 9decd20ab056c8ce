"""Coloured noise and outliers: what the autoregression and the weights of heavy tails do to rows."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.stats import norm
from scipy.stats import t as student

from vsalog.uncertainty.autoregression import autoregression
from vsalog.uncertainty.heavy_tails import tail_weights

# Orders that are compared.
MOST = 12


def coloured(count, seed=0, weights=(1.2, -0.5)):
    noise = np.random.default_rng(seed).normal(size=count + 200)
    return lfilter([1.0], [1.0, *(-w for w in weights)], noise)[200:]


def starts(count, *others):
    first = np.zeros(count, dtype=bool)
    first[[0, *others]] = True
    return first


def test_the_weights_of_an_autoregression_are_found():
    found = autoregression(coloured(20_000), starts(20_000), 1e-9, MOST)
    assert found.weights[-1] == pytest.approx([1.2, -0.5, *[0.0] * (found.order - 2)], abs=0.03)
    assert found.deviation[-1] == pytest.approx(1.0, abs=0.02)


def test_white_noise_has_the_order_zero():
    noise = np.random.default_rng(1).normal(size=5000)
    found = autoregression(noise, starts(5000), 1e-9, MOST)
    assert found.order == 0
    assert found.deviation[0] == pytest.approx(np.std(noise), rel=1e-3)


def test_whitened_rows_are_those_of_generalised_least_squares():
    """With the covariance that an autoregression has, whitening is the inverse of that matrix' Cholesky factor."""
    found = autoregression(coloured(3000), starts(3000), 1e-9, MOST)
    # Covariance of the fitted process, by its response to an impulse.
    answer = lfilter([found.deviation[-1]], [1.0, *-found.weights[-1]], np.r_[1.0, np.zeros(5000)])
    gamma = np.array([answer[: answer.size - lag] @ answer[lag:] for lag in range(40)])
    rows = np.random.default_rng(2).normal(size=(40, 3))
    wanted = np.linalg.solve(np.linalg.cholesky(toeplitz(gamma)), rows)
    np.testing.assert_allclose(found.whitened(rows, starts(40)), wanted, rtol=1e-5, atol=1e-6)


def test_nothing_is_predicted_over_a_gap():
    found = autoregression(coloured(3000), starts(3000), 1e-9, MOST)
    rows = np.random.default_rng(3).normal(size=(60, 2))
    both = found.whitened(rows, starts(60, 25))
    np.testing.assert_allclose(both[25:], found.whitened(rows[25:], starts(35)))


def test_no_rows_and_rows_without_noise_are_no_error():
    assert autoregression(np.empty(0), np.empty(0, dtype=bool), 1e-3, MOST).deviation[0] == pytest.approx(1e-3)
    assert autoregression(np.zeros(50), starts(50), 1e-3, MOST).deviation[0] == pytest.approx(1e-3)


def test_normal_noise_is_not_weighted():
    assert sum(tail_weights(np.random.default_rng(seed).normal(size=2000)) is not None for seed in range(50)) <= 2


def test_heavy_tails_are_weighted_as_student_s_t_has_it():
    residual = student.rvs(4.0, size=20_000, random_state=0)
    found = tail_weights(residual)
    np.testing.assert_allclose(found.each, 5.0 / (4.0 + residual**2), rtol=0.05)
    weighted = norm.logpdf(np.sqrt(found.each) * residual).sum()
    assert weighted + found.logarithm == pytest.approx(student.logpdf(residual, 4.0).sum(), rel=1e-4)


def test_outliers_count_for_nothing():
    residual = np.random.default_rng(4).normal(size=2000)
    residual[::100] = 300.0
    found = tail_weights(residual)
    assert found.each[::100].max() < 1e-3
    assert np.median(found.each) > 0.5
    assert tail_weights(np.zeros(10)) is None
