"""Savitzky–Golay weights against rational arithmetic and scipy; the filter on polynomials it must reproduce."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_coeffs

from vsalog.core.errors import FilterError
from vsalog.filters.savitzky_golay import savgol_filter, savgol_lag, savgol_weights


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


def test_lag_is_what_follows_the_centre():
    assert (savgol_lag(1001), savgol_lag(1000), savgol_lag(1)) == (500, 499, 0)


@pytest.mark.parametrize(("window", "degree", "period"), [(5, 5, 1.0), (0, 0, 1.0), (5, -1, 1.0), (5, 2, 0.0)])
def test_impossible_settings_are_refused(window, degree, period):
    with pytest.raises(FilterError, match="Savitzky"):
        savgol_weights(window, degree, 1, period)


def test_a_signal_shorter_than_the_window_gives_nothing():
    assert savgol_filter(np.zeros(4), savgol_weights(5, 2, 1)).shape == (2, 0)
