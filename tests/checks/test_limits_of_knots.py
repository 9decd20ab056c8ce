"""How finely a residual is looked at over a deflection."""

import numpy as np

from vsalog.checks.residual import _knots

RAMP = np.linspace(0.0, 1.0, 2001)


def test_a_gap_of_a_twentieth_of_the_range_has_a_knot_in_it_and_each_block_of_a_log_many():
    knots = _knots(RAMP, 0.0)
    assert 0.02 < np.diff(knots).max() < 0.05


def test_knots_are_no_nearer_than_two_steps_of_the_encoders():
    steps = np.diff(_knots(RAMP, 1.0 / 41.0)) * 41.0
    assert 2.0 <= steps.min() <= steps.max() < 3.0
