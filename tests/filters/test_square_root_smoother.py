"""The square-root smoother against dense Gauss–Markov estimation and a Rauch–Tung–Striebel smoother as textbooks have it."""

import numpy as np
import pytest

from vsalog.filters.square_root_smoother import smooth


def drawn(seed=0, K=30, m=3, n=4, r=2):
    """A random walk with a stretch without measurements, one without a step, and few directions that change."""
    rng = np.random.default_rng(seed)
    H, z = rng.normal(size=(K, m, n)), rng.normal(size=(K, m))
    H[10:13], z[10:13] = 0.0, 0.0
    W = 0.3 * rng.normal(size=(K - 1, r, n))
    W[5] = 0.0
    return H, z, W, rng.normal(size=n), np.triu(rng.normal(size=(n, n))) + 3.0 * np.eye(n)


def run(H, z, W, x, U, **asked):
    return smooth(np.concatenate((H, z[:, :, None]), axis=2), W, x, U, **asked)


def gauss_markov(H, z, W, x, U):
    """Mean, covariances and log likelihood by one dense solution over all instants."""
    (K, m, n), P = H.shape, [U.T @ U]
    for step in W:
        P.append(P[-1] + step.T @ step)
    prior = np.block([[P[min(i, j)] for j in range(K)] for i in range(K)])
    A = np.zeros((K * m, K * n))
    for k in range(K):
        A[k * m : (k + 1) * m, k * n : (k + 1) * n] = H[k]
    S = A @ prior @ A.T + np.eye(K * m)
    gain = np.linalg.solve(S, A @ prior).T
    innovation = z.ravel() - A @ np.tile(x, K)
    after = prior - gain @ A @ prior
    likelihood = -0.5 * innovation @ np.linalg.solve(S, innovation) - 0.5 * np.linalg.slogdet(S)[1]
    mean = (np.tile(x, K) + gain @ innovation).reshape(K, n)
    return mean, np.array([after[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(K)]), likelihood


def textbook(H, z, W, x, U):
    """Kalman filter and Rauch–Tung–Striebel smoother with covariances (Särkkä, Bayesian Filtering and Smoothing, 2013, §8.2)."""
    K, n = len(H), len(x)
    means, covariances, P = [], [], U.T @ U
    for k in range(K):
        if k:
            P = P + W[k - 1].T @ W[k - 1]
        gain = P @ H[k].T @ np.linalg.inv(H[k] @ P @ H[k].T + np.eye(H.shape[1]))
        x, P = x + gain @ (z[k] - H[k] @ x), (np.eye(n) - gain @ H[k]) @ P
        means.append(x)
        covariances.append(P)
    filtered = np.array(means)
    for k in range(K - 2, -1, -1):
        G = covariances[k] @ np.linalg.inv(covariances[k] + W[k].T @ W[k])
        P = covariances[k] + G @ (covariances[k + 1] - covariances[k] - W[k].T @ W[k]) @ G.T
        means[k], covariances[k] = means[k] + G @ (means[k + 1] - means[k]), P
    return np.array(means), np.array(covariances), filtered


def covariances(roots):
    return np.swapaxes(roots, 1, 2) @ roots


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_gauss_markov_estimate(seed):
    case = drawn(seed)
    mean, P, likelihood = gauss_markov(*case)
    found = run(*case)
    np.testing.assert_allclose(found.mean, mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(covariances(found.root), P, rtol=0, atol=1e-9)
    assert found.log_likelihood == pytest.approx(likelihood, abs=1e-9)


def test_it_is_the_textbook_s_filter_and_smoother():
    case = drawn(7)
    mean, P, filtered = textbook(*case)
    found = run(*case)
    np.testing.assert_allclose(found.mean, mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(covariances(found.root), P, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.filtered_mean, filtered, rtol=0, atol=1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e-20])
def test_a_state_with_unknowns_that_others_determine_is_smoothed(size):
    H, z, W, x, U = drawn(4, r=1)
    U[2:] *= size
    W[:] = W[0] * np.linspace(0.5, 2.0, len(W))[:, None, None]
    mean, P, likelihood = gauss_markov(H, z, W, x, U)
    found = run(H, z, W, x, U)
    np.testing.assert_allclose(found.mean, mean, rtol=0, atol=1e-6)
    np.testing.assert_allclose(covariances(found.root), P, rtol=0, atol=1e-6)
    assert found.log_likelihood == pytest.approx(likelihood, abs=1e-9)


def test_roots_are_triangular_and_more_is_known_of_all_than_of_what_came_before():
    found = run(*drawn(3))
    np.testing.assert_array_equal(np.tril(found.root, -1), 0.0)
    gained = covariances(found.filtered_root) - covariances(found.root)
    assert np.linalg.eigvalsh(gained).min() > -1e-10


def test_without_a_step_it_is_least_squares():
    H, z, W, _, _ = drawn(1)
    found = run(H, z, 0.0 * W, np.zeros(4), 1e5 * np.eye(4))
    wanted = np.linalg.lstsq(H.reshape(-1, 4), z.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found.mean, np.tile(wanted, (len(H), 1)), atol=1e-8)


def test_nothing_is_smoothed_unless_asked_for():
    case = drawn(2)
    found = run(*case, backward=False)
    np.testing.assert_array_equal(found.mean, found.filtered_mean)
    assert found.log_likelihood == run(*case).log_likelihood
