"""Channels: the filter against scipy's, what noise is reported, and noise made again like the measured."""

import numpy as np
import pytest
from scipy.signal import savgol_filter
from written_out import signals

from vsalog.residuals.channels import DEGREE, channels_of, noise_in

PERIOD = 1e-3
TIME = np.arange(8000) * PERIOD


def motion(t):
    return np.sin(2 * np.pi * 0.7 * t) + 0.3 * np.sin(2 * np.pi * 3.1 * t + 1.0)


def channels(**said):
    return channels_of(signals(said, PERIOD))


def test_filtered_channels_are_scipys_in_value_and_derivatives():
    noisy = motion(TIME) + 1e-3 * np.random.default_rng(0).standard_normal(TIME.size)
    found = channels(link_position=noisy)
    inside = slice(found.window, -found.window)
    for order in range(3):
        expected = savgol_filter(noisy, found.window, DEGREE, deriv=order, delta=PERIOD)
        np.testing.assert_allclose(found.roles["link_position"][order][inside], expected[inside], rtol=1e-8, atol=1e-7)


def test_nothing_is_filtered_across_a_gap():
    """What stands on one side of a gap must not be felt on the other."""
    bound = signals({"link_position": np.where(np.arange(4000) < 2000, 0.0, 1.0) + motion(TIME[:4000])}, PERIOD)
    bound.starts[2000] = True
    found = channels_of(bound)
    half = found.window // 2
    assert np.isnan(found.roles["link_position"][:, 2000 - half : 2000 + half]).all()
    inside = np.r_[half : 2000 - half, 2000 + half : 4000 - half]
    expected = motion(TIME[:4000]) + (np.arange(4000) >= 2000)
    np.testing.assert_allclose(found.roles["link_position"][0][inside], expected[inside], atol=1e-6)


@pytest.mark.parametrize("deviation", [1e-4, 3e-3])
def test_white_noise_is_measured(deviation):
    said = motion(TIME) + deviation * np.random.default_rng(1).standard_normal(TIME.size)
    noise = noise_in(said)
    assert noise.step == 0.0
    assert noise.deviation == pytest.approx(deviation, rel=0.06)


@pytest.mark.parametrize("step", [2e-4, 1e-2])
def test_the_steps_of_an_encoder_are_detected_and_are_no_white_noise(step):
    noise = noise_in(np.round(motion(TIME) / step) * step)
    assert noise.step == pytest.approx(step, rel=1e-6)
    assert noise.deviation == 0.0
    assert noise.floor == pytest.approx(step / np.sqrt(12.0), rel=1e-6)


def test_noise_before_rounding_is_computed_from_the_rounding():
    step, deviation = 1e-3, 2.5e-3
    said = motion(TIME) + deviation * np.random.default_rng(2).standard_normal(TIME.size)
    noise = noise_in(np.round(said / step) * step)
    assert noise.step == pytest.approx(step, rel=1e-6)
    assert noise.deviation == pytest.approx(deviation, rel=0.06)


def test_a_signal_without_noise_has_none():
    assert noise_in(motion(TIME)).floor < 1e-6


@pytest.mark.parametrize(("deviation", "step"), [(2e-3, 0.0), (0.0, 1e-3), (2e-3, 1e-3)])
def test_noise_made_again_is_like_the_measured(deviation, step):
    """It spreads about the motion it takes for true as the measured does about the one that only this test knows."""
    said = motion(TIME) + deviation * np.random.default_rng(3).standard_normal(TIME.size)
    said = np.round(said / step) * step if step else said
    found = channels(link_position=said)
    again = [found.with_noise(seed) for seed in range(4)]
    inside = slice(found.window, -found.window)
    measured = np.std((said - motion(TIME))[inside])
    for other in again:
        spread = np.std((other.raw["link_position"] - found.roles["link_position"][0])[inside])
        assert spread == pytest.approx(measured, rel=0.08)
    smooth = channels(link_position=motion(TIME)).roles["link_position"]
    for order in range(3):
        own = np.std((found.roles["link_position"] - smooth)[order][inside])
        new = np.mean([np.std((o.roles["link_position"] - found.roles["link_position"])[order][inside]) for o in again])
        assert new == pytest.approx(own, rel=0.15), order


@pytest.mark.parametrize(
    ("period", "step", "size", "frequency"),
    [
        (2e-3, 1.5e-4, 0.66, 0.1),
        (4e-3, 1e-3, 0.5, 0.3),
        (1e-3, 3e-3, 0.6, 0.2),
        (1e-3, 3e-3, 0.6, 1.0),
        (2e-3, 1.5e-4, 0.05, 0.1),
    ],
)
def test_rounding_made_again_is_as_large_as_the_measured_at_any_speed(period, step, size, frequency):
    """At about a whole number of steps a sample rounding errs slowly: a motion that follows the steps would not err at all."""
    time = np.arange(round(30.0 / period)) * period
    moved = size * (np.sin(2.0 * np.pi * frequency * time) + 0.1 * np.sin(6.6 * np.pi * frequency * time))
    found, smooth = (channels_of(signals({"link_position": x}, period)) for x in (np.round(moved / step) * step, moved))
    again = [found.with_noise(seed).roles["link_position"] - found.roles["link_position"] for seed in range(4)]
    own = np.nanstd(found.roles["link_position"] - smooth.roles["link_position"], axis=1)
    np.testing.assert_allclose(np.mean([np.nanstd(a, axis=1) for a in again], axis=0), own, rtol=0.08)


def test_noise_made_again_is_independent_of_the_measured_and_of_itself():
    said = motion(TIME) + 2e-3 * np.random.default_rng(4).standard_normal(TIME.size)
    found = channels(link_position=said)
    inside = slice(found.window, -found.window)
    smooth = found.roles["link_position"][0]
    one, two = ((found.with_noise(seed).raw["link_position"] - smooth)[inside] for seed in (1, 2))
    for other in (two, (said - motion(TIME))[inside]):
        # 4.5 standard deviations of the correlation of white noise.
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.5 / np.sqrt(one.size)
    np.testing.assert_array_equal(found.with_noise(1).raw["link_position"], found.with_noise(1).raw["link_position"])


def test_an_encoder_at_rest_stays_on_its_step():
    """The error of a step does not average out where nothing moves: noise again must not make it do so."""
    said = np.full(4000, 0.3) + np.where(np.arange(4000) > 2000, 0.01, 0.0)
    said = np.round(said / 0.01) * 0.01
    found = channels(motor_position=said, link_position=motion(TIME[:4000]))
    assert np.ptp(found.with_noise(1).raw["motor_position"][:1900]) < 1e-12


def test_thinned_channels_keep_samples_as_they_are():
    found = channels(link_position=motion(TIME))
    thin = found.thinned()
    assert 1 < thin.every < found.window // 4
    assert thin.period == pytest.approx(thin.every * PERIOD)
    np.testing.assert_array_equal(thin.time, found.time[:: thin.every])
    np.testing.assert_array_equal(thin.roles["link_position"], found.roles["link_position"][:, :: thin.every])
    noisy, whole = thin.with_noise(3), found.with_noise(3)
    np.testing.assert_array_equal(noisy.raw["link_position"], whole.raw["link_position"][:: thin.every])


def test_a_run_that_begins_between_kept_samples_begins_at_the_next_one():
    bound = signals({"link_position": motion(TIME[:4000])}, PERIOD)
    bound.starts[2001] = True
    thin = channels_of(bound).thinned()
    (_, begin) = np.flatnonzero(thin.starts)
    assert thin.time[begin] >= TIME[2001] > thin.time[begin - 1]


def test_what_passes_no_filter_is_driven_again_after_it_too():
    """A valve's voltage is simulated as it was recorded: its noise has to move what it drives."""
    found = channels(link_position=motion(TIME), valve_1=np.sign(motion(TIME)))
    other = {role: x + 0.1 for role, x in found.raw.items()}
    driven = found.driven_by(other)
    np.testing.assert_array_equal(driven.roles["valve_1"][0], found.roles["valve_1"][0] + 0.1)
    np.testing.assert_array_equal(driven.roles["link_position"], found.roles["link_position"])
    np.testing.assert_array_equal(driven.raw["link_position"], other["link_position"])


@pytest.mark.parametrize(("power", "second"), [(4, True), (6, False)])
def test_second_derivatives_are_exact_up_to_the_fourth_power(power, second):
    at = (TIME[:61] - TIME[30]) / 0.015 + 0.5
    found = channels(link_position=at**power).roles["link_position"][2, 30] * 0.015**2
    expected = power * (power - 1) * 0.5 ** (power - 2)
    assert bool(abs(found / expected - 1.0) < 1e-6) is second


def test_what_swings_ten_times_a_second_loses_a_thousandth_of_its_second_derivative():
    swing = 2.0 * np.pi * 10.0
    found = channels(link_position=np.sin(swing * TIME[:1000])).roles["link_position"][2]
    lost = 1.0 - np.nanstd(found[100:-100]) / np.std(swing**2 * np.sin(swing * TIME[100:900]))
    assert lost == pytest.approx(1e-3, rel=0.5)


@pytest.mark.parametrize(("period", "every"), [(2e-3, 1), (1e-3, 3), (5e-4, 6)])
def test_equations_are_formed_at_least_ten_times_in_a_window(period, every):
    """Of the 15, 31 and 61 samples of 0.03 s."""
    found = channels_of(signals({"link_position": motion(np.arange(200) * period)}, period))
    assert found.thinned().every == every
