"""Torques that were computed from another signal, and such that were not, on either side of each bound."""

import numpy as np
import pytest

from vsalog.checks.torque_independence import computed_from, multiple_of, stuck

RNG = np.random.default_rng(0)
X = RNG.normal(size=6000)


@pytest.mark.parametrize(("left", "computed"), [(0.7e-5, True), (1.5e-5, False)])
def test_a_multiple_leaves_less_than_a_hundred_thousandth(left, computed):
    torque = 40.0 * (X + left * np.random.default_rng(1).normal(size=X.size))
    assert (multiple_of(torque, X) is not None) == computed


def code_of(torque, x=X):
    found = computed_from(torque, "arm", "torque_sensor", x, "the deflection")
    return None if found is None else found.code


@pytest.mark.parametrize(("samples", "followed"), [(10, True), (16, False)])
def test_a_torque_is_late_by_a_dozen_samples_at_most(samples, followed):
    assert (code_of(40.0 * np.roll(X, samples)) == "torque.filtered_function") == followed


@pytest.mark.parametrize(("power", "followed"), [(5, True), (7, False)])
def test_a_spring_and_its_lever_arm_are_a_fifth_power_at_most(power, followed):
    assert (code_of(np.roll(X[:1500], 3) ** power, X[:1500]) == "torque.filtered_function") == followed


@pytest.mark.parametrize(("part", "found"), [(0.15, False), (0.3, True)])
def test_a_torque_is_stuck_while_the_prediction_moves_by_a_fifth_of_its_range(part, found):
    torque = np.random.default_rng(2).normal(size=2000)
    torque[1000:1200] = torque[1000]
    predicted = np.zeros(2000)
    predicted[100], predicted[1000:1200] = 1.0, np.linspace(0.0, part, 200)
    assert stuck(torque, predicted, 0.0).any() == found
