"""Cogging: the plant, the balance and the estimators have one torque, which counts turns of the rotor."""

import numpy as np
import pytest

from vsalog.core.signals import JointSignals
from vsalog.effects.cogging import Cogging
from vsalog.estimators.friction_compensation import FrictionCompensation
from vsalog.residuals.balance import less_torques
from vsalog.rig.schema import ElasticJoint, LinearTransmission, Link, Motor
from vsalog.simulation import _dynamics as d
from vsalog.simulation.machine import build

RATIO, THETA = 20.0, np.linspace(-1.0, 1.0, 50)
WAVES = (Cogging(torque=0.01, order=3.0, phase=0.4), Cogging(torque=0.002, order=12.0))
MOTOR = Motor(side="rotor", gear_ratio=RATIO, inertia=1e-4, cogging=WAVES)
# The rotor's amplitudes times the ratio, its orders counted per turn of the joint.
EXPECTED = 0.2 * np.sin(60.0 * THETA + 0.4) + 0.04 * np.sin(240.0 * THETA)


def test_the_plant_feels_it():
    joint = ElasticJoint(motor=MOTOR, transmission=LinearTransmission(stiffness=10.0), link=Link(inertia=0.05))
    machine = build({"arm": joint})
    work, out = machine.work()[0], np.zeros(machine.state_size)
    for theta, torque in zip(THETA, EXPECTED, strict=True):
        state = np.array([theta, theta, 0.0, 0.0])  # the spring is relaxed
        d.derivative(machine.numbers, machine.at, 0.0, state, np.zeros(2), np.array([2, 2, 1, 1]), work, out)
        assert out[3] * 1e-4 * RATIO**2 == pytest.approx(torque, abs=1e-12)


def test_the_balance_has_it_on_the_side_of_what_resists():
    moved = np.stack([THETA] * 3)
    found = less_torques(MOTOR.reflected.torques, RATIO, moved, np.zeros(THETA.size), 0.5)
    np.testing.assert_allclose(found, 0.5 - EXPECTED, atol=1e-12)
    assert less_torques((), RATIO, moved, np.zeros(THETA.size), 0.5) == 0.5


class View:
    """What `FrictionCompensation` asks of a transmission and its motor."""

    name, motor, motor_torque, motor_position = "arm", MOTOR, "motor_torque", "motor_position"


def test_estimators_add_it_to_the_motors_torque():
    stamps = np.arange(50) * 1_000_000
    roles = {"motor_torque": np.full(50, 0.3), "motor_position": THETA}
    starts = np.arange(50) == 0
    signals = JointSignals("arm", 1e-3, stamps, 1e-9 * stamps, roles, starts, np.zeros(50, dtype=np.int32))
    net = FrictionCompensation((View(),), signals, "kinematic", 1.0)
    _, (block,) = net.step(net.start(), signals)
    np.testing.assert_allclose(block.roles["motor_torque"], 0.3 + EXPECTED, atol=1e-12)


def test_its_steepness_is_its_largest_slope():
    (wave, _) = MOTOR.reflected.torques
    theta = np.linspace(0.0, 2.0 * np.pi / 60.0, 2001)
    slope = np.gradient(0.2 * np.sin(60.0 * theta + 0.4), theta)
    assert wave.slopes(RATIO) == (pytest.approx(np.max(slope), rel=1e-4), 0.0)
