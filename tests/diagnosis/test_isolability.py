"""Which causes a motion isolates: closed forms, and the diagnosis of a simulated log as the oracle."""

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

from vsalog.core.significance import SIGNIFICANCE
from vsalog.diagnosis.isolability import isolations, structure_of, until
from vsalog.diagnosis.joint import diagnose_joint
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.plan import formed, planned, signals_of, subject_of
from vsalog.rig import Rig
from vsalog.simulation.scenario import Scenario

pytestmark = pytest.mark.share(3)

# Nothing but J q̈ = k τ: twice the inertia is half the torque constant, whatever the motion.
BARE = """
[joint.arm]
kind = "rigid"
[joint.arm.motor]
inertia = 0.05
[joint.arm.signals]
motor_position = { channel = "position", resolution = 1e-4 }
motor_torque = { channel = "torque", noise = 2e-3 }
"""
LINK = """
[joint.arm.link]
inertia = 0.03
"""
MOTION = """
duration = 6.0
period = 2e-3
[joint.arm.motor_servo]
stiffness = 20.0
damping = 1.5
reference = [{ type = "sine", amplitude = 0.5, frequency = 0.7 }, { type = "sine", amplitude = 0.2, frequency = 2.3 }]
"""
INERTIA, CONSTANT = "motor.inertia", "motor.torque_constant"


def subject(text, motion=MOTION, **signals):
    rig = Rig.from_toml(text)
    joint = rig.joints["arm"]
    joint = replace(joint, signals=replace(joint.signals, **signals))
    return subject_of(rig, "arm", Scenario.from_toml(motion), joint)


def class_of(found, cause, probability=0.5):
    (one,) = [i for i in found if i.site.cause == cause]
    return {name for name, _ in one.members(probability)}


def rival_of(found, cause, other):
    (one,) = [i for i in found if i.site.cause == cause]
    return one, next((r for r in one.rivals if r.site.cause == other), None)


@pytest.mark.parametrize("motion", [MOTION, MOTION.replace("0.7", "0.3").replace("2.3", "1.1")])
def test_an_inertia_and_a_torque_constant_alone_in_an_equation_are_one_whatever_the_motion(motion):
    bare = subject(BARE + LINK, motion)
    found = isolations(bare.problem, bare.system)
    one, rival = rival_of(found, "link.inertia", CONSTANT)
    assert rival is not None
    assert rival.probability > 0.5
    structure = structure_of(bare.problem, bare.system)
    assert structure.covers(rival, one)
    assert not structure.richer(rival, one)
    assert rival not in structure.open(one)


def test_a_weight_that_is_known_tells_an_inertia_from_a_torque_constant():
    weighted = subject(BARE + LINK + "gravity_torque = 2.0\n")
    found = isolations(weighted.problem, weighted.system)
    assert all(i.visible for i in found if i.site.cause in ("link.inertia", CONSTANT))
    assert CONSTANT not in class_of(found, "link.inertia")
    assert "link.inertia" not in class_of(found, CONSTANT)


def test_a_cause_is_as_large_as_the_tolerance_that_the_rig_states():
    stated = subject(BARE + LINK + 'gravity_torque = "2 N*m ± 5 %"\n')
    (one,) = isolations(stated.problem, stated.system, {("link.gravity", "link")})
    assert one.values == pytest.approx([2.1], rel=1e-3)
    assert one.absent() == {"torque": (2.0, "N*m")}


def test_a_torque_sensor_between_motor_and_link_tells_them_apart():
    """The link's torque is written out: M q̈ + τ_sensor = 0, with q̈ = τ/J of the rig's equation."""
    rig = Rig.from_toml(BARE + LINK)
    joint = rig.joints["arm"]
    there = signals_of(rig, "arm", Scenario.from_toml(MOTION), joint)
    torque = there.roles["motor_torque"]
    sensor = -0.03 / (0.05 + 0.03) * torque + 2e-3 * np.random.default_rng(5).standard_normal(torque.size)
    named = replace(joint, signals=replace(joint.signals, torque_sensor="sensor"))
    sensed = formed("arm", named, dataclasses.replace(there, roles={**there.roles, "torque_sensor": sensor}), {})
    assert set(sensed.system.names) == {"motor", "link"}
    found = isolations(sensed.problem, sensed.system)
    assert CONSTANT not in class_of(found, "link.inertia", SIGNIFICANCE)


def test_probabilities_are_those_of_diagnoses_of_logs_with_other_noise():
    """Of ten simulated logs about as many confuse an inertia with a torque constant as predicted; a weight is next to them."""
    expected, counted = 0.0, 0
    for weight in (0.05, 0.1):
        text = BARE + LINK + f"gravity_torque = {weight}\n"
        rig, scenario = Rig.from_toml(text), Scenario.from_toml(MOTION)
        there = subject(text)
        (one,) = isolations(there.problem, there.system, {("link.inertia", "link")})
        rival = next((r for r in one.rivals if r.site.cause == CONSTANT), None)
        expected += 5.0 * (0.0 if rival is None else rival.probability)
        machine = rig.with_joints({"arm": placed(there.joint, one.fit)})
        for seed in range(1, 6):
            signals = signals_of(machine, "arm", scenario, rig.joints["arm"], seed)
            told = diagnose_joint("arm", rig.joints["arm"], signals, None).found
            classes = [{f.site.cause, *(r.cause for r in f.choice.rivals)} for f in told]
            counted += any({"link.inertia", CONSTANT} <= names for names in classes)
    # Three standard deviations of ten draws at even odds, at most.
    assert abs(counted - expected) <= 3.0 * np.sqrt(10 * 0.25)


def test_what_shows_in_a_motion_does_not_in_one_that_is_far_smaller():
    there, tiny = subject(BARE + LINK), subject(BARE + LINK, MOTION.replace("0.5", "2e-3").replace("0.2", "8e-4"))
    whole, shaken = ({i.site.key: i for i in isolations(s.problem, s.system)} for s in (there, tiny))
    constant = ("motor.torque_constant", "motor")
    assert whole[constant].visible
    assert constant not in shaken or not shaken[constant].visible


def test_a_shorter_motion_has_the_rows_up_to_its_end():
    there = subject(BARE + LINK)
    half = until(there.system, 3.0)
    assert half.count == np.count_nonzero(there.system.weights[there.system.time <= 3.0])
    assert np.all(half.averaged(there.joint)[half.time > 3.0] == 0.0)


def test_a_rigid_joint_that_a_scenario_leaves_at_rest_is_moved():
    rig = Rig.from_toml(BARE + LINK)
    file = planned(Scenario.find("sines", rig.file), rig, ["arm"]).file
    assert file.joint["arm"].motor_servo is not None
