"""A push stands out of everything else that is left of an equation, whatever that is."""

import numpy as np
import pytest

from vsalog.diagnosis.causes.link import stands_out

LENGTH, COUNT = 50, 10_000
BUMP = np.sin(np.pi * (np.arange(LENGTH) + 0.5) / LENGTH) ** 2


def bursting(rng):
    """Noise that is six times as loud every now and then."""
    return rng.standard_normal(COUNT) * (1.0 + 5.0 * (np.sin(np.arange(COUNT) / 90.0) > 0.8))


def coloured(rng):
    return np.convolve(rng.standard_normal(COUNT + 200), np.ones(201), mode="valid")


def white(rng):
    return rng.standard_normal(COUNT)


def share(noise, height, draws=200):
    """How often something stands out of noise with a bump so many standard deviations high."""
    found = 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        values = noise(rng)
        at = rng.integers(500, COUNT - 500)
        values[at : at + LENGTH] += height * np.std(values) * BUMP
        found += stands_out(np.convolve(values, BUMP, mode="valid") / (BUMP @ BUMP), LENGTH)
    return found / draws


@pytest.mark.parametrize("noise", [white, coloured, bursting])
def test_of_a_remainder_that_goes_on_nothing_stands_out(noise):
    # Three tests at one in a thousand each; 6 of 200 would have a probability below 1e-4.
    assert share(noise, 0.0) < 0.03


def test_a_push_stands_out_of_noise_and_of_bursts():
    assert share(white, 2.0) > 0.95
    assert share(bursting, 4.0) > 0.95
