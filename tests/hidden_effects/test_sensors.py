"""What sensors make of the truth."""

import numpy as np
import pytest

from tests.hidden_effects import motion
from tests.hidden_effects.machines import Flaws, Sensors, random_machine
from tests.hidden_effects.sensors import Quality, flawed, ideal, random_qualities, recorded, spring_torques


@pytest.fixture(scope="module")
def bench():
    rng = np.random.default_rng(0)
    machine = random_machine("elastic", rng)
    truth = motion.happened(machine, motion.wanted(machine, 5.0, 1e-3, rng))
    return machine, truth, random_qualities(machine, truth, rng)


def test_a_sensor_says_what_its_flaws_make_of_a_sine():
    time = np.arange(-2000, 3000) * 1e-3
    flaws = Flaws(gain=1.1, offset=0.2, drift=0.03, delay=0.0042, amplitude=0.05, phase=0.7)
    said = flawed(np.sin(7.0 * time), time, flaws)
    late = np.sin(7.0 * (time - 0.0042))
    expected = 1.1 * late + 0.2 + 0.03 * time + 0.05 * np.sin(late + 0.7)
    np.testing.assert_allclose(said[10:], expected[10:], atol=1e-8)


def test_an_early_sensor_says_what_is_to_come():
    time = np.arange(1000) * 1e-3
    said = flawed(time**2, time, Flaws(delay=-0.010))
    np.testing.assert_allclose(said[:980], (time[:980] + 0.010) ** 2, atol=1e-9)


def test_noise_and_steps_are_those_of_the_qualities(bench):
    machine, truth, qualities = bench
    said = recorded(truth, Sensors(), machine, qualities, np.random.default_rng(1))
    for role, values in said.items():
        error = values - truth.roles[role][truth.inside]
        assert np.std(error) == pytest.approx(qualities[role].deviation, rel=0.06), role
        step = qualities[role].step
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-6)


def test_qualities_are_those_of_real_sensors(bench):
    machine, truth, _ = bench
    for seed in range(20):
        for role, quality in random_qualities(machine, truth, np.random.default_rng(seed)).items():
            if role.endswith("position"):
                bits = np.log2(2.0 * np.pi / quality.step)
                assert 14 <= round(bits) <= 19
                assert bits == pytest.approx(round(bits))
            elif role == "torque_sensor":
                span = np.ptp(truth.roles[role][truth.inside])
                assert 0.001 <= quality.noise / span <= 0.005


def test_a_channel_computed_of_others_has_no_noise_of_its_own(bench):
    machine, truth, qualities = bench
    sensors = Sensors(formula={"torque_sensor": ("deflection", 1.05, 0.0)})
    said = recorded(truth, sensors, machine, qualities, np.random.default_rng(1))
    phi = said["link_position"] - said["motor_position"]
    np.testing.assert_allclose(said["torque_sensor"], 1.05 * spring_torques(machine, "", phi, 0.0), rtol=1e-12)
    sensors = Sensors(formula={"torque_sensor": ("command", 0.9, 0.0)})
    said = recorded(truth, sensors, machine, qualities, np.random.default_rng(1))
    np.testing.assert_allclose(said["torque_sensor"], -0.9 * said["motor_torque"], rtol=1e-12)


def test_without_flaws_the_ideal_sensor_says_the_truth(bench):
    machine, truth, _ = bench
    for role, values in ideal(truth, Sensors(), machine).items():
        np.testing.assert_array_equal(values, truth.roles[role])


def test_deviation_of_noise_and_steps_add_in_squares():
    assert Quality(3.0, 4.0 * np.sqrt(12.0)).deviation == pytest.approx(5.0)
