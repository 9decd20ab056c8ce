"""Torques that were computed are reported, whatever was done to them on the way; measured ones are not suspected."""

import numpy as np
import pytest
from scipy.signal import lfilter

from vsalog.checks.torque_independence import computed_from

N, T = 12_000, 2e-3
TIME = np.arange(N) * T
STEP = 2.0 * np.pi / 36_000


def deflection(seed=0):
    """A motion of many waves through two encoders."""
    rng = np.random.default_rng(seed)
    sizes, rates = 0.03 * rng.uniform(0.3, 1.0, 6), rng.uniform(0.2, 20.0, 6)
    phi = sum(a * np.sin(w * TIME + rng.uniform(0, 6)) for a, w in zip(sizes, rates, strict=True))
    return phi, np.round(phi / STEP) * STEP


def law(phi):
    return 20.0 * phi + 2000.0 * phi**3


def interpolated(y):
    every = np.arange(0, N, 5)
    return np.interp(np.arange(N), every, y[every])


def gappy(y):
    out = np.full(N, np.nan)
    out[::5] = y[::5]
    return out


def spiked(y):
    out = y.copy()
    out[np.random.default_rng(1).choice(N, N // 50, replace=False)] += 0.5
    return out


WAYS = {
    "as it is": lambda y: y,
    "one sample late": lambda y: np.roll(y, 1),
    "seven samples late": lambda y: np.roll(y, 7),
    "half a sample late": lambda y: 0.5 * (y + np.roll(y, 1)),
    "mean of five": lambda y: lfilter(np.full(5, 0.2), [1.0], y),
    "first-order lag": lambda y: lfilter([0.2], [1.0, -0.8], y),
    "held for five samples": lambda y: np.repeat(y[::5], 5),
    "interpolated from a fifth of the rate": interpolated,
    "blank between": gappy,
    "with wild values": spiked,
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("factor", [1.0, -3.0])
def test_a_computed_torque_is_reported(way, factor):
    phi = deflection()[1]
    torque = WAYS[way](factor * law(phi))
    said = computed_from(torque, "j", "torque_sensor", phi, "the deflection")
    assert said.code in ("torque.computed", "torque.function", "torque.filtered_function")
    assert (said.part, said.severity, said.evidence["source"]) == ("torque_sensor", "invalidates", "the deflection")


@pytest.mark.every(2)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_a_sensor_with_noise_of_its_own_is_not_suspected(way, noise):
    """A thousandth of the span of noise is a very good sensor."""
    true, phi = deflection()
    measured = law(true)
    measured += noise * np.ptp(measured) * np.random.default_rng(3).standard_normal(N)
    assert computed_from(WAYS[way](measured), "j", "torque_sensor", phi, "the deflection") is None


def test_a_sensor_that_feels_more_than_the_spring_is_not_suspected():
    """Without any noise, but with an inertia of its own: what it says does not follow from the encoders."""
    true, phi = deflection()
    measured = law(true) + 1e-4 * np.gradient(np.gradient(true, T), T)
    assert computed_from(measured, "j", "torque_sensor", phi, "the deflection") is None


@pytest.mark.parametrize(("left", "computed"), [(0.7e-5, True), (1.5e-5, False)])
def test_a_multiple_leaves_a_hundred_thousandth_of_the_spread(left, computed):
    phi = deflection()[0]
    noise = np.random.default_rng(2).standard_normal(N)
    torque = 40.0 * phi + left * 40.0 * np.std(phi) * noise
    assert (computed_from(torque, "j", "torque_sensor", phi, "the deflection") is not None) == computed


@pytest.mark.parametrize(("late", "told"), [(-11, True), (11, True), (14, False), (20, False)])
def test_a_delay_of_a_dozen_samples_is_seen_through(late, told):
    phi = deflection()[1]
    said = computed_from(np.roll(law(phi), late), "j", "torque_sensor", phi, "the deflection")
    assert (said is not None) == told


@pytest.mark.parametrize(("power", "told"), [(5, True), (7, False)])
def test_a_law_of_the_fifth_power_is_seen_behind_a_delay(power, told):
    phi = deflection()[1]
    torque = np.roll(20.0 * phi + 20.0 * phi * (phi / np.max(np.abs(phi))) ** (power - 1), 3)
    assert (computed_from(torque, "j", "torque_sensor", phi, "the deflection") is not None) == told


@pytest.mark.parametrize(("computed", "told"), [(12_000, True), (6000, False)])
def test_eight_thousand_samples_in_the_middle_of_a_log_judge_it(computed, told):
    """What is before and behind is noisy, as where a sensor was switched to and fro."""
    t = np.arange(40_000) * 1e-3
    phi = 0.03 * sum(np.sin(2 * np.pi * f * t + f) for f in (0.31, 0.77, 1.9))
    noise = 1e-3 * np.random.default_rng(3).standard_normal(t.size)
    noise[(t.size - computed) // 2 : (t.size + computed) // 2] = 0.0
    torque = np.roll(law(phi), 3) + noise
    assert (computed_from(torque, "j", "torque_sensor", phi, "the deflection") is not None) == told
