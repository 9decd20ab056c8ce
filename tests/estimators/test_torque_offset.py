"""A motor's torque that is off by a constant: an integrated equation says so instead of giving a stiffness."""

import numpy as np
import pytest

from vsalog.estimation.joint import choose, estimate_joint
from vsalog.reproduce.measure import with_noise
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate


@pytest.fixture(scope="module")
def sea():
    rig = Rig.preset("sea").file
    return simulate(rig, Scenario.find("sea-exp1", rig).inputs(rig), 20.0, period=2e-3, ideal=True)


def estimated(experiment, estimator, offset, seed):
    """The torque sensor of the motor says `offset` too much; the rig does not know."""
    (noisy,) = with_noise(experiment, [seed])
    recording = noisy.recording()
    recording.channels["/joint_states.effort[motor]"].values[:] += offset
    spec = noisy.rig.joint["sea"]
    return estimate_joint([recording], "sea", spec, choose("sea", spec, estimator, {}, noisy.rig), rig=noisy.rig)


def offsets(found):
    return [finding.value for finding in found.findings if finding.code == "torque.offset_as_ramp"]


@pytest.mark.parametrize("estimator", ["qr-rls", "batch-ls"])
@pytest.mark.parametrize("offset", [0.01, -0.05])
def test_an_offset_is_reported_and_nothing_is_supported(sea, estimator, offset):
    found = estimated(sea, estimator, offset, 7)
    assert offsets(found) == [pytest.approx(offset, abs=0.002)]
    assert not np.any(found.trace["total"]["excited"])


@pytest.mark.parametrize("seed", range(5))
def test_without_an_offset_nothing_is_reported(sea, seed):
    found = estimated(sea, "qr-rls", 0.0, seed)
    assert offsets(found) == []
    assert np.mean(found.trace["total"]["excited"]) > 0.8


@pytest.mark.parametrize("seconds", [1.0, 1.65, 3.0])
@pytest.mark.parametrize("seed", [2, 3])
def test_a_torque_that_stands_still_is_no_offset(seconds, seed):
    """The first level of a square wave: what was reported was the torque itself, 0.48 N·m."""
    rig = Rig.preset("sea").file
    stepped = simulate(rig, Scenario.find("square", rig).lasting(seconds, None).inputs(rig), seconds, ideal=True)
    assert offsets(estimated(stepped, "qr-rls", 0.0, seed)) == []


def test_a_basis_with_a_constant_takes_it_up(sea):
    (noisy,) = with_noise(sea, [3])
    recording = noisy.recording()
    recording.channels["/joint_states.effort[motor]"].values[:] += 0.05
    rig = Rig(noisy.rig, "rig").with_settings({"joint.sea.basis.odd": "false"}).file
    spec = rig.joint["sea"]
    found = estimate_joint([recording], "sea", spec, choose("sea", spec, "qr-rls", {}, rig), rig=rig)
    assert offsets(found) == []
