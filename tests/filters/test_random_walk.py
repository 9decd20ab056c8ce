"""The likelihood of a walk along few directions, against one dense Gaussian and against the filter of the whole state."""

import numpy as np
import pytest

from vsalog.filters.random_walk import RandomWalk, log_likelihood
from vsalog.filters.square_root_smoother import smooth

SHARES = {
    "constant": lambda k: 0.0 * k,
    "walk": lambda k: 0.3 + 0.0 * k,
    "walk with a jump": lambda k: np.where(k == 7, 2.0, 0.1),
    "two jumps": lambda k: np.where((k == 3) | (k == 9), 1.0, 0.0),
}


def drawn(K=14, m=6, n=5, r=2):
    rng = np.random.default_rng(3)
    measurements = rng.normal(size=(K, m, n + 1))
    measurements[5:8] = 0.0
    return measurements, rng.normal(size=(r, n)), rng.uniform(0.1, 3.0, n)


@pytest.mark.parametrize("kind", SHARES)
@pytest.mark.parametrize("r", [1, 2])
def test_the_likelihood_is_that_of_the_dense_gaussian(kind, r):
    measurements, directions, deviations = drawn(r=r)
    shares = SHARES[kind](np.arange(len(measurements) - 1))
    K, m, n = len(measurements), measurements.shape[1], deviations.size
    walk = np.r_[0.0, np.cumsum(shares**2)]
    prior = np.block(
        [[np.diag(deviations**2) + walk[min(i, j)] * directions.T @ directions for j in range(K)] for i in range(K)]
    )
    A = np.zeros((K * m, K * n))
    for k in range(K):
        A[k * m : (k + 1) * m, k * n : (k + 1) * n] = measurements[k, :, :n]
    S, z = A @ prior @ A.T + np.eye(K * m), measurements[:, :, n].ravel()
    expected = -0.5 * z @ np.linalg.solve(S, z) - 0.5 * np.linalg.slogdet(S)[1]
    triangle, logarithm = RandomWalk(measurements, directions).triangle(shares)
    assert log_likelihood(triangle, deviations) + logarithm == pytest.approx(expected, rel=1e-11)


def test_the_likelihood_is_that_of_the_filter_where_little_is_known():
    measurements, directions, _ = drawn(K=60, n=5)
    measurements[:, :, 2] *= 1e-6
    deviations, shares = np.geomspace(1e-6, 1e4, 5), np.full(59, 1e-3)
    steps = shares[:, None, None] * directions
    whole = smooth(measurements, steps, np.zeros(5), np.diag(deviations), backward=False).log_likelihood
    triangle, logarithm = RandomWalk(measurements, directions).triangle(shares)
    assert log_likelihood(triangle, deviations) + logarithm == pytest.approx(whole, rel=1e-9)
    assert len(triangle) == 6
