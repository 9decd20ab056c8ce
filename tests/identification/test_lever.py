"""A set-point that is recorded as an angle: the lever that makes it a length is fitted with it."""

import numpy as np
import pytest

from vsalog.identification.lever import bound_by, lever_of
from vsalog.residuals.channels import Channels, Noise
from vsalog.residuals.windows import Windows
from vsalog.rig import Rig
from vsalog.rig.numbers import with_number

TIME = np.arange(50) * 0.01
ANGLE = np.sin(TIME)


@pytest.fixture
def joint():
    return Rig.preset("awas").joints["awas"]


def windows_of_arm(arm, step):
    there = np.stack([arm, np.gradient(arm, TIME), np.zeros_like(arm)])
    channels = Channels(
        0.01,
        TIME,
        {"setpoint": there},
        {"setpoint": arm},
        TIME == 0.0,
        {"setpoint": Noise(0.0, step)},
        7,
        {"setpoint": step},
    )
    return Windows(channels, np.array([[0, 50]]), ("setpoint",), False, {"setpoint": step})


def test_the_angle_stays_what_was_recorded(joint):
    lever = joint.lever
    other = with_number(
        with_number(joint, ("lever", "start"), 1.2 * lever.start), ("lever", "travel"), 0.7 * lever.travel
    )
    found = bound_by(lever, windows_of_arm(lever.start - lever.travel * ANGLE, 1e-6), other)
    there = found.channels
    np.testing.assert_allclose((other.lever.start - there.raw["setpoint"]) / other.lever.travel, ANGLE, atol=1e-12)
    np.testing.assert_allclose(there.roles["setpoint"][0], there.raw["setpoint"], atol=1e-15)
    rate = -other.lever.travel * np.gradient(ANGLE, TIME)
    np.testing.assert_allclose(there.roles["setpoint"][1], rate, atol=1e-12)
    # An encoder's step is one of the angle: no lever is better known because it is short.
    assert there.noise["setpoint"].step == pytest.approx(0.7e-6)
    assert found.scale["setpoint"] == pytest.approx(0.7e-6)


def test_a_length_stays_a_length(joint):
    windows = windows_of_arm(np.full(50, 0.1), 1e-6)
    assert bound_by(None, windows, with_number(joint, ("lever", "start"), 0.12)) is windows


@pytest.mark.parametrize(("unit", "bound"), [("rad", True), ("m", False)])
def test_the_unit_tells_whether_a_lever_bound_it(joint, unit, bound, tmp_path):
    from vsalog.readers import read

    text = (
        Rig.preset("awas")
        .to_toml()
        .replace("/joint_states.position[secondary_motor]", "arm")
        .replace('unit = "rad"', f'unit = "{unit}"')
    )
    there = Rig.from_toml(text, "here").joints["awas"]
    np.savetxt(
        tmp_path / "log.csv",
        np.stack([TIME, 0.1 + 0.01 * ANGLE], axis=1),
        delimiter=",",
        header="time [s],arm",
        comments="",
    )
    recording = read(tmp_path / "log.csv", {"arm"}, "auto", None, None, None)
    assert (lever_of(recording, there, {"setpoint"}) is not None) is bound
    assert lever_of(recording, there, set()) is None
