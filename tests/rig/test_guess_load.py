"""What a guess says of the load of a motor's torque, on logs with known numbers."""

import numpy as np
import pytest
from elastic_drive import DAMPING, INERTIA, elastic_drive, write_log
from finding_codes import codes

from vsalog.readers import read
from vsalog.rig import Rig
from vsalog.rig.guess import guess_roles
from vsalog.rig.guess_answers import with_answers
from vsalog.rig.schema import UnknownTransmission
from vsalog.rig.template import rig_template


def guessed(tmp_path, columns, leave=()):
    recording = read(write_log(tmp_path / "log.csv", columns, leave))
    guess = guess_roles(recording)
    return recording, guess, guess.joints[0]


@pytest.mark.parametrize("stiffness", [30.0, 100.0])
@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_proposed_numbers_are_near_the_truth(tmp_path, stiffness, friction, turned):
    columns = elastic_drive(stiffness, friction)
    columns["motor_torque"] = turned * columns["motor_torque"]
    recording, guess, joint = guessed(tmp_path, columns, ["torque_sensor"])
    assert (joint.roles["motor_torque"].sign, joint.roles["motor_torque"].has_sign) == (turned, True)
    assert joint.load.inertia == pytest.approx(INERTIA, rel=0.05)
    assert joint.load.damping == pytest.approx(DAMPING, rel=0.1)
    assert joint.load.friction == pytest.approx(friction, abs=0.02)
    written = Rig.from_toml(rig_template(recording, guess)).joints["joint"]
    assert written.transmission.stiffness == pytest.approx(stiffness, rel=0.05)
    assert written.motor.inertia == pytest.approx(INERTIA, rel=0.05)


@pytest.mark.parametrize("gear", [-50.0, 50.0, -1.0])
def test_a_motor_torque_before_a_gear_shows_next_to_a_torque_sensor(tmp_path, gear):
    columns = elastic_drive()
    columns["motor_torque"] = columns["motor_torque"] / gear
    torque = guessed(tmp_path, columns)[2].roles["motor_torque"]
    assert (torque.sign, torque.side) == (np.sign(gear), "joint" if abs(gear) == 1.0 else "rotor")
    # The gear may show in the motor's position too.
    columns["motor_position"] = 50.0 * columns["motor_position"]
    recording, guess, joint = guessed(tmp_path, columns)
    assert (joint.roles["motor_torque"].sign, joint.roles["motor_torque"].side) == (torque.sign, torque.side)
    answered = Rig.from_toml(rig_template(recording, guess, {"joint": {"motor.gear_ratio": "50"}})).joints["joint"]
    assert answered.motor.gear_ratio == 50.0
    assert (answered.signals.motor_torque.sign, answered.signals.motor_torque.side) == (torque.sign, torque.side)


def test_answers_give_the_scales_that_a_log_lacks(tmp_path):
    columns = elastic_drive()
    counts = {name: np.round(columns[name] * 16384 / (2.0 * np.pi)) for name in ("motor_position", "link_position")}
    current = {"motor_current [A]": columns.pop("motor_torque") / 0.07}
    recording, guess, joint = guessed(tmp_path, {**columns, **counts, **current}, ["torque_sensor"])
    assert joint.load is None
    answers = {f"signals.{role}.counts_per_turn": "16384" for role in counts} | {
        "signals.motor_position.side": '"joint"',
        "motor.torque_constant": '"70 N*mm/A"',
    }
    written = Rig.from_toml(rig_template(recording, guess, {"joint": answers})).joints["joint"]
    assert written.transmission.stiffness == pytest.approx(100.0, rel=0.05)
    assert written.motor.inertia == pytest.approx(INERTIA, rel=0.05)


@pytest.mark.parametrize("gear", [1.0, 50.5])
@pytest.mark.parametrize("sign", [1, -1])
def test_answers_show_the_sign_of_a_torque_sensor(tmp_path, gear, sign):
    columns = elastic_drive()
    turns = {"motor_position": gear, "link_position": 1.0}
    columns |= {name: np.round(by * columns[name] * 16384 / (2.0 * np.pi)) for name, by in turns.items()}
    columns["torque_sensor"] = sign * columns["torque_sensor"]
    recording, _, joint = guessed(tmp_path, columns)
    assert not joint.roles["torque_sensor"].has_sign
    side = "joint" if gear == 1.0 else "rotor"
    answers = {f"signals.{role}.counts_per_turn": "16384" for role in turns} | {
        "signals.motor_position.side": f'"{side}"'
    }
    known = with_answers(joint, recording, answers | ({} if gear == 1.0 else {"motor.gear_ratio": str(gear)}))
    assert (known.roles["torque_sensor"].sign, known.roles["torque_sensor"].has_sign) == (sign, True)
    assert known.stiffness == pytest.approx(100.0, rel=0.05)
    assert "guess.raw_counts" in codes(joint)
    assert "guess.raw_counts" not in codes(known)
    # One encoder without its counts is no angle, and one on an unknown side of a gear is none of the joint.
    for key in answers:
        partly = with_answers(joint, recording, {k: v for k, v in answers.items() if k != key})
        assert (partly.roles["torque_sensor"].has_sign, partly.stiffness) == (False, None)
    answered = with_answers(joint, recording, answers | {"signals.torque_sensor.sign": "1"})
    assert answered.roles["torque_sensor"].sign == 1


def test_no_load_is_guessed_of_a_torque_that_follows_nothing(tmp_path):
    columns = elastic_drive()
    columns["motor_torque"] = np.random.default_rng(1).standard_normal(columns["time"].size)
    joint = guessed(tmp_path, columns, ["torque_sensor"])[2]
    assert (joint.load, joint.roles["motor_torque"].has_sign) == (None, False)


def hint(text):
    """Return the stiffness that a rig proposes as a comment [N·m/rad]."""
    filled = text.replace('type = "unknown"', 'type = "linear"').replace("# stiffness = ", "stiffness = ")
    return Rig.from_toml(filled).joints["joint"].transmission.stiffness


def test_the_spring_that_an_identification_may_begin_with_is_a_gap_next_to_a_torque_sensor(tmp_path):
    recording, guess, _ = guessed(tmp_path, elastic_drive())
    text = rig_template(recording, guess)
    assert Rig.from_toml(text).joints["joint"].transmission == UnknownTransmission()
    assert hint(text) == pytest.approx(100.0, rel=0.05)


@pytest.mark.parametrize("unit", ["N*m", "N*mm"])
def test_the_spring_is_proposed_by_the_torque_sensor_and_not_by_a_current(tmp_path, unit):
    columns = elastic_drive()
    columns["i_q [A]"] = columns.pop("motor_torque") / 2.5
    columns[f"torque_sensor [{unit}]"] = -columns.pop("torque_sensor") * (1000.0 if unit == "N*mm" else 1.0)
    recording, guess, joint = guessed(tmp_path, columns)
    assert joint.roles["motor_torque"].is_current
    assert joint.stiffness == pytest.approx(100.0, rel=0.05)
    assert hint(rig_template(recording, guess)) == pytest.approx(100.0, rel=0.05)


def test_no_spring_is_proposed_by_a_current_without_a_torque_constant(tmp_path):
    columns = elastic_drive()
    columns["i_q [A]"] = columns.pop("motor_torque") / 2.5
    recording, guess, joint = guessed(tmp_path, columns, ["torque_sensor"])
    assert joint.load is not None
    assert "# stiffness =" not in rig_template(recording, guess, with_beginnings=False)
    stated = rig_template(recording, guess, {"joint": {"motor.torque_constant": "2.5"}}, with_beginnings=False)
    assert hint(stated) == pytest.approx(100.0, rel=0.05)
