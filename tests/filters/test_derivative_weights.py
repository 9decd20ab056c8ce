"""A filter and its own derivatives: weighted least squares by NumPy, polynomials, and what is left of sines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsalog.core.errors import FilterError
from vsalog.filters.derivative_weights import derivative_weights
from vsalog.filters.savitzky_golay import savgol_weights

T = 1e-3


@pytest.mark.parametrize(("window", "degree", "derivatives"), [(51, 5, 3), (9, 3, 1), (201, 8, 2)])
def test_the_value_is_that_of_weighted_least_squares(window, degree, derivatives):
    x = np.arange(window) - window // 2
    bell = (1.0 - (x / (window // 2 + 1)) ** 2) ** (derivatives + 2)
    y = np.random.default_rng(0).standard_normal(window)
    scaled = np.vander(x / window, degree + 1, increasing=True)
    fit, *_ = np.linalg.lstsq(scaled * bell[:, None] ** 0.5, y * bell**0.5, rcond=None)
    assert derivative_weights(window, degree, derivatives, T)[0] @ y == pytest.approx(fit[0], rel=1e-9)


@settings(max_examples=50, deadline=None)
@given(data=st.data(), half=st.integers(2, 400), derivatives=st.integers(0, 4))
def test_polynomials_and_their_derivatives_pass_as_they_are(data, half, derivatives):
    degree = data.draw(st.integers(0, min(2 * half - 1, 20)))
    coefficients = np.array(data.draw(st.lists(st.floats(-1, 1), min_size=degree + 1, max_size=degree + 1)))
    x = np.linspace(-1.0, 1.0, 2 * half + 1)
    polynomial = np.polynomial.Legendre(coefficients)
    weights = derivative_weights(x.size, degree, derivatives, 1.0 / half)
    for s in range(min(derivatives, degree) + 1):
        sizes = np.abs(weights[s]) @ np.abs(polynomial(x)) + np.abs(weights[s]).sum() * 1e-3
        assert weights[s] @ polynomial(x) == pytest.approx(
            polynomial.deriv(s)(0.0) if s else polynomial(0.0), abs=1e-9 * sizes
        )


@pytest.mark.parametrize("turns", [0.5, 1.0, 1.5, 2.0])
def test_all_orders_keep_the_same_part_of_a_sine(turns):
    """Where those of a fitted polynomial do not: of a swing per window 98, 99 and 93 % of value, rate and third derivative."""
    window = 201
    t = (np.arange(window) - window // 2) * T
    omega = 2.0 * np.pi * turns / (window * T)

    def kept(weights):
        """Sines and cosines of which the s-th derivative at 0 is 1, all but for the filter."""
        return np.array([weights[s] @ (np.cos(omega * t - s * np.pi / 2) / omega**s) for s in range(4)])

    ours, theirs = kept(derivative_weights(window, 5, 3, T)), kept(savgol_weights(window, 5, 3, T))
    np.testing.assert_allclose(ours, ours[0], atol=2e-4)
    assert 0.8 < ours[0] <= 1.0
    if turns == 1.0:
        np.testing.assert_allclose(theirs[[0, 1, 3]], [0.98, 0.99, 0.93], atol=5e-3)


def test_a_derivative_is_that_of_the_smoothed_signal():
    """Central differences of the smoothed signal, a fifth of a sample to either side: the window moves on so far."""
    rng, window, fine = np.random.default_rng(1), 101, 5
    weights = derivative_weights(window, 5, 1, T)
    t = np.arange(4000 * fine) * T / fine
    sines = [(rng.uniform(5.0, 250.0), rng.uniform(0.0, 6.0), rng.standard_normal()) for _ in range(30)]
    x = sum(a * np.sin(w * t + p) for w, p, a in sines)
    value, rate = (
        np.stack([np.correlate(x[k::fine], row, "valid") for k in range(fine)], axis=1).ravel() for row in weights
    )
    expected = (value[2:] - value[:-2]) / (2.0 * T / fine)
    np.testing.assert_allclose(rate[1:-1], expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize(("window", "degree", "period"), [(50, 5, T), (5, 5, T), (51, -1, T), (51, 5, 0.0)])
def test_what_cannot_be_is_refused(window, degree, period):
    with pytest.raises(FilterError, match="Savitzky–Golay"):
        derivative_weights(window, degree, 1, period)
