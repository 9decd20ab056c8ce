"""Basis functions against numpy's polynomials; residual and integrals against scipy's filters and closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import BSpline
from scipy.signal import bilinear, lfilter

from vsalog.core.basis import PolynomialBasis
from vsalog.estimators.torque import integral_block, lag_block, residual_block


@given(
    order=st.integers(1, 8),
    odd=st.booleans(),
    m=st.integers(1, 4),
    phi=st.floats(-2.0, 2.0),
    c=st.floats(-3.0, 3.0),
    scales=st.tuples(st.floats(0.1, 3.0), st.floats(0.1, 3.0)),
)
def test_rows_are_powers_and_their_derivatives(order, odd, m, phi, c, scales):
    basis = PolynomialBasis.make(order, odd=odd, setpoint_order=m, deflection_scale=scales[0], setpoint_scale=scales[1])
    rows = basis.rows(np.array([phi]), np.array([c]))[0]
    assert rows.shape == (4, basis.size)
    column = 0
    for i in basis.powers:
        polynomial = np.polynomial.Polynomial([0.0] * i + [scales[0] ** -i])
        for j in range(m):
            for s in range(4):
                expected = (polynomial.deriv(s) if s else polynomial)(phi) * (c / scales[1]) ** j
                assert rows[s, column] == pytest.approx(expected, rel=1e-9, abs=1e-9)
            column += 1


def test_where_the_deflection_is_missing_nothing_is_known():
    """Not even of a linear spring, whose stiffness does not depend on it."""
    for basis in (PolynomialBasis.make(1), PolynomialBasis.make(3, odd=False, setpoint_order=2)):
        rows = basis.rows(np.array([0.1, np.nan]), np.array([0.5, 0.5]))
        assert np.isfinite(rows[0]).all()
        assert np.isnan(rows[1]).all()


def test_terms_are_named_in_the_order_of_the_papers_regressor():
    assert PolynomialBasis.make(2, setpoint_order=3).terms == [
        "phi^1", "phi^1*c^1", "phi^1*c^2", "phi^3", "phi^3*c^1", "phi^3*c^2",
    ]  # fmt: skip
    assert PolynomialBasis.make(3, odd=False).terms == ["1", "phi^1", "phi^2"]


def motor(seed=0, count=3000, T=1e-3, B=7.3e-3, D=1e-3):
    """A motor pulled by a known torque: θ̈ from the equation of motion, integrated in closed form."""
    t = np.arange(count) * T
    a, w = 0.6, 2.0 * np.pi * 1.3
    theta, rate, accel = a * np.sin(w * t), a * w * np.cos(w * t), -a * w**2 * np.sin(w * t)
    tau_e = 0.05 * np.sin(2.0 * np.pi * 0.7 * t + 0.3)
    return t, theta, rate, B * accel + D * rate - tau_e, tau_e


def test_the_residual_is_the_flexibility_torque_behind_a_first_order_lag():
    """Flacco 2012 eq. 16: r_e = K_I/(s + K_I) τ_e."""
    K, T = 300.0, 1e-3
    t, theta, rate, tau, tau_e = motor()
    _, r = residual_block(np.full(3, np.nan), theta, rate, tau, np.ones(t.size, bool), 7.3e-3, 1e-3, K, T)
    b, a = bilinear([K], [1.0, K], fs=1.0 / T)
    np.testing.assert_allclose(r[100:], lfilter(b, a, tau_e)[100:], atol=2e-5)


def test_the_residual_follows_the_printed_recursion():
    """Flacco 2012 eq. 17 as printed, with the running integral."""
    K, T, B, D = 300.0, 1e-3, 7.3e-3, 1e-3
    t, theta, rate, tau, _ = motor()
    integral = cumulative_trapezoid(tau, dx=T, initial=0.0)
    bar = K * (B * rate + D * theta - integral)
    expected = np.zeros(t.size)
    for k in range(1, t.size):
        expected[k] = (2 - T * K) / (2 + T * K) * expected[k - 1] + 2 * (bar[k] - bar[k - 1]) / (2 + T * K)
    _, r = residual_block(np.full(3, np.nan), theta, rate, tau, np.ones(t.size, bool), B, D, K, T)
    np.testing.assert_allclose(r, expected, rtol=1e-9, atol=1e-12)


def test_the_lag_is_the_bilinear_first_order_filter():
    x = np.random.default_rng(3).normal(size=(500, 2))
    _, y = lag_block(np.full((2, 2), np.nan), x, np.ones(500, bool), 50.0, 1e-3)
    b, a = bilinear([50.0], [1.0, 50.0], fs=1e3)
    # It begins at zero output with the first input behind it.
    zi = (b[1] * x[:1] - a[1] * 0.0).T
    for i in range(2):
        expected, _ = lfilter(b, a, x[1:, i], zi=zi[i])
        np.testing.assert_allclose(y[1:, i], expected, rtol=1e-10, atol=1e-14)


def test_integrals_begin_again_after_a_gap():
    x = np.random.default_rng(4).normal(size=(300, 3))
    use = np.ones(300, dtype=bool)
    use[100:110] = False
    _, y, fresh = integral_block(np.full((2, 3), np.nan), x, use, 0.01)
    assert list(np.flatnonzero(fresh)) == [0, 110]
    np.testing.assert_allclose(y[:100], cumulative_trapezoid(x[:100], dx=0.01, axis=0, initial=0.0))
    np.testing.assert_allclose(y[110:], cumulative_trapezoid(x[110:], dx=0.01, axis=0, initial=0.0))
    assert np.isnan(y[100:110]).all()


@pytest.mark.parametrize("size", [1, 7])
def test_blocks_give_the_same_bits_as_the_whole(size):
    t, theta, rate, tau, _ = motor(count=400)
    use = np.arange(400) % 150 != 149
    x = np.column_stack((theta, rate))
    whole = (
        residual_block(np.full(3, np.nan), theta, rate, tau, use, 7e-3, 1e-3, 300.0, 1e-3)[1],
        lag_block(np.full((2, 2), np.nan), x, use, 300.0, 1e-3)[1],
        integral_block(np.full((2, 2), np.nan), x, use, 1e-3)[1],
    )
    r, lag, integral = np.full(3, np.nan), np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    parts = ([], [], [])
    for k in range(0, t.size, size):
        s = slice(k, k + size)
        r, a = residual_block(r, theta[s], rate[s], tau[s], use[s], 7e-3, 1e-3, 300.0, 1e-3)
        lag, b = lag_block(lag, x[s], use[s], 300.0, 1e-3)
        integral, c, _ = integral_block(integral, x[s], use[s], 1e-3)
        for part, value in zip(parts, (a, b, c), strict=True):
            part.append(value)
    for part, expected in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(np.concatenate(part), expected)


def test_splines_along_the_setpoint_are_those_of_scipy():
    borders = np.linspace(-0.3, 0.5, 5)
    basis = PolynomialBasis.make(2, setpoint_order=2, deflection_scale=0.2, setpoint_knots=tuple(borders))
    rng = np.random.default_rng(3)
    phi, c = rng.uniform(-0.2, 0.2, 50), rng.uniform(-0.3, 0.5, 50)
    width = borders[1] - borders[0]
    knots = borders[0] + width * np.arange(-2, 7)
    splines = BSpline.design_matrix(c, knots, 2).toarray()
    u = phi / 0.2
    wanted = [u, u * c, u**3, u**3 * c, *(u[:, None] * splines).T, *(u[:, None] ** 3 * splines).T]
    rows = basis.rows(phi, c, derivatives=1)
    assert rows.shape[2] == basis.size == len(basis.terms) == len(basis.pieces) == len(basis.powers_of_terms)
    np.testing.assert_allclose(rows[:, 0], np.column_stack(wanted), atol=1e-14)
    np.testing.assert_allclose(rows[:, 1, 4:10], splines / 0.2, atol=1e-13)
    assert np.isnan(basis.rows(phi[:1], np.array([np.nan]))[0, 0, -6:]).all()


def test_pieces_that_begin_at_knots_are_parabolas_beyond_them():
    basis = PolynomialBasis.make(1, deflection_scale=0.2, knots=2)
    phi = np.array([-0.2, -0.12, -0.05, 0.0, 0.05, 0.12, 0.2])
    u = phi / 0.2
    wanted = [
        u,
        np.maximum(u, 0) ** 2,
        np.maximum(u - 0.5, 0) ** 2,
        -(np.maximum(-u, 0) ** 2),
        -(np.maximum(-u - 0.5, 0) ** 2),
    ]
    rows = basis.rows(phi, derivatives=2)
    np.testing.assert_allclose(rows[:, 0], np.column_stack(wanted), atol=1e-15)
    step = 1e-6
    near = [basis.rows(phi + s * step, derivatives=1) for s in (-1.0, 1.0)]
    inner = np.abs(phi) > 0.01
    np.testing.assert_allclose(rows[inner, 1], ((near[1][:, 0] - near[0][:, 0]) / (2 * step))[inner], atol=1e-6)
    np.testing.assert_allclose(rows[inner, 2], ((near[1][:, 1] - near[0][:, 1]) / (2 * step))[inner], atol=1e-5)
    assert basis.terms == ["phi^1", "knot(+0)", "knot(+0.5)", "knot(-0)", "knot(-0.5)"]
    assert basis.powers_of_terms == (1, -1, -1, -1, -1)
    assert np.isnan(basis.rows(np.array([np.nan]))).all()


def test_corners_are_ramps_away_from_zero():
    basis = PolynomialBasis.make(1, deflection_scale=0.2, setpoint_order=2, corners=(-0.1, 0.0, 0.05))
    phi, c = np.array([-0.2, -0.05, 0.03, 0.2]), np.array([1.0, 2.0, 3.0, 4.0])
    ramps = [phi, np.minimum(phi + 0.1, 0.0), np.maximum(phi, 0.0), np.maximum(phi - 0.05, 0.0)]
    steps = [np.ones(4), phi < -0.1, phi > 0.0, phi > 0.05]
    rows = basis.rows(phi, c, derivatives=2)
    np.testing.assert_allclose(rows[:, 0, ::2], np.column_stack(ramps) / 0.2, atol=1e-15)
    np.testing.assert_allclose(rows[:, 1, 1::2], np.column_stack(steps) / 0.2 * c[:, None])
    assert not rows[:, 2].any()
    assert rows.shape[2] == basis.size == len(basis.terms) == len(basis.pieces) == len(basis.powers_of_terms)
    assert basis.terms[2::2] == ["corner(-0.1)", "corner(0)", "corner(0.05)"]
    assert np.isnan(basis.rows(np.array([np.nan]), np.array([1.0]))).all()
