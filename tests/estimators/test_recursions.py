"""The recursions against closed forms: ridge regression, lstsq, and the papers' equations written out with matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsalog.estimators.qr import QrState, qr_block
from vsalog.estimators.rls import RlsState, rls_block


def problem(seed, count=400, n=5, noise=0.1, condition=1.0):
    rng = np.random.default_rng(seed)
    F = rng.normal(size=(count, n)) * np.logspace(0.0, -np.log10(condition), n)
    return F, F @ rng.normal(size=n) + noise * rng.normal(size=count)


def rls(F, y, p0=1e3, c=1.0, E=None, use=None):
    n = F.shape[1]
    E = np.zeros((len(y), 1, n)) if E is None else E
    use = np.ones(len(y), dtype=bool) if use is None else use
    spread = np.ones(E.shape[1], dtype=bool)
    return rls_block(RlsState.start(n, p0), F, y, use, E, spread, c, p0)


def qr(F, y, forgetting=1.0, E=None, fresh=None, **prior):
    n = F.shape[1]
    E = np.zeros((len(y), 1, n)) if E is None else E
    fresh = np.zeros(len(y), dtype=bool) if fresh is None else fresh
    use, spread = np.ones(len(y), dtype=bool), np.ones(E.shape[1], dtype=bool)
    return qr_block(QrState.start(n, **prior), F, y, use, fresh, E, spread, forgetting, **prior)


@pytest.mark.parametrize("p0", [1e-1, 1e3, 1e8])
def test_rls_is_the_closed_form_regularised_solution(p0):
    F, y = problem(1)
    expected = np.linalg.solve(F.T @ F + np.eye(5) / p0, F.T @ y)
    state, *_ = rls(F, y, p0)
    np.testing.assert_allclose(state.alpha, expected, rtol=1e-9)
    # Coming down from a huge P(0) the subtraction in the paper's update costs P some digits, α none.
    np.testing.assert_allclose(
        state.P, np.linalg.inv(F.T @ F + np.eye(5) / p0), rtol=1e-8 if p0 < 1e6 else 1e-6, atol=1e-15
    )


@pytest.mark.parametrize(("p0", "c"), [(1e6, 1e-5), (1e20, 1e-20), (1e3, 0.3)])
def test_enhanced_rls_follows_the_printed_equations(p0, c):
    """Flacco 2012 eq. 23 with 39 and 41, in matrices."""
    F, y = problem(2, 200, 3)
    alpha, P = np.zeros(3), np.eye(3) * p0
    for f, target in zip(F, y, strict=True):
        rho = f @ P @ f
        a = (c + c * rho) / (1.0 + c * rho)
        K = P @ f / (1.0 + rho)
        alpha = alpha + a * K * (target - f @ alpha)
        P = P - a * np.outer(K, f @ P)
    state, _, _, _, coefficients, _, factor = rls(F, y, p0, c)
    np.testing.assert_allclose(state.alpha, alpha, rtol=1e-6)
    np.testing.assert_allclose(coefficients[-1], state.alpha)
    assert factor[-1] == pytest.approx(a, rel=1e-6)


@given(seed=st.integers(0, 10**6), log_p0=st.floats(0.0, 8.0), log_c=st.floats(-6.0, 0.0))
@settings(max_examples=30)
def test_only_the_product_of_p0_and_c_matters(seed, log_p0, log_c):
    F, y = problem(seed, 100, 4)
    p0, c = 10.0**log_p0, 10.0**log_c
    expected = np.linalg.solve(F.T @ F + np.eye(4) / (c * p0), F.T @ y)
    np.testing.assert_allclose(rls(F, y, p0, c)[0].alpha, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("condition", [1.0, 1e4])
def test_qr_rls_is_lstsq(condition):
    F, y = problem(3, 500, 9, condition=condition)
    expected = np.linalg.lstsq(F, y, rcond=None)[0]
    state, _, _, _, unknowns, _ = qr(F, y)
    np.testing.assert_allclose(state.solve(), expected, rtol=1e-9)
    for k in (20, 100, 499):
        np.testing.assert_allclose(unknowns[k], np.linalg.lstsq(F[: k + 1], y[: k + 1], rcond=None)[0], rtol=1e-9)


@pytest.mark.parametrize("solve", [rls, qr])
def test_prediction_errors_are_recursive_residuals(solve):
    """Innovations over their standard deviation for noise of variance one (Brown, Durbin, Evans 1975); lstsq again each time."""
    F, y = problem(12, 60, 3)
    left = solve(F, y, 1e6)[5] if solve is rls else solve(F, y)[5]
    for k in (10, 31, 59):
        before, information = np.linalg.lstsq(F[:k], y[:k], rcond=None)[0], F[:k].T @ F[:k]
        expected = (y[k] - F[k] @ before) / np.sqrt(1.0 + F[k] @ np.linalg.solve(information, F[k]))
        assert left[k] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("solve", [rls, qr])
def test_directions_are_the_inverse_times_the_functionals(solve):
    F, y = problem(13, 80, 3)
    E = np.random.default_rng(1).normal(size=(80, 2, 3))
    directions = solve(F, y, 1e8, c=0.5, E=E)[2] if solve is rls else solve(F, y, E=E)[2]
    np.testing.assert_allclose(directions[-1], np.linalg.solve(F.T @ F, E[-1].T).T, rtol=1e-6)


def test_forgetting_weights_the_past():
    F, y = problem(4, 300, 4)
    w = 0.98 ** np.arange(299, -1, -1)
    expected = np.linalg.lstsq(F * w[:, None], y * w, rcond=None)[0]
    np.testing.assert_allclose(qr(F, y, 0.98)[0].solve(), expected, rtol=1e-9)


def test_a_prior_is_ridge_regression_on_all_but_the_leading_unknowns():
    F, y = problem(5, 50, 4)
    expected = np.linalg.solve(F.T @ F + np.diag([0.0, 1.0, 1.0, 1.0]) / 7.0, F.T @ y)
    np.testing.assert_allclose(qr(F, y, leading=1, p0=7.0)[0].solve(), expected, rtol=1e-9)


def test_dropping_the_first_row_marginalises_a_constant_per_run():
    """Two runs with constants of their own: the same as one column of ones per run."""
    F, y = problem(6, 200, 3)
    y = y + np.where(np.arange(200) < 120, 5.0, -3.0)
    ones = np.ones((200, 1))
    fresh = np.arange(200) == 120
    per_run = np.column_stack((np.arange(200) < 120, np.arange(200) >= 120, F)).astype(float)
    expected = np.linalg.lstsq(per_run, y, rcond=None)[0]
    solution = qr(np.hstack((ones, F)), y, fresh=fresh)[0].solve()
    np.testing.assert_allclose(solution[1:], expected[2:], rtol=1e-9)
    np.testing.assert_allclose(solution[0], expected[1], rtol=1e-9)


def test_nothing_is_claimed_before_there_are_as_many_samples_as_unknowns():
    F, y = problem(7, 10, 4)
    _, _, _, _, unknowns, _ = qr(F, y)
    assert np.isnan(unknowns[:3]).all()
    assert np.isfinite(unknowns[3:]).all()


def test_an_unexcited_direction_is_reported_to_be_unknown():
    F, y = problem(8, 100, 3)
    F[:, 2] = 0.0
    for part in qr(F, y, E=np.ones((100, 1, 3)))[1:]:
        assert np.isnan(part).all()


@pytest.mark.parametrize("solve", [rls, qr])
def test_samples_not_in_use_change_nothing(solve):
    F, y = problem(9, 60, 3)
    y_bad, use = y.copy(), np.ones(60, dtype=bool)
    y_bad[10:20], use[10:20] = np.nan, False
    E, spread = np.zeros((60, 1, 3)), np.ones(1, dtype=bool)
    if solve is rls:
        state = rls_block(RlsState.start(3, 1e3), F, y_bad, use, E, spread, 1.0, 1e3)[0].alpha
    else:
        state = qr_block(QrState.start(3), F, y_bad, use, ~use & False, E, spread, 1.0)[0].solve()
    keep = np.r_[0:10, 20:60]
    expected = solve(F[keep], y[keep])[0]
    np.testing.assert_allclose(state, expected.alpha if solve is rls else expected.solve(), rtol=1e-10)


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_blocks_give_the_same_bits_as_the_whole(size):
    F, y = problem(12, 1500, 6)
    E = np.random.default_rng(0).normal(size=(1500, 3, 6))
    spread, use, fresh = np.array([True, False, True]), np.ones(1500, dtype=bool), np.arange(1500) % 400 == 399
    whole_r = rls_block(RlsState.start(6, 1e4), F, y, use, E, spread, 1e-2, 1e4)
    whole_q = qr_block(QrState.start(6), F, y, use, fresh, E, spread, 0.99)
    r, q, parts_r, parts_q = RlsState.start(6, 1e4), QrState.start(6), [], []
    for k in range(0, 1500, size):
        s = slice(k, k + size)
        r, *rest = rls_block(r, F[s], y[s], use[s], E[s], spread, 1e-2, 1e4)
        parts_r.append(rest)
        q, *rest = qr_block(q, F[s], y[s], use[s], fresh[s], E[s], spread, 0.99)
        parts_q.append(rest)
    for parts, whole in ((parts_r, whole_r), (parts_q, whole_q)):
        for i, expected in enumerate(whole[1:]):
            np.testing.assert_array_equal(np.concatenate([p[i] for p in parts]), expected)


def test_regressors_whose_squares_are_too_small_for_a_number_do_no_harm():
    """A joint at rest has a deflection of 1e-25 rad after the filters, and a basis its seventh power."""
    F, y = problem(1, n=2)
    rest = np.column_stack((np.full(20, 1e-25), np.full(20, 1e-175)))
    state, *_ = qr(np.vstack((rest, F)), np.r_[np.zeros(20), y])
    np.testing.assert_allclose(state.solve(), np.linalg.lstsq(F, y, rcond=None)[0], rtol=1e-9)
