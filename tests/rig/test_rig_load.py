import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.rig import Rig, presets
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    ElasticJoint,
    LinearTransmission,
    SerialJoint,
    Signal,
    Vsa2Transmission,
)

ANKLE = """
name = "ankle"
[joint.ankle]
kind = "serial"
[joint.ankle.motor]
side = "rotor"
inertia = "120 g*cm^2"
gear_ratio = 100
[joint.ankle.lever]
start = "100 mm"
travel = "2.5 mm/rev"
[joint.ankle.basis]
deflection_scale = "10 deg"
setpoint_scale = "100 mm"
[joint.ankle.signals]
motor_position = { channel = "m.{run}", unit = "deg", side = "rotor", sign = -1, offset = "3 deg", resolution = "0.1 deg" }
link_position = "q.{run}"
motor_torque = { channel = "i.{run}", unit = "A" }
torque_sensor = 1.5
[[joint.ankle.run]]
name = "a"
setpoint = "1 rev"
[[joint.ankle.run]]
name = "b"
setpoint = "33 mm"
[[joint.ankle.run]]
name = "c"
setpoint = 0.05
"""


def joint_of(rig, name, kind):
    joint = rig.joints[name]
    assert isinstance(joint, kind)
    return joint


def test_every_quantity_becomes_si():
    rig = Rig.from_toml(ANKLE)
    joint = joint_of(rig, "ankle", SerialJoint)
    assert rig.name == "ankle"
    assert joint.motor.inertia == pytest.approx(1.2e-5)
    assert joint.motor.reflected_inertia == pytest.approx(0.12)
    assert joint.lever is not None
    assert joint.lever.travel == pytest.approx(2.5e-3 / (2 * math.pi))
    assert joint.basis.deflection_scale == pytest.approx(math.radians(10))
    assert joint.basis.setpoint_scale == pytest.approx(0.1)
    signal = joint.signals.motor_position
    assert isinstance(signal, Signal)
    assert signal.unit == "deg"
    assert signal.offset == pytest.approx(math.radians(3))
    assert signal.resolution == pytest.approx(math.radians(0.1))
    assert joint.signals.torque_sensor == 1.5


def test_a_runs_set_point_is_the_lever_arm_whichever_way_it_is_written():
    joint = joint_of(Rig.from_toml(ANKLE), "ankle", SerialJoint)
    assert [run.setpoint for run in joint.run] == pytest.approx([0.0975, 0.033, 0.05])


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ('{ constant = "33 mm" }', 0.033, "m"),
        ('{ constant = 33, unit = "mm" }', 0.033, "m"),
        ('{ constant = "90 deg" }', math.pi / 2, "rad"),
        ("{ constant = 2 }", 2.0, None),
    ],
)
def test_constants_carry_what_they_measure(text, value, unit):
    rig = Rig.from_toml(f'[joint.a]\nkind = "serial"\n[joint.a.signals]\nsetpoint = {text}')
    signal = joint_of(rig, "a", SerialJoint).signals.setpoint
    assert isinstance(signal, Signal)
    assert signal.constant == pytest.approx(value)
    assert signal.unit == unit


def test_a_constant_angle_becomes_the_lever_arm():
    lever = '[joint.a.lever]\nstart = "100 mm"\ntravel = "10 mm/rad"\n'
    rig = Rig.from_toml(f'[joint.a]\nkind = "serial"\n{lever}[joint.a.signals]\nsetpoint = {{ constant = "2 rad" }}')
    assert joint_of(rig, "a", SerialJoint).signals.setpoint == Signal(constant=pytest.approx(0.08), unit="m")


@pytest.mark.parametrize("text", [ANKLE, *presets()])
def test_what_is_written_loads_to_an_equal_rig(text):
    rig = Rig.load(text)
    again = Rig.from_toml(rig.to_toml())
    assert again.file == rig.file
    assert again.to_toml() == rig.to_toml()


@given(
    st.floats(1e-9, 1e9),
    st.floats(0.0, 1e9),
    st.floats(1e-3, 1e4),
    st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=20),
    st.text(min_size=1, max_size=20).filter(lambda t: t.strip() and "{run}" not in t),
)
def test_any_values_and_names_survive_a_round_trip(inertia, damping, gear, joint, channel):
    from vsalog.rig.schema import Motor, RigFile, SingleSignals

    file = RigFile(
        joint={
            joint: ElasticJoint(
                motor=Motor(inertia=inertia, damping=damping, gear_ratio=gear),
                signals=SingleSignals(link_position=channel.encode("utf-8", "replace").decode()),
            )
        }
    )
    assert Rig.from_toml(Rig(file).to_toml()).file == file


def test_vsa2_has_the_printed_values():
    joint = joint_of(Rig.preset("vsa2"), "vsa2", AntagonisticJoint)
    assert (joint.motor_1.inertia, joint.motor_1.damping) == (7.3e-3, 1e-3)
    assert joint.motor_1 == joint.motor_2
    assert joint.transmission_1 == joint.transmission_2 == Vsa2Transmission(stiffness=0.5, geometry=1.8)
    assert (joint.basis.order, joint.basis.odd) == (4, True)


def test_awas_has_the_printed_values():
    joint = joint_of(Rig.preset("awas"), "awas", SerialJoint)
    assert (joint.motor.inertia, joint.motor.damping, joint.motor.gear_ratio) == (2.3e-5, 0.001, 50.0)
    assert joint.motor.reflected_inertia == pytest.approx(2.3e-5 * 2500)
    assert joint.secondary_motor is not None
    assert (joint.secondary_motor.inertia, joint.secondary_motor.gear_ratio) == (1.29e-7, 23.0)
    assert joint.transmission == AwasTransmission(spring_stiffness=14220.0)
    assert joint.lever is not None
    assert (joint.lever.start, joint.lever.travel) == pytest.approx((0.1, 2.5e-3 / (2 * math.pi)))
    assert joint.link is not None
    assert (joint.link.inertia, joint.link.damping) == (0.1, 0.15)
    assert (joint.basis.order, joint.basis.setpoint_order) == (6, 3)


def test_the_2r_arm_has_two_vsa2():
    rig, single = Rig.preset("vsa2-2r"), joint_of(Rig.preset("vsa2"), "vsa2", AntagonisticJoint)
    assert list(rig.joints) == ["shoulder", "elbow"]
    for name in rig.joints:
        joint = joint_of(rig, name, AntagonisticJoint)
        assert (joint.motor_1, joint.transmission_1) == (single.motor_1, single.transmission_1)
        assert isinstance(joint.signals.motor_position_1, Signal)
        assert joint.signals.motor_position_1.channel == f"/joint_states.position[{name}_motor_1]"


def test_a_file_goes_over_its_preset_table_by_table():
    rig = Rig.from_toml(
        'preset = "vsa2"\nname = "mine"\n[joint.vsa2.motor_1]\ninertia = "8 kg*m*mm"\n'
        '[joint.vsa2.transmission_2]\ntype = "linear"\nstiffness = 3\n'
        "[joint.vsa2.signals]\nlink_position = { sign = -1 }\nmotor_position_1 = { constant = 0 }\n"
    )
    joint = joint_of(rig, "vsa2", AntagonisticJoint)
    assert rig.name == "mine"
    assert (joint.motor_1.inertia, joint.motor_1.damping) == (8e-3, 1e-3)
    assert joint.transmission_2 == LinearTransmission(stiffness=3.0)
    assert joint.signals.link_position == Signal(
        channel="/joint_states.position[link]", sign=-1, resolution=pytest.approx(2 * math.pi / 4059)
    )
    assert joint.signals.motor_position_1 == Signal(constant=0.0)
    assert Rig.from_toml(rig.to_toml()).file == rig.file


def test_settings():
    rig = Rig.preset("awas")
    changed = rig.with_setting("joint.awas.motor.inertia", "7.3 kg*m*mm")
    assert joint_of(changed, "awas", SerialJoint).motor.inertia == 7.3e-3
    assert changed.where == rig.where
    assert joint_of(rig, "awas", SerialJoint).motor.inertia == 2.3e-5
    linear = rig.with_setting("joint.awas.transmission", "{type = 'linear', stiffness = '5 N*m/deg'}")
    assert joint_of(linear, "awas", SerialJoint).transmission == LinearTransmission(
        stiffness=pytest.approx(5 * 180 / math.pi)
    )
    assert rig.with_setting("name", "my rig").name == "my rig"
    assert rig.with_setting("joint.awas.basis.order", "2").joints["awas"].basis.order == 2
    run = Rig.from_toml(ANKLE).with_setting("joint.ankle.run[1].setpoint", "40 mm")
    assert [r.setpoint for r in joint_of(run, "ankle", SerialJoint).run] == pytest.approx([0.0975, 0.04, 0.05])


def test_loading_tells_text_file_and_preset_apart(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(ANKLE, encoding="utf-8-sig")
    assert Rig.load(path).file == Rig.load(str(path)).file == Rig.load(ANKLE).file
    assert Rig.load(path).where == "mine.toml"
    assert Rig.load("vsa2").where == "preset vsa2"
