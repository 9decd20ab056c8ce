"""What a remainder depends on, and its curve: found where it is, not found in noise."""

import numpy as np
import pytest
from scipy.stats import binned_statistic

from vsalog.core.dependence import INTERVALS
from vsalog.diagnosis.remainder import curve_of, depends_on, loop_over, predicted_share

R = 1200
TIME = np.arange(R) * 0.025


def variables(seed=0):
    """Motions that are not each other's functions."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 6, 3)
    return {
        "time": (TIME, "s"),
        "motor_velocity": (np.sin(2 * np.pi * 0.37 * TIME + phases[0]), "rad/s"),
        "deflection": (0.1 * np.sin(2 * np.pi * 0.91 * TIME + phases[1]), "rad"),
        "link_position": (np.sin(2 * np.pi * 0.23 * TIME + phases[2]), "rad"),
    }


SHAPES = {
    "motor_velocity": lambda v: np.sign(v) * (1 + 2 * np.exp(-((v / 0.2) ** 2))),
    "deflection": lambda p: np.exp(-(((p - 0.05) / 0.01) ** 2)) * 4,
    "link_position": lambda q: np.cos(9 * q),
}


@pytest.mark.parametrize("name", SHAPES)
def test_the_variable_is_found_whatever_the_shape(name):
    known = variables()
    rows = SHAPES[name](known[name][0]) + 0.3 * np.random.default_rng(1).standard_normal(R)
    found = depends_on(rows, known)
    assert found[0].name == name
    signal = SHAPES[name](known[name][0])
    # What can be predicted at most is the signal's part of the square.
    assert 0.7 < found[0].share / (np.mean(signal**2) / np.mean(rows**2)) < 1.02


def test_a_drift_depends_on_time():
    rows = 2 * TIME / TIME[-1] + 0.3 * np.random.default_rng(2).standard_normal(R)
    assert depends_on(rows, variables())[0].name == "time"


def cycles(count):
    """Deflection and rate of so many triangles, which end in a rest, and of what loads and unloads along different ways."""
    phase = np.clip(TIME / TIME[-1] * (count + 0.1), 0.0, count)
    x = 0.2 * np.abs(2.0 * (phase % 1.0) - 1.0) - 0.1
    known = {"time": (TIME, "s"), "deflection": (x, "rad"), "deflection_rate": (np.gradient(x, TIME), "rad/s")}
    loop = np.where(known["deflection_rate"][0] < 0.0, 1.0, -1.0) * (1.0 - (x / 0.1) ** 2) + np.sin(60.0 * x)
    return known, loop


def test_what_is_loaded_and_unloaded_once_along_different_ways_is_a_loop():
    known, loop = cycles(1)
    rows = 3.0 * loop + 0.3 * np.random.default_rng(6).standard_normal(R)
    told = depends_on(rows, known)
    assert told[0].name == "time"
    assert loop_over(rows, known, told) == "deflection"


def test_a_drift_over_several_cycles_is_no_loop():
    known, _ = cycles(6)
    rows = 3.0 * np.sin(5.0 * TIME / TIME[-1]) + 0.3 * np.random.default_rng(7).standard_normal(R)
    told = depends_on(rows, known)
    assert told[0].name == "time"
    assert loop_over(rows, known, told) is None


def test_noise_depends_on_nothing():
    """Over fifty draws: a curve learnt from noise predicts less than nothing of other noise."""
    shares = []
    for seed in range(50):
        rows = np.random.default_rng(seed).standard_normal(R)
        assert depends_on(rows, variables(seed)) == []
        shares += [predicted_share(rows, x) for x, _ in variables(seed).values()]
    assert np.mean(shares) < 0.0


def test_rows_that_do_not_count_are_left_out():
    known = variables()
    rows = SHAPES["motor_velocity"](known["motor_velocity"][0])
    gone = np.random.default_rng(3).random(R) < 0.3
    holed = np.where(gone, np.nan, rows)
    whole = predicted_share(rows, known["motor_velocity"][0])
    assert predicted_share(holed, known["motor_velocity"][0]) == pytest.approx(whole, abs=0.1)
    assert predicted_share(np.full(R, np.nan), known["motor_velocity"][0]) == 0.0
    assert predicted_share(rows, np.full(R, 2.0)) == 0.0


def test_a_curve_is_the_means_over_intervals_of_equal_count():
    x = np.random.default_rng(4).uniform(-1, 1, R)
    rows = x**3 + 0.1 * np.random.default_rng(5).standard_normal(R)
    curve = np.array(curve_of(rows, x))
    edges = np.r_[curve[:, 0], curve[-1, 1]]
    np.testing.assert_allclose(np.diff(np.searchsorted(np.sort(x), edges[1:-1])), R / INTERVALS, atol=1)
    np.testing.assert_allclose(curve[:, 2], binned_statistic(x, rows, "mean", edges).statistic, atol=1e-12)
    deviation = binned_statistic(x, rows, "std", edges).statistic
    np.testing.assert_allclose(curve[:, 3], deviation / np.sqrt(R / INTERVALS / 2), rtol=0.02)
