"""What no equation shows and a simulation does: a noisy torque sensor, no link encoder, and a small effect."""

from dataclasses import replace

import numpy as np
import pytest
from written_out import ELASTIC, Truth, joint_of, log, signals

from vsalog.diagnosis.describe import causes_of
from vsalog.diagnosis.joint import diagnose_joint

WITHOUT_LINK = ELASTIC.replace('link_position = "link position"\n', "")
ROLES = ("motor_position", "motor_torque", "torque_sensor")
LOUD = 0.15


def felt(truth, seed):
    """A log with a fine motor encoder, told torques, and a torque sensor whose noise hides the deflection."""
    time, said = log(truth, duration=8.0, seed=seed, roles=ROLES, loud=0.02)
    noise = LOUD * np.random.default_rng(seed + 50).standard_normal(time.size)
    return signals(said | {"torque_sensor": said["torque_sensor"] + noise}, time[1] - time[0])


def looked_at(truth, seed=3):
    return diagnose_joint("arm", joint_of(WITHOUT_LINK), felt(truth, seed), felt(truth, seed + 1))


def test_what_only_adds_up_is_found_with_its_size():
    """The link's friction is 7.5 % larger: a fiftieth of the torque sensor's noise in every equation."""
    found = looked_at(Truth(link_damping=0.0215))
    (cause,) = found.found
    assert cause.site.cause == "link.viscous_friction"
    value, std, _ = cause.numbers()["damping"]
    assert value == pytest.approx(0.0215, abs=3.0 * std)
    assert std < 1e-4
    assert found.consistent
    assert found.gain.rmse(found.gain.after, "motor_position") < 0.05 * found.gain.rmse(
        found.gain.before, "motor_position"
    )


def test_torques_that_are_not_held_are_no_cause():
    """Nothing is hidden; the equations are too noisy to tell that the torques are smooth, and the simulation tells it."""
    found = looked_at(Truth())
    assert not found.found
    assert found.consistent
    assert not found.warnings
    assert found.standing.rmse("motor_position") < 2.0 * found.standing.floor["motor_position"]


def test_a_torque_that_may_have_been_computed_is_said_where_nothing_tells():
    """A gain of the torque sensor without a link encoder: a formula with a wrong spring would look the same."""
    time, said = log(Truth(gain=1.1), duration=8.0, roles=ROLES)
    found = diagnose_joint("arm", joint_of(WITHOUT_LINK), signals(said, time[1] - time[0]), None)
    (cause,) = causes_of(found)
    assert cause.cause == "sensor.torque_gain"
    assert cause.indistinguishable_from == ("sensor.torque_not_independent",)
    assert "switched off" in cause.tell_apart


def test_a_gross_error_of_the_simulation_outweighs_equations_that_close():
    """Where all is recorded a simulation that is somewhat off is doubted, and one that is far off is wrong."""
    time, said = log(Truth(), duration=8.0)
    found = diagnose_joint("arm", joint_of(ELASTIC), signals(said, time[1] - time[0]), None)
    assert found.consistent

    def off_by(times):
        floor = {role: found.standing.rmse(role) / times for role in found.standing.floor}
        return replace(found, standing=replace(found.standing, floor=floor))

    assert off_by(10.0).consistent
    assert off_by(30.0).adds_up
    assert not off_by(30.0).consistent


def test_a_drive_s_delay_is_told_but_for_half_a_sample():
    """Few logs tell whether torques were held from sample to sample."""
    time, said = log(Truth(), duration=8.0, seed=3)
    period = time[1] - time[0]
    late = said | {"motor_torque": np.interp(time + 0.006, time, said["motor_torque"])}
    found = diagnose_joint("arm", joint_of(ELASTIC), signals(late, period), None)
    (cause,) = found.found
    assert cause.site.cause == "motor.torque_delay"
    value, std, _ = cause.numbers()["delay"]
    assert std >= period / 12.0**0.5
    assert abs(value - 0.006) < 1.96 * std
