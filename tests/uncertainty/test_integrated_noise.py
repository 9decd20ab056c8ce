"""A walk's covariance against many walks that are fitted."""

import numpy as np
import pytest

from vsalog.uncertainty.integrated_noise import walk_block, walk_start


def regressors(count):
    t = np.arange(count) * 0.01
    return np.column_stack((np.ones(count), np.sin(2.0 * t), t, np.cos(0.7 * t) ** 3))


@pytest.mark.parametrize("discount", [1.0, 0.998])
def test_a_fit_to_walks_spreads_as_told(discount):
    """Weighted least squares of 4000 walks of known steps: the spread of each coefficient at the end."""
    rng, F = np.random.default_rng(4), regressors(600)
    step = 0.3
    weights = discount ** np.arange(len(F))[::-1]
    P = np.linalg.inv(F.T @ (weights[:, None] * F))
    walks = np.cumsum(step * rng.standard_normal((len(F), 4000)), axis=0)
    found = P @ F.T @ (weights[:, None] * walks)
    directions = np.broadcast_to(P, (len(F), 4, 4)).copy()
    use, fresh = np.ones(len(F), dtype=bool), np.zeros(len(F), dtype=bool)
    parts = [(F[p], use[p], fresh[p], directions[p]) for p in (slice(250), slice(250, None))]
    state, made = walk_block(walk_start(4), *parts[0], discount)
    _, rest = walk_block(state, *parts[1], discount)
    assert step * np.sqrt(rest[-1]) == pytest.approx(found.std(axis=1), rel=0.06)
    whole = walk_block(walk_start(4), F, use, fresh, directions, discount)[1]
    np.testing.assert_array_equal(whole, np.concatenate((made, rest)))


def test_each_run_walks_from_nothing_and_has_its_own_constant():
    """Two runs, a constant each, fitted together; what is asked for are the other coefficients and the last constant."""
    rng, F = np.random.default_rng(5), regressors(600)
    step = 0.3
    first = np.arange(600) < 350
    both = np.column_stack((F[:, 0] * ~first, F[:, 1:], F[:, 0] * first))
    P = np.linalg.inv(both.T @ both)
    steps = step * rng.standard_normal((600, 4000))
    walks = np.concatenate((np.cumsum(steps[first], axis=0), np.cumsum(steps[~first], axis=0)))
    found = (P @ both.T @ walks)[:4]
    fresh = np.zeros(600, dtype=bool)
    fresh[[0, 350]] = True
    # With the first constant eliminated, the inverse of what is left of the normal equations is this part of P.
    directions = np.broadcast_to(P[:4, :4], (600, 4, 4)).copy()
    _, made = walk_block(walk_start(4), F, np.ones(600, dtype=bool), fresh, directions, 1.0)
    assert step * np.sqrt(made[-1]) == pytest.approx(found.std(axis=1), rel=0.06)


def test_rows_that_are_not_used_add_nothing():
    F, use = regressors(100), np.arange(100) < 60
    directions = np.broadcast_to(np.eye(4), (100, 4, 4)).copy()
    _, made = walk_block(walk_start(4), F, use, ~use & False, directions, 1.0)
    assert np.ptp(made[60:], axis=0).max() == 0.0
