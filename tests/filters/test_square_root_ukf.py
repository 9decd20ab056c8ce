"""The square-root unscented filter against the textbook's with covariances, the Kalman filter, and filterpy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from vsalog.core.errors import FilterError
from vsalog.filters.square_root_ukf import (
    UnscentedWeights,
    downdate,
    keep,
    surprise_limits,
    triangularise,
    unscented_filter,
    workspace,
)

pytestmark = pytest.mark.share(2)


def covariance_factor(P):
    """The lower S with S Sᵀ = P of a covariance that may have zero rows."""
    S, used = np.zeros_like(P), np.flatnonzero(np.diag(P))
    S[np.ix_(used, used)] = np.linalg.cholesky(P[np.ix_(used, used)])
    return S


@njit
def bend(X, first, u, p, Y):
    """X + p[0] X + p[1] tanh(p[2] X) + u, a smooth model of any size."""
    n = X.shape[0]
    for i in range(first, X.shape[1]):
        for k in range(n):
            y = X[k, i] + u[k]
            for j in range(n):
                y += p[0, k, j] * X[j, i]
                z = 0.0
                for m in range(n):
                    z += p[2, j, m] * X[m, i]
                y += p[1, k, j] * np.tanh(z)
            Y[k, i] = y


@njit
def look(X, first, u, p, Y):
    """The first outputs of p[3] X + p[4] X²; as many as Y is asked for."""
    for i in range(first, X.shape[1]):
        for k in range(2):
            y = 0.0
            for j in range(X.shape[0]):
                y += p[3, k, j] * X[j, i] + p[4, k, j] * X[j, i] ** 2
            Y[k, i] = y


PREDICT, CORRECT = unscented_filter(bend, look)


def f(x, u, p):
    return x + p[0] @ x + p[1] @ np.tanh(p[2] @ x) + u


def h(x, p):
    return (p[3] @ x + p[4] @ x**2)[:2]


def textbook(x, P, zs, us, p, Q, R, alpha, beta, kappa):
    """Wan and van der Merwe, Table 7.3.2 with additive noise, points drawn again for the correction."""
    n = x.size
    lam = alpha**2 * (n + kappa) - n
    Wm = np.full(2 * n + 1, 0.5 / (n + lam))
    Wc = Wm.copy()
    Wm[0] = lam / (n + lam)
    Wc[0] = Wm[0] + 1.0 - alpha**2 + beta

    def points(x, P):
        root = np.linalg.cholesky((n + lam) * P)
        return np.vstack([x, x + root.T, x - root.T])

    def spread(a, b):
        return (Wc[:, None] * a).T @ b

    for z, u in zip(zs, us, strict=True):
        moved = np.array([f(s, u, p) for s in points(x, P)])
        x = Wm @ moved
        P = spread(moved - x, moved - x) + Q
        drawn = points(x, P)
        seen = np.array([h(s, p) for s in drawn])
        keep = np.isfinite(z)
        if not keep.any():
            continue
        seen = seen[:, keep]
        mean = Wm @ seen
        Pyy = spread(seen - mean, seen - mean) + R[np.ix_(keep, keep)]
        K = spread(drawn - x, seen - mean) @ np.linalg.inv(Pyy)
        innovation = z[keep] - mean
        x = x + K @ innovation
        P = P - K @ Pyy @ K.T
        P = 0.5 * (P + P.T)
        nis = innovation @ np.linalg.solve(Pyy, innovation)
    return x, P, nis


def ours(x, S, zs, us, p, SQ, SR, weights):
    x, S, room = x.copy(), S.copy(), workspace(x.size, 2)
    for z, u in zip(zs, us, strict=True):
        assert PREDICT(x, S, u, p, weights.packed(), SQ, room)
        nis, _, whole = CORRECT(x, S, z, u, p, weights.packed(), SR, room)
        assert whole
    return x, S, nis


def random_covariance(rng, n, size):
    root = rng.normal(size=(n, n))
    return size * (root @ root.T / n + 0.1 * np.eye(n))


def random_model(seed, n, steps, bent=1.0):
    rng = np.random.default_rng(seed)
    p = 0.2 * rng.normal(size=(5, n, n))
    p[1] *= bent
    p[4] *= bent
    zs, us = rng.normal(size=(steps, 2)), 0.1 * rng.normal(size=(steps, n))
    Q, R, P = random_covariance(rng, n, 0.02), random_covariance(rng, 2, 0.1), random_covariance(rng, n, 0.3)
    return rng.normal(size=n), P, zs, us, p, Q, R


@pytest.mark.every(3)
@pytest.mark.parametrize("n", [2, 3, 4, 6])
@pytest.mark.parametrize(
    ("alpha", "beta", "kappa"), [(1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.7, 2.0, 0.5), (1.0, 0.0, -0.5)]
)
def test_equals_the_textbook_with_covariances(n, alpha, beta, kappa):
    for seed in range(5):
        x, P, zs, us, p, Q, R = random_model(seed, n, 15)
        zs[4], zs[7, 0], zs[9, 1] = np.nan, np.nan, np.nan
        expected = textbook(x, P, zs, us, p, Q, R, alpha, beta, kappa)
        weights = UnscentedWeights.scaled(n, alpha, beta, kappa)
        factors = covariance_factor(P), covariance_factor(Q), covariance_factor(R)
        found = ours(x, factors[0], zs, us, p, factors[1], factors[2], weights)
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-9, atol=1e-9 * np.abs(expected[0]).max())
        np.testing.assert_allclose(found[1] @ found[1].T, expected[1], rtol=1e-9, atol=1e-9 * expected[1].max())
        assert found[2] == pytest.approx(expected[2], rel=1e-9)


@pytest.mark.parametrize("alpha", [1.0, 0.5, 1e-3])
def test_a_linear_model_makes_it_the_kalman_filter(alpha):
    for seed in range(5):
        x, P, zs, us, p, Q, R = random_model(seed, 4, 20, bent=0.0)
        factors = covariance_factor(P), covariance_factor(Q), covariance_factor(R)
        found = ours(x, factors[0], zs, us, p, factors[1], factors[2], UnscentedWeights.scaled(4, alpha, 2.0, 0.0))
        F, H = np.eye(4) + p[0], p[3][:2]
        for z, u in zip(zs, us, strict=True):
            x, P = F @ x + u, F @ P @ F.T + Q
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x, P = x + K @ (z - H @ x), (np.eye(4) - K @ H) @ P
        # A small α divides differences of outputs by itself: what rounding leaves of them grows likewise, squared in P.
        limit = 1e-9 if alpha > 0.1 else 1e-7
        np.testing.assert_allclose(found[0], x, rtol=limit, atol=limit)
        np.testing.assert_allclose(found[1] @ found[1].T, P, rtol=limit, atol=limit * P.max())


def test_equals_filterpy():
    kalman = pytest.importorskip("filterpy.kalman")
    x, P, zs, us, p, Q, R = random_model(3, 4, 30)
    points = kalman.MerweScaledSigmaPoints(4, 0.8, 2.0, 0.3)
    other = kalman.UnscentedKalmanFilter(4, 2, 1.0, lambda x: h(x, p), lambda x, dt, u: f(x, u, p), points)
    other.x, other.P, other.Q, other.R = x.copy(), P.copy(), Q, R
    for z, u in zip(zs, us, strict=True):
        other.predict(u=u)
        # Older versions correct with the points as they were moved; newer ones draw again, as Shin and we do.
        other.sigmas_f = points.sigma_points(other.x, other.P)
        other.update(z)
    factors = covariance_factor(P), covariance_factor(Q), covariance_factor(R)
    found = ours(x, factors[0], zs, us, p, factors[1], factors[2], UnscentedWeights.scaled(4, 0.8, 2.0, 0.3))
    np.testing.assert_allclose(found[0], other.x, rtol=1e-9)
    np.testing.assert_allclose(found[1] @ found[1].T, other.P, rtol=1e-9, atol=1e-9 * other.P.max())


@given(n=st.integers(1, 12), alpha=st.floats(1e-3, 2.0), beta=st.floats(0.0, 4.0), kappa=st.floats(-0.9, 5.0))
def test_weights_sum_to_one_and_give_the_covariance_back(n, alpha, beta, kappa):
    w = UnscentedWeights.scaled(n, alpha, beta, kappa)
    size = abs(w.mean) + 2 * n * w.other
    assert w.mean + 2 * n * w.other == pytest.approx(1.0, abs=1e-12 * size)
    assert w.covariance - w.mean == pytest.approx(1.0 - alpha**2 + beta, abs=1e-12 * size)
    assert 2.0 * w.other * w.spread**2 == pytest.approx(1.0, rel=1e-12)


@settings(deadline=None, max_examples=50)
@given(
    seed=st.integers(0, 2**31),
    scales=st.lists(st.floats(-8.0, 8.0), min_size=4, max_size=4),
    noise=st.floats(-12.0, 0.0),
)
def test_covariances_stay_positive_whatever_the_scales(seed, scales, noise):
    x, P, zs, us, p, Q, R = random_model(seed, 4, 60, bent=0.0)
    D = 10.0 ** np.array(scales)
    zs[10:20, 0] = np.nan
    p[0], p[3] = D[:, None] * p[0] / D, p[3] / D
    S, SQ = D[:, None] * covariance_factor(P), 10.0**noise * D[:, None] * covariance_factor(Q)
    _, S, _ = ours(D * x, S, zs, D * us, p, SQ, 10.0**noise * covariance_factor(R), UnscentedWeights.scaled(4))
    np.testing.assert_array_equal(S, np.tril(S))
    assert np.isfinite(S).all()
    assert (np.diag(S) > 0.0).all()
    P = S @ S.T
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(P), np.diag(P)))).min() > -1e-12


@njit
def many(count, x, S, z, u, p, w, SQ, SR, room):
    for k in range(count):
        z[0], z[1] = np.sin(1e-3 * k), np.cos(1e-3 * k)
        PREDICT(x, S, u, p, w, SQ, room)
        CORRECT(x, S, z, u, p, w, SR, room)


def test_a_million_steps_with_almost_no_process_noise():
    # Two oscillators whose states are of scales 1, 1e-3, 1e-6 and 1e-8; one state of each is measured.
    D, angles, count = np.array([1.0, 1e-3, 1e-6, 1e-8]), (1e-3, 2e-3), 10**6
    pairs, p = ((0, 2), (1, 3)), np.zeros((5, 4, 4))
    for (a, b), angle in zip(pairs, angles, strict=True):
        p[0, a, a] = p[0, b, b] = np.cos(angle) - 1.0
        p[0, a, b], p[0, b, a] = np.sin(angle) * D[a] / D[b], -np.sin(angle) * D[b] / D[a]
    p[3, 0, 0], p[3, 1, 1] = 1.0 / D[0], 1.0 / D[1]
    x, S, room, w = np.zeros(4), np.diag(D), workspace(4, 2), UnscentedWeights.scaled(4).packed()
    many(count, x, S, np.zeros(2), np.zeros(4), p, w, np.diag(1e-12 * D), np.eye(2), room)
    np.testing.assert_array_equal(S, np.tril(S))
    assert (np.diag(S) > 0.0).all()
    # Without process noise it is least squares: the present state turned back to each sample, with the first as a prior.
    age = np.arange(count)[::-1]
    for (a, b), angle, z in zip(
        pairs, angles, (np.sin(1e-3 * np.arange(count)), np.cos(1e-3 * np.arange(count))), strict=True
    ):
        rows = np.column_stack([np.cos(age * angle), -np.sin(age * angle)])
        P = np.linalg.inv(np.eye(2) + rows.T @ rows)
        found, scale = (S @ S.T)[np.ix_([a, b], [a, b])], D[[a, b]]
        # The process noise adds 1e-24 at each of 1e6 steps to 2e-6.
        np.testing.assert_allclose(found / np.outer(scale, scale), P, rtol=1e-9, atol=1e-9 * P.max())
        np.testing.assert_allclose(x[[a, b]] / scale, P @ rows.T @ z, rtol=1e-6, atol=1e-9)


def test_a_known_state_and_nothing_measured():
    x, P, _, us, p, _, R = random_model(1, 4, 1)
    P[2] = P[:, 2] = 0.0
    S = covariance_factor(P)
    np.testing.assert_allclose(S @ S.T, P, atol=1e-15)
    p[0], p[1] = 0.0, 0.0
    room, w, SR = workspace(4, 2), UnscentedWeights.scaled(4).packed(), covariance_factor(R)
    PREDICT(x, S, us[0], p, w, np.zeros((4, 4)), room)
    np.testing.assert_allclose(S @ S.T, P, atol=1e-14)
    before = x.copy(), S.copy()
    assert CORRECT(x, S, np.full(2, np.nan), us[0], p, w, SR, room) == (0.0, 0, True)
    np.testing.assert_array_equal(x, before[0])
    np.testing.assert_array_equal(S, before[1])
    CORRECT(x, S, np.array([1.0, -1.0]), us[0], p, w, SR, room)
    assert x[2] == before[0][2]
    assert (S @ S.T)[2, 2] == 0.0


def test_a_triangle_has_the_matrix_squared():
    rng = np.random.default_rng(0)
    for rows, columns in [(9, 4), (4, 4), (2, 4), (1, 1), (12, 6)]:
        A = rng.normal(size=(columns, rows + 6))
        A[0] *= 1e-8
        M = A[:, :rows].copy()
        triangularise(A, columns, rows)
        L = np.tril(A[:, :columns])
        sizes = np.linalg.norm(M, axis=1)
        np.testing.assert_allclose(
            L @ L.T / np.outer(sizes, sizes), M @ M.T / np.outer(sizes, sizes), rtol=1e-12, atol=1e-14
        )


def test_a_downdate_takes_off_or_refuses():
    rng = np.random.default_rng(1)
    L = covariance_factor(random_covariance(rng, 4, 1.0))
    d = 0.6 * L @ np.array([0.5, -0.5, 0.5, 0.5])
    A = L.copy()
    assert downdate(A, 4, d.copy())
    np.testing.assert_allclose(A @ A.T, L @ L.T - np.outer(d, d), rtol=1e-11, atol=1e-13)
    A = L.copy()
    assert not downdate(A, 4, 2.0 * d)
    np.testing.assert_array_equal(A, L)


def test_a_middle_that_would_leave_no_covariance_is_left_out():
    # f = 5 x² of one state with W₀ < 0: the middle's share is more than that of the points around it.
    x, S, p, u = np.zeros(2), np.diag([1.0, 1.0]), np.zeros((5, 2, 2)), np.zeros(2)
    p[4, 0, 0] = 5.0
    weights, room = UnscentedWeights.scaled(2, 1.0, 0.0, -1.5), workspace(2, 2)
    _, used, whole = CORRECT(x, S, np.zeros(2), u, p, weights.packed(), 1e-3 * np.eye(2), room)
    assert used == 2
    assert not whole
    assert np.isfinite(S).all()
    assert (np.diag(S) > 0.0).all()


@pytest.mark.parametrize(("alpha", "kappa"), [(0.0, 0.0), (1.0, -3.0), (1.0, -4.0), (np.nan, 0.0)])
def test_weights_that_cannot_be_are_refused(alpha, kappa):
    with pytest.raises(FilterError, match="has to be positive"):
        UnscentedWeights.scaled(3, alpha, 0.0, kappa)


@pytest.mark.parametrize(("in_a_row", "lost"), [(50, False), (90, True)])
def test_a_filter_is_lost_whose_latest_innovations_are_beyond_belief_by_a_majority(in_a_row, lost):
    """Of a hundred or so: after n of them the share is 1 − 0.99ⁿ, a half at 69."""
    x, S, surprise = np.zeros(1), np.eye(1), np.zeros(1)
    rows = np.empty((in_a_row, 1)), np.empty((in_a_row, 1, 1)), np.empty(in_a_row), np.zeros(in_a_row, dtype=bool)
    for k in range(in_a_row):
        keep(k, x, S, 1e3, 1, surprise_limits(1), surprise, *rows)
    assert rows[-1][-1] == lost
