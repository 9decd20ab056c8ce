"""The side of a joint that something unknown is wrong on: each in turn, with and without a torque sensor."""

from types import SimpleNamespace

import numpy as np
import pytest
from written_out import ROLES, Truth, channels, joint_of, log, signals

from vsalog.diagnosis.sides import side_of
from vsalog.residuals.channels import channels_of
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system

# A spring that yields at 4 s, detents of motor and link at one angle, drag of the air at the link.
WRONG = {
    "spring": (Truth(extra=lambda t, a, phi: 0.12 * (1 + np.tanh((t - 4.0) / 0.02))), "transmission"),
    "spring's corner": (Truth(extra=lambda t, a, phi: 20.0 * np.abs(phi) ** 1.5), "transmission"),
    "motor": (Truth(at_motor=lambda a, da: 0.3 * np.exp(-(((a - 0.3) / 0.1) ** 2))), "motor"),
    "link": (Truth(at_link=lambda q, dq: 0.3 * np.exp(-(((q - 0.3) / 0.1) ** 2))), "link"),
    "air": (Truth(at_link=lambda q, dq: -0.02 * dq * np.abs(dq)), "link"),
}


def side(found, springs=("",)):
    joint, thin = joint_of(), found.thinned()
    system = build_system(joint, thin, balance_for(joint))
    told, equation = side_of(system, joint, system.whitened(joint), springs)
    return told, system.names[equation]


@pytest.mark.parametrize("what", WRONG)
def test_with_all_roles_the_side_is_reported(what):
    truth, expected = WRONG[what]
    assert side(channels(truth, duration=8.0, seed=3)) == (expected, expected)


@pytest.mark.parametrize("what", WRONG)
def test_without_a_torque_sensor_too(what):
    """What a spring does to motor and link at once no single torque there could do."""
    truth, expected = WRONG[what]
    roles = [r for r in ROLES if r != "torque_sensor"]
    assert side(channels(truth, duration=8.0, seed=3, roles=roles))[0] == expected


def test_a_torque_sensor_that_saturates_is_the_sensors_side():
    time, said = log(duration=8.0, seed=3)
    said["torque_sensor"] = np.clip(said["torque_sensor"], -0.5, 0.5)
    assert side(channels_of(signals(said, time[1]))) == ("sensor", "transmission")


def test_where_nothing_but_the_torque_sensor_tells_the_transmission_is_meant():
    """Without motor torque and inertia only one equation is left: it cannot tell the spring from its sensor."""
    roles = [r for r in ROLES if r != "motor_torque"]
    found = channels(WRONG["spring"][0], duration=8.0, seed=3, roles=roles).thinned()
    joint = joint_of()
    joint = type(joint)(motor=joint.motor, transmission=joint.transmission, signals=joint.signals)
    system = build_system(joint, found, balance_for(joint))
    assert system.names == ("transmission",)
    assert side_of(system, joint, system.whitened(joint), ("",))[0] == "transmission"


@pytest.mark.parametrize(("squares", "told"), [(1.0, "transmission"), (2.0, "sensor")])
def test_a_torque_sensor_is_blamed_only_where_that_leaves_less_than_half(squares, told):
    """An error of the sensor's equation: a torque of the transmission, which acts on all three alike, explains a third of it.

    With noise of one next to it, blaming the sensor leaves 1 of 1.67, or of 2.33.
    """
    names = ("motor", "transmission", "link")
    system = SimpleNamespace(names=names, sides=names, weights=np.ones((4, 3)), count=1.0, white=lambda push: push)
    left = np.zeros((4, 3))
    left[:, 1] = np.sqrt(squares / 4.0)
    assert side_of(system, joint_of(), left, ("",)) == (told, 1)
