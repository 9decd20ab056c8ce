"""What is reported of noise that few samples tell: how many it takes, and how its variance is taken to go on over the octaves."""

import numpy as np
import pytest

from vsalog.uncertainty.long_run import Octave, Sum, _observe, long_run_block, long_run_start

NONE = np.empty(0)
NO_FLAGS = np.empty(0, dtype=bool)


def variances(F, residual):
    """What is reported of a mean's variance, sample by sample, and the state at the end."""
    use = np.ones(residual.size, dtype=bool)
    T = np.ones((residual.size, 1, 1))
    state, told = long_run_block(long_run_start(1), F, residual, residual, use, ~use, T, False, 1.0)
    return told[:, 0], state


def test_a_residual_is_known_from_thirty_two_coefficients_of_two_boxes_on_and_then_looked_at_every_sixty_fourth_sample():
    told, _ = variances(np.ones((600, 1)), np.random.default_rng(0).normal(size=600))
    known = np.flatnonzero(np.isfinite(told))
    assert 200 < known[0] < 300
    looks = np.flatnonzero(np.diff(told[known[0] :]))
    assert np.all(np.diff(looks) == 64)


def test_a_motion_of_seconds_is_in_some_octave():
    """At a kilohertz; seven octaves end at half a second."""
    count, period = 2**17, 4_000
    _, state = variances(np.sin(2.0 * np.pi * np.arange(count) / period)[:, None], np.ones(count))
    assert state.energy[0, :-1].sum() > 0.5 * state.energy[0, -1, 0, 0]


def beyond(octaves):
    """The variance that is expected beyond the last octave; octaves: how many coefficients, and their variance."""
    state = long_run_start(1)
    state.sums[[Sum.SAMPLES, Sum.BOXES, Sum.BOXED]] = 1e6
    for row, (count, variance) in zip(state.octaves, octaves, strict=False):
        row[[Octave.COUNT, Octave.OF_FIT]] = count, count * variance
    _observe(state, np.empty((0, 1)), NONE, NONE, NO_FLAGS, NO_FLAGS, False, 1.0, 0.0, look=True)
    return state.octaves[-1, Octave.VARIANCE]


def test_noise_is_not_expected_to_rise_faster_than_flicker_noise():
    """A random walk has four times the variance an octave further; what nobody saw has twice that of the last one, in all."""
    assert beyond([(1e9, 1.0), (1e9, 4.0), (1e9, 16.0)]) == pytest.approx(32.0, rel=0.01)


def test_noise_is_not_expected_to_fall_faster_than_what_was_differentiated_twice():
    assert beyond([(1e9, 1.0), (1e9, 1e-3), (1e9, 1e-6)]) == pytest.approx(1e-6 / 16.0, rel=0.01)


@pytest.mark.parametrize("variance", [1.0, 1.5])
def test_eight_coefficients_count_as_much_as_what_is_expected_of_them(variance):
    """And their logarithm is too small by one, and has tails for two more."""
    last = len(long_run_start(1).octaves) - 2
    of_octave = (8.0 * np.log(variance) + 3.0) / (8.0 + 8.0)
    found = np.log(beyond([*[(1e9, 1.0)] * last, (8.0, variance)]))
    assert found == pytest.approx(1.5 * of_octave, rel=1e-6)
