"""Stated probabilities and what follows from them, against scipy's normal distribution and IEEE 754."""

import pytest
from scipy.stats import chi2, norm

from vsalog.core.precision import ROUNDING
from vsalog.core.significance import (
    DETECTED,
    DETECTED_OF_MANY,
    DRAWS,
    INTERVAL,
    INTERVAL_BELOW,
    draws_for,
    one_sided,
    two_sided,
    variance_ratio,
)


def test_intervals_hold_95_per_cent_and_false_alarms_are_one_in_a_thousand_and_in_a_million():
    assert 2.0 * norm.sf(INTERVAL) == pytest.approx(0.05, rel=1e-9)
    assert norm.sf(INTERVAL_BELOW) == pytest.approx(0.05, rel=1e-9)
    assert 2.0 * norm.sf(DETECTED) == pytest.approx(1e-3, rel=1e-9)
    assert 2.0 * norm.sf(DETECTED_OF_MANY) == pytest.approx(1e-6, rel=1e-9)
    assert draws_for(1e-3) == DRAWS == 1000


@pytest.mark.parametrize("tail", [0.32, 1e-2, 1e-4])
def test_deviates_leave_that_tail_and_draws_resolve_it(tail):
    assert 2.0 * norm.sf(two_sided(tail)) == pytest.approx(tail, rel=1e-9)
    assert norm.sf(one_sided(tail)) == pytest.approx(tail, rel=1e-9)
    assert 1.0 / draws_for(tail) == pytest.approx(tail, rel=0.1)


@pytest.mark.parametrize("degrees", [8, 32])
def test_a_variance_exceeds_a_ratio_with_the_probability_that_is_stated(degrees):
    assert chi2.sf(variance_ratio(1e-3, degrees) * degrees, degrees) == pytest.approx(1e-3, rel=1e-9)


def test_rounding_is_half_of_a_doubles_digits():
    assert ROUNDING == 2.0**-26
