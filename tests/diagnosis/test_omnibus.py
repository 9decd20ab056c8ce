"""The p-value of a rig: uniform where the rig is right, whatever the noise is like, and small where it is not."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from vsalog.diagnosis.linear import Linear
from vsalog.diagnosis.omnibus import p_value

ROWS, BLOCKS, UNKNOWNS = 240, 12, 5


def system(exact=0.0):
    white = SimpleNamespace(white=lambda rows: rows)
    white.names, white.weights, white.exact = ("motor", "link"), np.ones((ROWS, 2)), exact * np.eye(2)
    white.pattern, white.whiteners = np.zeros(ROWS, dtype=np.int64), {0: np.eye(2)}
    return white


def linear(residual, columns, noise=None):
    again = np.zeros((1, *columns.shape)) if noise is None else noise[0][None]
    added = np.zeros((1, *residual.shape)) if noise is None else noise[1][None]
    return Linear((), np.arange(UNKNOWNS + 1), np.zeros(UNKNOWNS), residual, columns, again, added)


def value(residual, columns, seed=0, exact=0.0, noise=None):
    blocks = np.repeat(np.arange(BLOCKS), ROWS // BLOCKS)
    every = np.ones(UNKNOWNS, dtype=np.bool_)
    return p_value(linear(residual, columns, noise), system(exact), every, blocks, seed)


def coloured(rng):
    """Noise of no particular kind: heavy tails, coloured, and louder in some blocks than in others."""
    white = rng.standard_t(3, (ROWS, 2)) * np.repeat(rng.uniform(0.2, 5.0, BLOCKS), ROWS // BLOCKS)[:, None]
    return white + 0.7 * np.roll(white, 1, axis=0)


def test_of_a_right_rig_it_is_uniform_whatever_the_noise():
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((ROWS, 2, UNKNOWNS))
    found = [value(coloured(rng), columns, seed) for seed in range(400)]
    assert kstest(found, "uniform").pvalue > 0.01


def test_of_a_wrong_rig_it_is_as_small_as_it_can_be():
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((ROWS, 2, UNKNOWNS))
    wrong = coloured(rng) + 3.0 * columns[:, :, 2]
    assert value(wrong, columns) <= 0.005


def test_noise_that_columns_and_residual_share_is_not_the_rigs():
    """An acceleration's noise is in the inertia's column and in the equation: their product has a mean that is no error."""
    rng = np.random.default_rng(3)
    clean = rng.standard_normal((ROWS, 2, UNKNOWNS))
    noise, again = rng.standard_normal((2, ROWS, 2))
    columns, more = clean.copy(), np.zeros_like(clean)
    columns[:, :, 0] += noise
    more[:, :, 0] = again
    assert value(noise, columns) < 0.01
    assert value(noise, columns, noise=(more, again)) > 0.05


@pytest.mark.parametrize(("exact", "low"), [(0.0, True), (1.0, False)])
def test_what_filters_leave_does_not_speak_against_the_rig(exact, low):
    rng = np.random.default_rng(4)
    columns = rng.standard_normal((ROWS, 2, UNKNOWNS))
    bias = 0.02 * columns[:, :, 1] + 1e-3 * rng.standard_normal((ROWS, 2))
    assert (value(bias, columns, exact=exact) < 0.05) == low
