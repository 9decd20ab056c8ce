"""Covariances from batches of scores, compared with matrices as large as the log, and against draws."""

import numpy as np
import pytest
from scipy.stats import t as student

from vsalog.identification.fit import _Batches


def drawn(seed, windows=40, length=30, p=3):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((windows, length, p)) * rng.uniform(0.1, 3.0, (windows, 1, 1)), rng


def test_scores_are_enlarged_as_bell_and_mccaffrey_do():
    J, rng = drawn(0)
    errors = rng.standard_normal(J.shape[:2])
    inverse = np.linalg.inv(np.einsum("wli,wlj->ij", J, J) + np.eye(3))
    total = np.eye(3)
    for j, e in zip(J, errors, strict=True):
        values, vectors = np.linalg.eigh(np.eye(e.size) - j @ inverse @ j.T)
        score = j.T @ (vectors / np.sqrt(values)) @ vectors.T @ e
        total = total + np.outer(score, score)
    np.testing.assert_allclose(_Batches.of(J, errors, 1).covariance, inverse @ total @ inverse, rtol=1e-9)


@pytest.mark.parametrize("dominant", [1.0, 10.0])
def test_intervals_hold_though_few_windows_say_most(dominant):
    J, rng = drawn(1)
    J[:4] *= dominant
    truth, held, runs = rng.standard_normal((800, 3)), np.zeros(3), 800
    inverse = np.linalg.inv(np.einsum("wli,wlj->ij", J, J) + np.eye(3))
    for x in truth:
        data = J @ x + rng.standard_normal(J.shape[:2])
        found = inverse @ np.einsum("wli,wl->i", J, data)
        parts = _Batches.of(J, J @ found - data, 1)
        half = np.sqrt(np.diag(parts.covariance)) * student.isf(0.025, parts.degrees)
        held += np.abs(found - x) <= half
    # Four standard errors of a share of 0.95 in 800 draws. Where few windows say most, intervals are too wide if anything.
    assert np.all(held / runs >= 0.95 - 0.031)
    assert dominant > 1.0 or np.all(held / runs <= 0.95 + 0.031)


def test_what_the_log_says_nothing_of_is_as_the_prior_has_it():
    J, rng = drawn(2)
    J[..., 2] = 0.0
    parts = _Batches.of(J, rng.standard_normal(J.shape[:2]), 1)
    assert parts.covariance[2, 2] == pytest.approx(1.0)
    assert student.isf(0.025, parts.degrees[2]) == pytest.approx(1.96, abs=1e-3)


@pytest.mark.parametrize("size", [1.0, 1e6, 1e9])
def test_numbers_that_are_one_and_the_same_share_the_priors_variance(size):
    """Of two equal columns the log tells the sum: their difference has the variance of the prior, 2, whatever their size."""
    J, rng = drawn(3)
    J[..., :2] = size * J[..., :1]
    parts = _Batches.of(J, rng.standard_normal(J.shape[:2]), 1)
    difference = np.array([1.0, -1.0, 0.0])
    assert difference @ parts.covariance @ difference == pytest.approx(2.0, rel=1e-6)
    assert np.isfinite(parts.degrees).all()
