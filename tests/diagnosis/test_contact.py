"""A push stands out of everything else that is left of an equation, whatever that is."""

from types import SimpleNamespace

import numpy as np
import pytest
from written_out import joint_of

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Remainder
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


def starts_of(residual, noise):
    """Where the search for a short push would begin; of long ones such a log has too few to tell."""
    setting = SimpleNamespace(joint=joint_of(), equations=("link",), duration=20.0, torque_size=lambda: 1.0)
    (site,) = catalogue()["link.contact"].sites(setting)
    found = site.starts(Remainder(np.arange(COUNT) * 2e-3, {"link": residual}, {}, {"link": noise}))
    return [start for start in found if start[1] < 0.5]


@pytest.mark.parametrize("noisy_there", [False, True])
def test_where_noise_bursts_too_nothing_is_a_push(noisy_there):
    """An encoder that moves by whole steps from sample to sample errs for as long, and so does noise drawn again there."""
    rng = np.random.default_rng(5)
    bump = np.zeros(COUNT)
    bump[6000 : 6000 + 3 * LENGTH] = 2.0
    noise = rng.standard_normal((2, COUNT)) + noisy_there * bump * np.array([[1.0], [-0.8]])
    found = starts_of(rng.standard_normal(COUNT) + bump, noise)
    assert bool(found) != noisy_there
    assert all(start < 12.3 and start + duration > 12.0 and 1.0 < torque < 3.0 for start, duration, torque in found)


def test_what_swings_is_no_push():
    """A base that rings for a second: each half of a swing is a bump next to others."""
    rng = np.random.default_rng(6)
    since = np.arange(COUNT) - 6000
    ringing = np.where(since > 0, 4.0 * np.exp(-since / 500.0) * np.sin(np.pi * since / LENGTH), 0.0)
    assert not starts_of(rng.standard_normal(COUNT) + ringing, rng.standard_normal((2, COUNT)))
