"""Savitzky–Golay weights against rational arithmetic and scipy; the filter on polynomials it must reproduce."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_coeffs

from vsalog.core.errors import FilterError
from vsalog.filters.derivative_weights import derivative_polynomials, derivative_weights
from vsalog.filters.savitzky_golay import filter_together, savgol_filter, savgol_lag, savgol_polynomials, savgol_weights


def exact_weights(window, degree, derivative):
    """Least squares in exact fractions by orthogonal polynomials of the grid (Gram), value at sample window // 2."""
    x = [Fraction(2 * i - (window - 1), 2) for i in range(window)]
    centre = x[window // 2]
    # Three-term recurrence of the discrete orthogonal polynomials and of their derivatives at the centre.
    previous, current = [Fraction(0)] * window, [Fraction(1)] * window
    at_previous, at = [Fraction(0)] * (derivative + 1), [Fraction(1)] + [Fraction(0)] * derivative
    norm_previous = Fraction(1)
    weights = [Fraction(0)] * window
    for n in range(degree + 1):
        norm = sum(p * p for p in current)
        for i in range(window):
            weights[i] += at[derivative] * current[i] / norm
        b = norm / norm_previous if n else Fraction(0)
        following = [x[i] * current[i] - b * previous[i] for i in range(window)]
        at_following = [
            centre * at[s] + (s * at[s - 1] if s else 0) - b * at_previous[s] for s in range(derivative + 1)
        ]
        previous, current, at_previous, at, norm_previous = current, following, at, at_following, norm
    return np.array([float(w) for w in weights])


@pytest.mark.parametrize(("window", "degree"), [(5, 2), (11, 3), (12, 3), (51, 4), (101, 3)])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_agrees_with_scipy_where_scipy_is_well_conditioned(window, degree, derivative):
    ours = savgol_weights(window, degree, derivative, period=0.01)[derivative]
    theirs = savgol_coeffs(window, degree, deriv=derivative, delta=0.01, pos=window // 2, use="dot")
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())


@pytest.mark.parametrize(("window", "degree"), [(1000, 20), (1001, 20), (201, 20), (64, 9), (101, 5)])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_keeps_its_digits_at_degree_20_on_1000_samples(window, degree, derivative):
    ours = savgol_weights(window, degree, derivative)[derivative]
    exact = exact_weights(window, degree, derivative)
    np.testing.assert_allclose(ours, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


@settings(max_examples=50)
@given(data=st.data(), window=st.integers(3, 200))
def test_reproduces_any_polynomial_of_its_degree(data, window):
    degree = data.draw(st.integers(0, min(window - 1, 20)))
    coefficients = np.array(data.draw(st.lists(st.floats(-1, 1), min_size=degree + 1, max_size=degree + 1)))
    x = np.linspace(-1.0, 1.0, window)
    polynomial = np.polynomial.Legendre(coefficients)
    weights = savgol_weights(window, degree, 1, period=x[1] - x[0])
    value, slope = savgol_filter(polynomial(x), weights)
    centre = x[window // 2]
    assert value[0] == pytest.approx(polynomial(centre), abs=1e-10 * window)
    assert slope[0] == pytest.approx(polynomial.deriv()(centre) if degree else 0.0, abs=1e-8 * window)


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_blocks_give_the_same_bits_as_the_whole(size):
    x = np.random.default_rng(2).normal(size=3000)
    weights = savgol_weights(101, 8, 2, period=1e-3)
    whole = savgol_filter(x, weights)
    tail, parts = np.empty(0), []
    for k in range(0, x.size, size):
        joined = np.concatenate((tail, x[k : k + size]))
        parts.append(savgol_filter(joined, weights))
        tail = joined[max(joined.size - 100, 0) :]
    np.testing.assert_array_equal(np.concatenate(parts, axis=1), whole)


def test_a_missing_sample_is_not_bridged():
    x = np.zeros(50)
    x[20] = np.nan
    (value,) = savgol_filter(x, savgol_weights(11, 3))
    assert np.isnan(value[10:21]).all()
    assert np.isfinite(np.delete(value, slice(10, 21))).all()


def together(channels, window, degree, derivatives, period=1.0):
    weights = savgol_weights(window, degree, derivatives, period)
    orders = dict.fromkeys(channels, derivatives)
    return filter_together(channels, orders, weights, savgol_polynomials(window, degree))


def test_windows_that_lack_samples_are_fitted_to_those_that_are_there():
    rng, window, degree, period = np.random.default_rng(7), 31, 4, 0.01
    x, y = rng.normal(size=(2, 400))
    x[rng.random(400) < 0.1] = np.nan
    y[100:109] = np.nan
    there = np.isfinite(x + y)
    found = together({"x": x, "y": y}, window, degree, 2, period)
    place = (np.arange(window) - window // 2) * period
    refused = 0
    for first in range(400 - window + 1):
        part = there[first : first + window]
        design = np.vander(place[part], degree + 1, increasing=True)
        gain = [np.sum(row**2) for row in np.linalg.pinv(design)[:3]]
        whole = [np.sum(row**2) for row in np.linalg.pinv(np.vander(place, degree + 1, increasing=True))[:3]]
        if np.max(np.divide(gain, whole)) > 4.0:
            refused += 1
            assert all(np.isnan(values[:, first]).all() for values in found.values())
            continue
        for name, raw in (("x", x), ("y", y)):
            fit = np.polynomial.Polynomial.fit(place[part], raw[first : first + window][part], degree)
            expected = [fit(0.0), fit.deriv(1)(0.0), fit.deriv(2)(0.0)]
            np.testing.assert_allclose(found[name][:, first], expected, rtol=1e-9, atol=1e-9 / period**2)
    assert 0 < refused < 40


def test_an_equation_between_channels_stays_true_where_one_lacks_samples():
    rng = np.random.default_rng(3)
    phi = np.cumsum(rng.normal(size=500))
    tau = 40.0 * phi
    phi[rng.random(500) < 0.1] = np.nan
    found = together({"phi": phi, "tau": tau}, 51, 5, 1)
    assert np.isfinite(found["phi"]).mean() > 0.9
    np.testing.assert_allclose(found["tau"], 40.0 * found["phi"], rtol=1e-9, atol=1e-9)


def test_whole_windows_keep_their_bits():
    x = np.random.default_rng(4).normal(size=300)
    lacking = x.copy()
    lacking[150] = np.nan
    whole, found = (together({"x": values}, 31, 4, 2)["x"] for values in (x, lacking))
    touched = np.zeros(whole.shape[1], dtype=bool)
    touched[120:151] = True
    np.testing.assert_array_equal(found[:, ~touched], whole[:, ~touched])
    assert np.isfinite(found).all()
    assert np.mean(found[0, touched] != whole[0, touched]) > 0.9  # the value's weights have zeros


@pytest.mark.parametrize("degree", [2, 5])
def test_the_smoothed_derivatives_of_a_polynomial_survive_missing_samples(degree):
    rng, window, period = np.random.default_rng(degree), 61, 0.02
    t = np.arange(200) * period
    polynomial = np.polynomial.Polynomial(rng.normal(size=degree + 1))
    x = np.where(rng.random(200) < 0.1, np.nan, polynomial(t))
    weights = derivative_weights(window, degree, 3, period)
    found = filter_together({"x": x}, {"x": 3}, weights, derivative_polynomials(window, degree, 3))["x"]
    centre = t[window // 2 :][: found.shape[1]]
    for order, values in enumerate(found):
        there = np.isfinite(values)
        assert there.mean() > 0.8
        expected = polynomial.deriv(order)(centre) if order <= degree else np.zeros_like(centre)
        np.testing.assert_allclose(values[there], expected[there], rtol=1e-6, atol=1e-5)


def test_a_window_with_too_few_samples_gives_nothing():
    x = np.full(31, np.nan)
    x[::8] = 1.0
    assert np.isnan(together({"x": x}, 31, 4, 0)["x"]).all()
    assert np.isnan(together({"x": np.full(40, np.nan)}, 31, 4, 1)["x"]).all()


def test_lag_is_what_follows_the_centre():
    assert (savgol_lag(1001), savgol_lag(1000), savgol_lag(1)) == (500, 499, 0)


@pytest.mark.parametrize(("window", "degree", "period"), [(5, 5, 1.0), (0, 0, 1.0), (5, -1, 1.0), (5, 2, 0.0)])
def test_impossible_settings_are_refused(window, degree, period):
    with pytest.raises(FilterError, match="Savitzky"):
        savgol_weights(window, degree, 1, period)


def test_a_signal_shorter_than_the_window_gives_nothing():
    assert savgol_filter(np.zeros(4), savgol_weights(5, 2, 1)).shape == (2, 0)
