"""Corners of a curve, next to a search of all their places by scipy."""

import numpy as np
import pytest
from scipy.optimize import minimize

from vsalog.estimators.corners import corners_of


def curve(corners, count=4000, noise=0.01, seed=0, smooth=lambda x: 0.0 * x):
    """Return places and values of a curve of unit noise with ramps that begin at corners, and a constant and a line in it."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, count)
    y = 0.3 + 2.0 * x + smooth(x) + sum(jump * np.maximum(x - at, 0.0) for at, jump in corners)
    return x, (y + noise * rng.standard_normal(count)) / noise, noise


def fitted(x, y, noise):
    def fit(places):
        ramps = [np.maximum(x - at, 0.0) for at in places]
        rows = np.column_stack((np.ones_like(x), x, *ramps)) / noise
        return np.linalg.qr(np.column_stack((rows, y)), mode="r")

    return fit


def by_scipy(x, y, noise, begin):
    """Return the places of least squares, all unknowns at once."""

    def left(places):
        rows = np.column_stack((np.ones_like(x), x, *(np.maximum(x - at, 0.0) for at in places))) / noise
        return float(np.linalg.lstsq(rows, y, rcond=None)[1][0])

    return minimize(left, begin, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 2000}).x


@pytest.mark.parametrize("corners", [[(0.2, 1.0)], [(-0.4, -0.5), (0.31, 1.0)], [(-0.6, 1.0), (0.0, -1.0), (0.5, 2.0)]])
def test_corners_are_those_of_a_search_of_all_places(corners):
    data = curve(corners)
    found = corners_of(fitted(*data), -1.0, 1.0)
    assert len(found) == len(corners)
    exact = by_scipy(*data, [at for at, _ in corners])
    stds = np.array([one.std for one in found])
    np.testing.assert_allclose([one.place for one in found], exact, atol=0.3 * stds.max())
    assert [one.jump for one in found] == pytest.approx([jump for _, jump in corners], rel=0.02)
    for one in found:
        assert one.below < one.place < one.above


def test_the_standard_deviation_is_that_of_many_noises():
    off = []
    for seed in range(60):
        (found,) = corners_of(fitted(*curve([(0.2, 0.5)], seed=seed)), -1.0, 1.0)
        off.append((found.place - 0.2) / found.std)
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.3


def test_a_line_has_no_corner():
    assert sum(bool(corners_of(fitted(*curve([], seed=seed)), -1.0, 1.0)) for seed in range(200)) <= 2


def test_a_fit_of_corners_out_of_the_range_finds_none():
    assert corners_of(fitted(*curve([(1.5, 3.0)])), -1.0, 1.0) == []


def test_corners_are_found_wherever_they_are():
    for place in np.linspace(0.1, 0.9, 33):
        found = corners_of(fitted(*curve([(-place, 1.0), (place, 1.0)])), -1.0, 1.0)
        assert [one.place for one in found] == pytest.approx([-place, place], abs=0.02), place
