"""A recording's own inputs drive the simulation back to what was recorded, and show where the rig is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from vsalog.binding.joint import bind
from vsalog.core.errors import SimulationError
from vsalog.rig import Rig
from vsalog.rig.schema import Friction
from vsalog.simulation import awas_experiment, elastic_experiment, simulate, sine, sum_of, vsa2_experiment
from vsalog.simulation.replay import replay

SEA = {"motor_position", "link_position", "motor_torque", "torque_sensor"}


def signals_of(experiment, roles, name=None):
    name = name or experiment.joint
    return {name: bind([experiment.recording()], name, experiment.rig.joint[name], roles)}


def joints_of(experiment):
    return {experiment.joint: experiment.rig.joint[experiment.joint]}


def worst(ours, theirs):
    return np.nanmax(np.abs(ours - theirs)) / np.ptp(theirs)


def test_an_ideal_recording_comes_back():
    played = elastic_experiment(ideal=True, duration=10.0)
    again = replay(joints_of(played), signals_of(played, SEA))
    # Straight lines between samples at 500 Hz stand for the sines; the first state comes from smoothing.
    for name in ("link_position", "motor_position", "transmission_torque"):
        assert worst(again.simulated["sea"][name], played.truth[name]) < 1e-3, name
    assert again.driven == {"sea": {"motor_torque": "torque"}}
    assert np.flatnonzero(again.restarted).tolist() == [0]


def test_held_torques_come_back_exactly_but_for_the_first_state():
    rng = np.random.default_rng(1)
    held = 2.0 * np.sin(np.arange(5001) * 2e-3) + 0.3 * rng.standard_normal(5001)
    held[:30] = 0.0  # at rest, where smoothing is exact
    rig = Rig.preset("sea").file
    played = simulate(rig, {"sea": {"motor_torque": held}}, 10.0, period=2e-3, ideal=True)
    again = replay(joints_of(played), signals_of(played, SEA), held=True)
    assert worst(again.simulated["sea"]["link_position"], played.truth["link_position"]) < 1e-9


def test_windows_restart_from_the_measured_state():
    played = elastic_experiment(ideal=True, duration=4.0)
    again = replay(joints_of(played), signals_of(played, SEA), window=0.5)
    starts = np.flatnonzero(again.restarted)
    assert np.diff(starts) == pytest.approx(250)
    q, measured = again.simulated["sea"]["link_position"], played.measured["link_position"]
    assert q[starts] == pytest.approx(measured[starts], abs=2e-5)


def test_a_set_point_without_its_motor_s_torque_is_prescribed():
    played = awas_experiment(ideal=True, duration=6.0)
    roles = {"motor_position", "link_position", "motor_torque", "setpoint"}
    again = replay(joints_of(played), signals_of(played, roles))
    assert again.driven == {"awas": {"motor_torque": "torque", "secondary_torque": "motion"}}
    assert worst(again.simulated["awas"]["lever_arm"], played.truth["lever_arm"]) < 2e-3
    # Nothing brings this joint back: what the first state has wrong stays.
    assert worst(again.simulated["awas"]["motor_position"], played.truth["motor_position"]) < 2e-3


def test_without_a_motor_torque_the_motor_moves_as_recorded():
    played = elastic_experiment(ideal=True, duration=4.0)
    again = replay(joints_of(played), signals_of(played, {"motor_position", "link_position"}))
    assert again.driven == {"sea": {"motor_torque": "motion"}}
    assert worst(again.simulated["sea"]["link_position"], played.truth["link_position"]) < 1e-3


def test_two_motors_and_noisy_encoders():
    played = vsa2_experiment(duration=10.0)
    roles = {"motor_position_1", "motor_position_2", "link_position", "motor_torque_1", "motor_torque_2"}
    again = replay(joints_of(played), signals_of(played, roles))
    assert worst(again.simulated["vsa2"]["link_position"], played.truth["link_position"]) < 0.05


def test_a_gap_begins_again_and_what_is_too_short_is_left_out():
    played = elastic_experiment(ideal=True, duration=4.0)
    recording = played.recording()
    keep = np.ones(2001, dtype=bool)
    keep[600:900], keep[905:1200] = False, False
    channels = {
        name: replace(c, stamps=c.stamps[keep], values=c.values[keep]) for name, c in recording.channels.items()
    }
    signals = bind([replace(recording, channels=channels)], "sea", played.rig.joint["sea"], SEA)
    again = replay(joints_of(played), {"sea": signals})
    q = again.simulated["sea"]["link_position"]
    assert np.isnan(q).sum() == 5
    assert again.restarted.sum() == 2
    assert np.nanmax(np.abs(q - signals.roles["link_position"])) < 1e-3 * np.ptp(signals.roles["link_position"])


def test_a_rig_that_lacks_friction_shows():
    rig = Rig.preset("sea").file
    joint = rig.joint["sea"]
    rubbing = changed(rig, joint={"sea": changed(joint, motor=changed(joint.motor, friction=Friction(coulomb=0.4)))})
    torques = {"sea": {"motor_torque": sum_of(sine(2.0, 0.2), sine(1.0, 1.3))}}
    played = simulate(rubbing, torques, 10.0, period=2e-3, ideal=True)
    errors = {}
    for label, believed in (("without", joint), ("with", rubbing.joint["sea"])):
        again = replay({"sea": believed}, signals_of(played, SEA), window=0.5)
        errors[label] = worst(again.simulated["sea"]["motor_position"], played.truth["motor_position"])
    assert errors["with"] < 1e-3
    assert errors["without"] > 20 * errors["with"]


def test_what_cannot_be_replayed_is_reported():
    played = elastic_experiment(ideal=True, duration=1.0)
    with pytest.raises(SimulationError, match="link_position is not recorded"):
        replay(joints_of(played), signals_of(played, {"motor_position", "motor_torque"}))
    with pytest.raises(SimulationError, match="shorter than two samples"):
        replay(joints_of(played), signals_of(played, SEA), window=1e-3)
    short = signals_of(played, SEA)["sea"][:10]
    with pytest.raises(SimulationError, match="nothing to replay"):
        replay(joints_of(played), {"sea": short})
