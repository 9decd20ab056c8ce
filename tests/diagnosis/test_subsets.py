"""The search over sets: scores against scipy's Gaussian densities, best sets against all sets there are."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.stats import cauchy, multivariate_normal

from vsalog.diagnosis.subsets import (
    SAME_SCORE,
    Candidates,
    Ranked,
    _descended,
    _evidence_of_one,
    best_sets,
    within,
    without,
)

ROWS = 40
SEEDS = range(40)


def problem(seed, groups=8, correlated=0.0, twins=False, conflicts=0, loud=3.0, far=1.0):
    """Columns X, data y with a few unknowns in them, and the candidates they make; groups of one or two unknowns."""
    rng = np.random.default_rng(seed)
    first = np.concatenate([[0], np.cumsum(rng.integers(1, 3, groups))])
    p = int(first[-1])
    X = rng.standard_normal((ROWS, p)) + correlated * rng.standard_normal((ROWS, 1))
    if twins:
        # One unknown does exactly what another does, and one what two others do together.
        X[:, -1] = X[:, 0]
        X[:, -2] = X[:, 1] - X[:, 2]
    X *= loud / np.sqrt(ROWS)
    u = np.where(rng.random(p) < 0.3, far * rng.standard_normal(p), 0.0)
    y = X @ u + rng.standard_normal(ROWS)
    conflict = np.zeros((groups, groups), dtype=bool)
    for _ in range(conflicts):
        a, b = rng.choice(groups, 2, replace=False)
        conflict[a, b] = conflict[b, a] = True
    bound = np.full(p, np.inf)
    return X, y, Candidates(X.T @ X, X.T @ y, first, rng.uniform(0.5, 2.5, groups), conflict, -bound, bound)


def all_sets(c):
    """Every set that holds no two groups in conflict."""
    for bits in product((False, True), repeat=len(c)):
        chosen = np.array(bits)
        if not np.any(c.conflict[np.ix_(chosen, chosen)]):
            yield chosen


def brute(c, barred=None):
    sets = [s for s in all_sets(c) if barred is None or not np.any(s & barred)]
    return min(sets, key=c.scored)


def ridge(X, y, deviation):
    """Least squares with the prior as rows of their own."""
    return np.linalg.lstsq(np.vstack([X, np.diag(1.0 / deviation)]), np.concatenate([y, np.zeros(deviation.size)]))[0]


def wide(X, y):
    """Deviations of the unknowns' priors: 1, or as large as an unknown is where that is larger."""
    return np.maximum(np.abs(ridge(X, y, np.ones(X.shape[1]))), 1.0)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("far", [0.3, 5.0])
def test_the_score_is_the_marginal_likelihood(seed, far):
    """y = X u + e with u of a known variance and e of 1: u integrated out, y has the covariance I + X P Xᵀ.

    A variance above 1 is as improbable as the deviation is wide.
    """
    X, y, c = problem(seed, twins=seed % 2 == 1, far=far)
    nothing = multivariate_normal.logpdf(y, np.zeros(ROWS), np.eye(ROWS))
    rng = np.random.default_rng(1000 + seed)
    for _ in range(20):
        chosen = rng.random(len(c)) < 0.5
        own = X[:, np.repeat(chosen, np.diff(c.first))]
        deviation = wide(own, y)
        prior = own * deviation
        density = (
            multivariate_normal.logpdf(y, np.zeros(ROWS), np.eye(ROWS) + prior @ prior.T) - np.log(deviation).sum()
        )
        assert c.scored(chosen) == pytest.approx(nothing - density + c.price[chosen].sum(), abs=1e-8)


def test_the_empty_set_scores_nothing():
    _, _, c = problem(0)
    assert c.scored(np.zeros(len(c), dtype=bool)) == 0.0


@pytest.mark.parametrize("far", [0.3, 5.0])
def test_a_solution_is_the_ridge_regression_of_the_set(far):
    X, y, c = problem(1, far=far)
    chosen = np.arange(len(c)) % 3 != 1
    own = np.repeat(chosen, np.diff(c.first))
    found = c.solution(chosen)
    np.testing.assert_allclose(found[own], ridge(X[:, own], y, wide(X[:, own], y)), atol=1e-10)
    assert np.all(found[~own] == 0.0)
    np.testing.assert_array_equal(c.unknowns(chosen), np.flatnonzero(own))


def test_what_is_far_out_costs_as_its_logarithm():
    """One unknown of much information at u: 2 log u, as a Cauchy prior, where a normal one of deviation 1 would ask for u²/2."""
    costs = []
    for u in (10.0, 100.0):
        information = np.array([[1e6]])
        c = Candidates(information, information[0] * u, np.array([0, 1]), np.zeros(1), np.zeros((1, 1), dtype=bool),
                       np.full(1, -np.inf), np.full(1, np.inf))  # fmt: skip
        costs.append(c.scored(np.ones(1, dtype=bool)) + 0.5 * 1e6 * u**2)
    assert costs[1] - costs[0] == pytest.approx(2.0 * np.log(10.0), abs=1e-2)
    assert costs[1] - costs[0] == pytest.approx(cauchy.logpdf(10.0) - cauchy.logpdf(100.0), abs=1e-2)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("far", [0.3, 5.0])
def test_a_bound_costs_what_it_takes_to_stay_within_it(seed, far):
    """One value beyond its bound: the least of squares and prior within the bound, less that without it."""
    X, y, c = problem(seed, far=far)
    p = c.score.size
    everything = np.ones(len(c), dtype=bool)
    free = c.solution(everything)
    j = seed % p
    high, low = c.high.copy(), c.low.copy()
    if seed % 2:
        high[j] = free[j] - 0.3
    else:
        low[j] = free[j] + 0.3
    A, data = np.vstack([X, np.diag(1.0 / wide(X, y))]), np.concatenate([y, np.zeros(p)])
    bound = lsq_linear(A, data, (low, high), method="bvls", tol=1e-14).x
    extra = 0.5 * (np.sum((A @ bound - data) ** 2) - np.sum((A @ free - data) ** 2))
    assert extra > 0.0
    bounded = replace(c, low=low, high=high)
    assert bounded.scored(everything) - c.scored(everything) == pytest.approx(extra, rel=1e-8)
    # The other values give way to it.
    np.testing.assert_allclose(bounded.solution(everything), bound, atol=1e-8)
    # A bound that is not reached costs nothing.
    near = replace(c, low=free - 0.1, high=free + 0.1)
    assert near.scored(everything) == c.scored(everything)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"loud": 10.0},
        {"correlated": 2.0},
        {"twins": True},
        {"conflicts": 6},
        {"far": 5.0, "correlated": 2.0},
        {"groups": 10, "correlated": 2.0, "twins": True, "conflicts": 4, "loud": 10.0},
    ],
    ids=str,
)
def test_the_best_set_is_the_best_of_all(kind):
    for seed in SEEDS:
        _, _, c = problem(seed, **kind)
        found = best_sets(c)
        expected = c.scored(brute(c))
        assert found[0].score == pytest.approx(expected, abs=1e-5), seed
        for ranked in found:
            assert c.scored(ranked.chosen) == pytest.approx(ranked.score, abs=1e-9)
            assert not np.any(c.conflict[np.ix_(ranked.chosen, ranked.chosen)])
        scores = [r.score for r in found]
        assert scores == sorted(scores)
        assert len({r.chosen.tobytes() for r in found}) == len(found)


@pytest.mark.parametrize("bound", [np.inf, 0.5])
def test_no_single_move_makes_a_set_that_was_found_better(bound):
    """Within bounds the move that is best by its estimate may be none: it drives what stays beyond its own."""
    for seed in range(400 if bound < np.inf else 40):
        _, _, c = problem(seed, groups=10, correlated=2.0, conflicts=4, loud=10.0, far=2.0)
        c = replace(c, low=np.full(c.score.size, -bound), high=np.full(c.score.size, bound))
        for ranked in best_sets(c):
            for g in range(len(c)):
                other = ranked.chosen.copy()
                other[g] ^= True
                if not np.any(c.conflict[np.ix_(other, other)]):
                    assert c.scored(other) > ranked.score - 2 * SAME_SCORE


def test_what_two_do_only_together_is_found():
    """Two groups that nearly cancel: neither is worth its price alone."""
    rng = np.random.default_rng(3)
    common, apart = rng.standard_normal((2, ROWS))
    X = np.column_stack([10 * common + 3 * apart, 10 * common - 3 * apart])
    y = X @ [1.5, -1.5]
    c = problem(0)[2]
    c = replace(c, information=X.T @ X, score=X.T @ y, first=np.array([0, 1, 2]), price=np.full(2, 2.0),
                conflict=np.zeros((2, 2), dtype=bool), low=np.full(2, -np.inf), high=np.full(2, np.inf))  # fmt: skip
    assert c.scored(np.array([True, False])) > c.scored(np.array([True, True]))
    np.testing.assert_array_equal(best_sets(c)[0].chosen, [True, True])


def test_a_start_of_ones_own_is_begun_from():
    _, _, c = problem(5)
    best = best_sets(c)[0]
    again = best_sets(c, [best.chosen])
    np.testing.assert_array_equal(again[0].chosen, best.chosen)


def test_no_candidates_leave_the_empty_set():
    c = Candidates(np.zeros((0, 0)), np.zeros(0), np.zeros(1, dtype=np.int64), np.zeros(0), np.zeros((0, 0), dtype=bool),
                   np.zeros(0), np.zeros(0))  # fmt: skip
    (only,) = best_sets(c)
    assert only.score == 0.0
    assert only.chosen.size == 0


@pytest.mark.parametrize("kind", [{}, {"correlated": 2.0}, {"twins": True, "loud": 10.0}, {"conflicts": 6}], ids=str)
def test_without_a_group_the_best_of_the_other_sets_is_found(kind):
    for seed in SEEDS:
        _, _, c = problem(seed, **kind)
        best = best_sets(c)[0]
        for g in np.flatnonzero(best.chosen):
            barred = np.arange(len(c)) == g
            found = without(c, best, barred)
            assert not np.any(found.chosen & barred)
            assert not np.any(c.conflict[np.ix_(found.chosen, found.chosen)])
            assert found.score == pytest.approx(c.scored(brute(c, barred)), abs=1e-5), (seed, g)


def test_without_everything_nothing_is_left():
    _, _, c = problem(2)
    everything = np.ones(len(c), dtype=bool)
    found = without(c, Ranked(everything, c.scored(everything)), everything)
    assert not np.any(found.chosen)
    assert found.score == 0.0


def test_where_nothing_is_known_of_a_direction_it_stays_where_it_is():
    """Of x + y = 3 alone the nearest solution to where one is."""
    H, pull, now = np.ones((2, 2)), np.array([3.0, 3.0]), np.array([1.0, 0.0])
    wide = np.full(2, np.inf)
    np.testing.assert_allclose(within(H, pull - H @ now, now, -wide, wide), [2.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(30))
def test_one_unknown_alone_is_scored_as_a_set_of_one(seed):
    """Near and far, within its bounds and beyond them."""
    rng = np.random.default_rng(seed)
    A, b, low, high = rng.gamma(1.0, 3.0), 5.0 * rng.standard_normal(), -rng.gamma(1.0), rng.gamma(1.0)
    one = np.array([True])
    c = Candidates(
        np.array([[A]]), np.array([b]), np.array([0, 1]), np.zeros(1), np.zeros((1, 1), dtype=bool), np.array([low]),
        np.array([high]),
    )  # fmt: skip
    assert _evidence_of_one(A, b, low, high) == pytest.approx(c.scored(one), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("weak", [1e-2, 1e-4])
@pytest.mark.parametrize("beside", [False, True], ids=["alone", "beside another"])
def test_what_is_far_out_is_seen_though_the_log_tells_it_less_sharply_than_the_rig(weak, beside):
    """A rotor is 200 times the rig's, whose tolerance is a hundredth of what the log can tell of it."""
    rng, value = np.random.default_rng(3), 40.0 / weak
    X = rng.standard_normal((ROWS, 2)) * np.array([weak, 2.0]) / np.sqrt(ROWS)
    y = X @ np.array([value, 0.5]) + rng.standard_normal(ROWS)
    bound, conflict = np.full(2, np.inf), np.zeros((2, 2), dtype=bool)
    c = Candidates(X.T @ X, X.T @ y, np.arange(3), np.full(2, 2.0), conflict, -bound, bound)
    chosen = np.array([True, beside])
    other = np.eye(ROWS) + beside * np.outer(X[:, 1], X[:, 1])
    best = min(
        np.log(s) - multivariate_normal(np.zeros(ROWS), other + s**2 * np.outer(X[:, 0], X[:, 0])).logpdf(y)
        for s in np.geomspace(1.0, 100.0 * value, 400)
    )
    nothing = -multivariate_normal(np.zeros(ROWS), np.eye(ROWS)).logpdf(y)
    price = float(c.price[chosen].sum())
    assert c.scored(chosen) - price == pytest.approx(best - nothing, abs=1.0)
    assert c.scored(chosen) < c.scored(np.array([False, beside])) - 100.0
    assert c.solution(chosen)[0] == pytest.approx(value, rel=0.2)


def orthogonal(columns, y, price):
    """Groups of one unknown each, without bounds or conflicts."""
    X, n = np.column_stack(columns), len(columns)
    wide = np.full(n, np.inf)
    return Candidates(X.T @ X, X.T @ y, np.arange(n + 1), np.full(n, price), np.zeros((n, n), dtype=bool), -wide, wide)


@pytest.mark.parametrize(("gain", "better"), [(7e-7, False), (1.5e-6, True)])
def test_what_gains_less_than_a_millionth_is_rounding(gain, better):
    """A group of which the log tells nothing gains what its price says."""
    c, free = orthogonal([np.zeros(ROWS)], np.zeros(ROWS), -gain), np.zeros(1, dtype=bool)
    assert _descended(c, free, free, free).chosen[0] == better


@pytest.mark.parametrize(("size", "found"), [(14, True), (18, False)])
def test_two_are_exchanged_for_one_in_sets_of_up_to_sixteen(size, found):
    """One cause does what two of the set do together; either of the two next to it is less probable than both."""
    own = 30.0 * np.eye(ROWS, size)
    one = 3.0 * (own[:, 0] + own[:, 1]) / np.sqrt(2.0)
    c = orthogonal([*own.T, one], 0.9 * own.sum(axis=1), 2.0)
    start, free = np.arange(size + 1) < size, np.zeros(size + 1, dtype=bool)
    there = _descended(c, start, free, free).chosen
    assert there.tolist() == ([False, False, *[True] * (size - 1)] if found else start.tolist())


def test_what_is_told_to_a_sixth_as_sharply_as_the_rig_may_be_far_out():
    """A prior as wide as the value explains it better than the rig's own, with which it would look near."""
    A, b = 0.17, 1.17
    near = 0.5 * (np.log(1.0 + A) - b**2 / (1.0 + A))
    assert b / (1.0 + A) <= 1.0
    assert _evidence_of_one(A, b, -np.inf, np.inf) < near - 0.03
