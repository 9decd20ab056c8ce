"""Excitations against their closed forms: value, period, rms, crest, instantaneous frequency."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from vsalog.core.errors import SimulationError
from vsalog.simulation.inputs import (
    at_samples,
    at_steps,
    constant,
    linear_chirp,
    logarithmic_chirp,
    multisine,
    sawtooth,
    sine,
    soft_square,
    square,
    steps,
    sum_of,
    table,
    trapezoid,
)

# A grid over ten seconds whose points miss all edges.
T = (np.arange(100_000) + 0.5) * 1e-4


def rms(values):
    return math.sqrt(np.mean(np.square(values)))


def frequency(values, t):
    """The instantaneous frequency of a sine between −1 and 1, from the slope of its phase, where that can be reported."""
    slope = np.gradient(values, t) / (2.0 * np.pi)
    clear = np.abs(values) < 0.7
    return np.abs(slope[clear]) / np.sqrt(1.0 - values[clear] ** 2), clear


@pytest.mark.parametrize(
    ("signal", "period", "expected"),
    [
        (sine(3.0, 0.5), 2.0, 3.0 / math.sqrt(2.0)),
        (sine(3.0, 0.5, 0.4, offset=2.0), 2.0, math.sqrt(4.5 + 4.0)),
        (square(3.0, 0.5), 2.0, 3.0),
        (square(3.0, 0.5, duty=0.2), 2.0, 3.0),
        (sawtooth(3.0, 0.5), 2.0, 3.0 / math.sqrt(3.0)),
        (multisine(3.0, [0.5, 1.0, 1.5, 2.5]), 2.0, 3.0),
        (multisine(3.0, [0.5, 1.0, 1.5, 2.5], seed=4), 2.0, 3.0),
        (trapezoid(3.0, 0.3, 0.5, period=2.0), 2.0, 3.0 * math.sqrt((0.5 + 2.0 * 0.3 / 3.0) / 2.0)),
        (soft_square(3.0, 2.0, 1e-3), 2.0, 3.0),
        (constant(3.0), 2.0, 3.0),
        (sum_of(sine(3.0, 0.5), sine(4.0, 1.0)), 2.0, 5.0 / math.sqrt(2.0)),
    ],
)
def test_period_and_root_mean_square(signal, period, expected):
    assert_allclose(rms(signal(T)), expected, rtol=2e-3)
    assert_allclose(signal(T + period), signal(T), atol=1e-9)
    assert signal(T).shape == T.shape


def test_a_square_is_up_for_its_share_of_the_period():
    values = square(2.0, 0.5, duty=0.3)(T)
    assert set(values) == {-2.0, 2.0}
    assert_allclose(np.mean(values > 0.0), 0.3, rtol=1e-3)
    assert_array_equal(square(2.0, 0.5)(np.array([0.0, 0.5, 1.5])), [2.0, 2.0, -2.0])
    assert_array_equal(square(2.0, 0.5, math.pi)(np.array([0.5, 1.5])), [-2.0, 2.0])


def test_a_sawtooth_is_straight_between_its_teeth():
    assert_allclose(
        sawtooth(2.0, 0.5)(np.array([0.0, 0.25, 0.5, 0.99, 1.01, 2.0])), [0, 0.5, 1, 1.98, -1.98, 0], atol=1e-12
    )
    assert_allclose(sawtooth(-2.0, 0.5)(np.array([0.5])), [-1.0])


def test_a_soft_square_reaches_its_level_and_has_the_slope_of_its_rise():
    wave = soft_square(2.0, 4.0, 0.1)
    assert_allclose(wave(np.array([0.0, 1.0, 2.0, 3.0])), [0.0, 2.0, 0.0, -2.0], atol=1e-6)
    assert_allclose(wave(np.array([1e-6])) / 1e-6, [2.0 * 2.0 * math.pi / 4.0 / 0.1], rtol=1e-6)


def test_steps_hold_and_soft_ones_end_where_sharp_ones_do():
    times, levels = [1.0, 2.0, 5.0], [3.0, -1.0, 0.5]
    at = np.array([0.0, 0.999, 1.0, 1.999, 2.0, 4.9, 5.0, 9.0])
    assert_array_equal(steps(times, levels)(at), [0.0, 0.0, 3.0, 3.0, -1.0, -1.0, 0.5, 0.5])
    soft = steps(times, levels, rise=0.5)
    assert_allclose(
        soft(np.array([0.9, 1.25, 1.5, 1.9, 2.25, 2.6, 6.0])), [0.0, 1.5, 3.0, 3.0, 1.0, -1.0, 0.5], atol=1e-12
    )


@pytest.mark.parametrize("duration", [8.0, 12.0])
def test_the_frequency_of_a_linear_chirp_runs_evenly(duration):
    found, clear = frequency(linear_chirp(1.0, 0.5, 4.0, duration)(T), T)
    assert_allclose(found, np.minimum(0.5 + 3.5 * T[clear] / duration, 4.0), rtol=2e-2)


@pytest.mark.parametrize(("start", "end"), [(0.5, 8.0), (8.0, 0.5)])
def test_the_frequency_of_a_logarithmic_chirp_runs_by_factors(start, end):
    found, clear = frequency(logarithmic_chirp(1.0, start, end, 8.0)(T), T)
    assert_allclose(found, start * (end / start) ** np.minimum(T[clear] / 8.0, 1.0), rtol=2e-2)


def test_a_chirp_that_stays_is_a_sine():
    for chirp in (linear_chirp, logarithmic_chirp):
        assert_allclose(chirp(2.0, 3.0, 3.0, 4.0, 0.7)(T), sine(2.0, 3.0, 0.7)(T), atol=1e-9)


def test_schroeders_phases_keep_the_crest_low():
    frequencies = np.arange(1, 65) * 0.5
    crest = {seed: np.abs(multisine(1.0, frequencies, seed)(T)).max() for seed in (None, *range(10))}
    # In phase the crest would be sqrt(2 N) = 11.3; Schroeder (1970) finds about 1.7 for a flat spectrum.
    assert crest.pop(None) < 1.8
    assert min(crest.values()) > 2.0


def test_a_multisine_has_the_lines_it_was_given_and_no_other():
    frequencies = [0.5, 1.5, 4.0]
    for seed in (None, 7):
        lines = np.abs(np.fft.rfft(multisine(2.0, frequencies, seed)(T))) / len(T)
        strong = np.flatnonzero(lines > 1e-6)
        assert_allclose(strong * 0.1, frequencies)
        assert_allclose(lines[strong], 2.0 * math.sqrt(2.0 / 3.0) / 2.0)


def test_random_phases_follow_the_seed():
    lines = [0.5, 1.0, 1.5]
    assert_array_equal(multisine(1.0, lines, 3)(T), multisine(1.0, lines, 3)(T))
    assert not np.allclose(multisine(1.0, lines, 3)(T), multisine(1.0, lines, 4)(T))


def test_a_trapezoid_passes_its_corners():
    at = np.array([0.0, 1.0, 1.5, 2.0, 4.0, 5.0, 6.0, 9.0])
    assert_allclose(trapezoid(2.0, 1.0, 2.0, 2.0, start=1.0)(at), [0, 0, 1, 2, 2, 1, 0, 0])
    assert_allclose(trapezoid(2.0, 1.0, 2.0, start=1.0, period=8.0)(np.array([0.5, 9.5, 11.0])), [0, 1, 2])


def test_a_table_joins_or_holds_its_values():
    times, values = np.array([1.0, 2.0, 4.0]), np.array([10.0, 20.0, 0.0])
    at = np.array([0.0, 1.0, 1.5, 2.0, 3.0, 9.0])
    assert_allclose(table(times, values)(at), [10, 10, 15, 20, 10, 0])
    assert_array_equal(table(times, values, held=True)(at), [10, 10, 10, 20, 20, 0])


def test_samples_are_held_over_the_integrators_steps():
    time = np.arange(4) * 0.5
    assert_array_equal(at_steps([1.0, 2.0, 3.0, 4.0], time, 2), np.repeat([[1.0], [2.0], [3.0]], 5, axis=1))
    assert_allclose(at_steps(lambda t: t, time, 2)[1], [0.5, 0.625, 0.75, 0.875, 1.0])
    assert_array_equal(at_samples(2.0, time), [2.0, 2.0, 2.0, 2.0])


@pytest.mark.parametrize("bad", [np.ones(3), [1.0, np.nan, 0.0, 0.0], lambda t: t[:-1], lambda t: t / 0.0])
def test_inputs_that_do_not_fit_are_refused(bad):
    with pytest.raises(SimulationError), np.errstate(all="ignore"):
        at_samples(bad, np.arange(4) * 0.5)
