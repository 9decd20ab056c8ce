"""By which part trials move a stiffness, range by range of the deflection."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.core.significance import INTERVAL
from vsalog.uncertainty.shift import RANGES, Spread, beyond_noise, spread_over

PHI = np.linspace(-1.0, 1.0, 900)
ALL = np.ones(PHI.size, dtype=bool)


def test_what_moves_the_ends_is_reported_of_the_ends():
    squares = np.where(np.abs(PHI) > 1.0 - 2.0 / RANGES, 0.09, 0.0)[None]
    found = spread_over([PHI], ALL, squares)
    assert found is not None
    np.testing.assert_allclose(found.at(np.array([-1.0, 0.0, 1.0])), [0.3, 0.0, 0.3], atol=1e-12)
    assert found.most == pytest.approx(0.3)


def test_beyond_what_was_looked_at_the_nearest_counts():
    found = spread_over([PHI], np.abs(PHI) < 0.5, (PHI**2)[None])
    np.testing.assert_array_equal(found.at(np.array([-9.0, 9.0])), found.at(np.array([-0.5, 0.5])))


def test_one_sample_in_many_is_no_matter():
    squares = np.zeros((1, PHI.size))
    squares[0, ::40] = 1.0
    assert spread_over([PHI], ALL, squares).most == 0.0


def test_trials_are_put_together():
    squares = np.stack((np.full(PHI.size, 0.01), np.full(PHI.size, 0.03)))
    assert spread_over([PHI], ALL, squares).most == pytest.approx(0.02**0.5)


def test_trials_that_have_every_other_sample_do_not_water_each_other_down():
    squares = np.full((2, PHI.size), np.nan)
    squares[0, ::2], squares[1, 1::2] = 0.04, 0.04
    assert spread_over([PHI], ALL, squares).most == pytest.approx(0.2)


def test_what_noise_may_do_is_nothing():
    assert spread_over([PHI], ALL, np.full((1, PHI.size), -0.5)).most == 0.0


def test_an_estimate_that_is_lost_is_moved_by_all_there_is():
    assert spread_over([PHI], ALL, np.full((1, PHI.size), np.inf)).most == np.inf


def test_a_whole_that_has_no_deflection_is_looked_at_as_one():
    none = np.full(PHI.size, np.nan)
    found = spread_over([none], ALL, np.full((1, PHI.size), 0.25))
    np.testing.assert_array_equal(found.at(none), np.full(PHI.size, 0.5))


@pytest.mark.parametrize(("sure", "squares"), [(~ALL, np.zeros((1, PHI.size))), (ALL, np.full((1, PHI.size), np.nan))])
def test_nothing_is_reported_of_what_was_not_tried(sure, squares):
    assert spread_over([PHI], sure, squares) is None


@given(st.lists(st.tuples(st.floats(-1, 1), st.booleans(), st.floats(0, 1)), min_size=1, max_size=50))
def test_a_part_is_never_more_than_the_most_that_any_sample_moved(samples):
    phi, sure, squares = (np.array(column) for column in zip(*samples, strict=True))
    found = spread_over([phi], sure, squares[None])
    if found is None:
        assert not sure.any()
    else:
        assert isinstance(found, Spread)
        assert found.most <= squares[sure].max() ** 0.5 * (1.0 + 1e-12)


@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_what_moves_together_is_no_more_than_the_whole_and_nothing_within_noise(moved, seed):
    moved = np.array(moved)
    half = np.random.default_rng(seed).standard_normal((3, 3))
    allowed = half @ half.T
    found = beyond_noise(moved, allowed)
    whole = np.outer(moved, moved)
    assert np.linalg.eigvalsh(whole - found).min() >= -1e-9 * max(1.0, whole.max())
    assert np.linalg.eigvalsh(found).min() >= -1e-9 * max(1.0, whole.max())
    distance = moved @ np.linalg.solve(allowed, moved)
    if distance < 0.99 * INTERVAL**2 * 3:
        assert not found.any()
    elif distance > 1.01 * INTERVAL**2 * 3:
        assert found.any()


def test_coefficients_of_unknown_covariance_have_not_moved():
    assert not beyond_noise(np.array([np.nan, 1.0]), np.eye(2)).any()


def test_without_noise_all_that_moves_counts():
    moved = np.array([1.0, -2.0])
    np.testing.assert_array_equal(beyond_noise(moved, np.zeros((2, 2))), np.outer(moved, moved))


def test_a_shift_may_depend_on_the_set_point_alone():
    """A range that no sample is in has what the nearest one has."""
    phi, c = np.meshgrid(np.linspace(-1.0, 1.0, 90), np.linspace(0.1, 0.2, 90))
    phi, c = phi.ravel(), c.ravel()
    counts = (c < 0.18) | (phi < 0.0)
    found = spread_over([phi, c], counts, np.where(c > 0.15, 0.04, 0.0)[None])
    np.testing.assert_allclose(found.at(np.array([0.0, 0.0, 0.9]), np.array([0.11, 0.17, 0.2])), [0.0, 0.2, 0.2])


@pytest.mark.parametrize(("outer", "told"), [(0.08, 0.0), (0.15, 0.3)])
def test_a_range_of_a_deflection_is_moved_where_most_of_it_is(outer, told):
    """A ninth of −1 to 1 is 0.22 wide."""
    squares = np.where(np.abs(PHI) > 1.0 - outer, 0.09, 0.0)[None]
    assert spread_over([PHI], ALL, squares).most == pytest.approx(told)
