"""Every way a rig file can be wrong, and that the message names the key, the reason and the way out."""

import pytest

from vsalog.core.errors import RigError
from vsalog.rig import Rig

ELASTIC = '[joint.elbow]\nkind = "elastic"\n'
SERIAL = '[joint.elbow]\nkind = "serial"\n'
MOTOR = ELASTIC + "[joint.elbow.motor]\n"
SPRING = ELASTIC + "[joint.elbow.transmission]\n"
SIGNALS = ELASTIC + "[joint.elbow.signals]\n"
LEVER = SERIAL + '[joint.elbow.lever]\nstart = "10 mm"\ntravel = "1 mm/rad"\n'
RUN = "[[joint.elbow.run]]\n"

CASES = [
    # unknown keys
    (MOTOR + "inertai = 1", "joint.elbow.motor.inertai: there is no such key, did you mean 'inertia'?"),
    (MOTOR + "mass = 1", "known here: inertia, damping, gear_ratio"),
    ("colour = 1", "colour: there is no such key; known here: name, preset, joint"),
    (ELASTIC + "[joint.elbow.secondary_motor]", 'there is no such key in a joint of kind "elastic"'),
    (ELASTIC + "secondary = 1", "joint.elbow.secondary: there is no such key"),
    (SPRING + 'type = "linear"\nstiffness = 1\ncubic = 2', 'no such key in a transmission of type "linear"'),
    (SIGNALS + 'motor_positon = "a"', "there is no such role in this kind of joint, did you mean 'motor_position'"),
    (SIGNALS + 'setpoint = "a"', "the roles of this joint are motor_position, motor_torque"),
    (SIGNALS + 'deflection = {channel = "a", sing = 1}', "deflection.sing: there is no such key, did you mean 'sign'?"),
    ('[joint.elbow]\nkind = "elastic"\n[joint.elbow.motor]\n"\\u001b[31m" = 3', 'joint.elbow.motor."�[31m"'),
    # missing and wrong kinds
    ("[joint.elbow]\n", "joint.elbow: 'kind' is missing; it is one of \"rigid\", \"elastic\", \"serial\", \"antagonistic\""),
    ('[joint.elbow]\nkind = "series"', "joint.elbow.kind: \"series\" is not one of"),
    ('[joint.elbow]\nkind = 3', "joint.elbow.kind: 3 is not one of"),
    (SPRING + "stiffness = 3", "joint.elbow.transmission: 'type' is missing"),
    (SPRING + 'type = "spring"', '"spring" is not one of "linear", "cubic", "polynomial", "exponential"'),
    (SPRING + 'type = "cubic"', "'stiffness' and 'cubic' are missing in a transmission of type \"cubic\""),
    # impossible values
    (MOTOR + "inertia = -1", "inertia: -1 is not possible: it has to be greater than 0; leave the key out"),
    (MOTOR + 'inertia = "-1 kg*m^2"', "inertia: -1 is not possible"),
    (MOTOR + "damping = -1", "damping: -1 is not possible: it has to be at least 0"),
    (MOTOR + "gear_ratio = 0", "gear_ratio: 0 is not possible: it has to be greater than 0; it is the number of rotor turns"),
    (MOTOR + "inertia = nan", "inertia: nan is not a finite number"),
    (MOTOR + "inertia = inf", "inertia: inf is not a finite number"),
    (MOTOR + 'inertia = "1e999 kg*m^2"', "inertia: inf is not a finite number"),
    (MOTOR + "inertia = 1" + "0" * 400, "is not a finite number"),
    (MOTOR + "inertia = true", "inertia: true is not a number"),
    (MOTOR + "inertia = 1979-05-27", "inertia: a date is not a number"),
    (MOTOR + "inertia = [1]", "inertia: a list is not a number"),
    (MOTOR + 'side = "motor"', 'side: "motor" is not "joint" or "rotor"'),
    (SPRING + 'type = "vsa2"\nstiffness = 1\ngeometry = 0.9', "geometry: 0.9 is not possible: it has to be greater than 1; the"),
    (SIGNALS + 'deflection = {channel = "a", sign = 2}', "sign: 2 is not -1 or 1"),
    (SIGNALS + 'deflection = {channel = "a", sign = 1.0}', "sign: 1 is not -1 or 1"),
    (SIGNALS + 'deflection = {channel = "a", resolution = 0}', "resolution: 0 is not possible"),
    (ELASTIC + "[joint.elbow.basis]\norder = 0", "order: 0 is not possible: it has to be at least 1"),
    (ELASTIC + "[joint.elbow.basis]\norder = 21", "order: 21 is not possible: it has to be at most 20"),
    (ELASTIC + "[joint.elbow.basis]\norder = 2.5", "order: 2.5 is not a whole number"),
    (ELASTIC + "[joint.elbow.basis]\nodd = 1", "odd: 1 is not true or false"),
    ("name = 3", "name: 3 is not a text in quotes"),
    ('[joint.""]\nkind = "elastic"', "joint: '' is not usable as a name"),
    (SIGNALS + 'deflection = {channel = "a", counts_per_turn = 0}', "counts_per_turn: 0 is not possible"),
    (SIGNALS + 'deflection = {channel = "a", counts_per_turn = "4096 ± 1"}', "states a tolerance"),
    (SIGNALS + 'deflection = {channel = "a", counts_per_turn = 1e300}', "too long for a unit"),
    (SIGNALS + 'deflection = {channel = "a", counts_per_turn = 4096, unit = "deg"}', 'remove unit = "deg", or counts_per_turn'),
    (SIGNALS + 'torque_sensor = {channel = "a", counts_per_turn = 4096}', "counts_per_turn: is for an encoder"),
    (SIGNALS + "deflection = {constant = 1, counts_per_turn = 4096}", "does nothing next to a constant"),
    # units
    (SIGNALS + 'torque_sensor = {channel = "a", unit = "counts"}', "torque_sensor.unit: 'counts' have no meaning"),
    (MOTOR + 'inertia = "3 N*m"', "inertia: 'N*m' is a torque, but a moment of inertia (kg*m^2, g*cm^2, …) is wanted"),
    (MOTOR + 'inertia = "3"', "inertia: '3' has no unit"),
    (MOTOR + 'gear_ratio = "50"', 'gear_ratio: "50" is a text, but a plain number without unit is needed'),
    (SPRING + 'type = "linear"\nstiffness = "30 deg"', "stiffness: 'deg' is an angle, but a rotational stiffness"),
    (ELASTIC + '[joint.elbow.basis]\ndeflection_scale = "3 mm"', "deflection_scale: 'mm' is a length, but an angle"),
    (SERIAL + '[joint.elbow.basis]\nsetpoint_scale = "3 N"', "but an angle (rad, deg, …) or a length (m, mm, …) is wanted"),
    (SIGNALS + 'deflection = {channel = "a", unit = "N*m"}', "deflection.unit: 'N*m' is a torque, but an angle"),
    (SIGNALS + 'deflection = {channel = "a", unit = 3}', "unit: 3 is not a unit; write it as text"),
    (SIGNALS + 'motor_torque = {channel = "a", offset = "3 A"}', "offset: 'A' is a current; give the torque it makes"),
    (SIGNALS + 'motor_torque = {constant = "3 A"}', "constant: 'A' is a current; give the torque it makes"),
    (SERIAL + '[joint.elbow.signals]\nsetpoint = {constant = "3 mm", unit = "mm"}', "has its own unit; remove unit"),
    (SERIAL + RUN + 'setpoint = "20 N"', "joint.elbow.run[0].setpoint: 'N' is a force"),
    (SERIAL + RUN + 'setpoint = "1e999 mm"', "run[0].setpoint: inf is not a finite number"),
    (SERIAL + RUN + 'setpoint = "stiff"', "run[0].setpoint: 'stiff' does not begin with a number"),
    # signals
    (SIGNALS + 'motor_position = "a"\nlink_position = "a"', "two roles for one channel: 'a' is the motor_position already"),
    (SIGNALS + 'motor_position = ["a", "b"]', "motor_position: 2 values for one role: one role, one channel"),
    (SIGNALS + 'motor_position = {channel = ["a", "b"]}', "one role, one channel"),
    (SIGNALS + 'motor_position = {channel = "a", constant = 3}', "both a channel and a constant are given"),
    (SIGNALS + 'motor_position = {unit = "deg"}', "neither a channel nor a constant is given"),
    (SIGNALS + "motor_position = {constant = 3, sign = -1}", "motor_position.sign: does nothing next to a constant"),
    (SIGNALS + 'motor_position = ""', "the channel's name is empty"),
    (SIGNALS + "motor_position = true", "motor_position: true is not a number"),
    (SIGNALS + "motor_position = {channel = 3}", "channel: 3 is not a channel's name"),
    (SIGNALS + 'motor_torque = "a.{run}.b"', "{run} is replaced by the name of a run, but no [[joint.elbow.run]] has a name"),
    # runs and what does not go together
    (ELASTIC + RUN + "setpoint = 3", 'run[0].setpoint: only a joint of kind "serial" has a set-point'),
    (ELASTIC + '[joint.elbow.run]\nname = "a"', "joint.elbow.run: a list of tables is needed here: write [[joint.elbow.run]]"),
    (SERIAL + RUN + 'name = "a"\n' + RUN + 'name = "a"', 'run[1]: there is another run with name = "a"'),
    (LEVER + RUN + 'setpoint = "20 rad"', "run[0].setpoint: the lever arm would be -0.01 m"),
    (SPRING + 'type = "awas"\nspring_stiffness = 3', 'the joint needs kind = "serial"'),
    # tables
    ("[joint]\nelbow = 3", "joint.elbow: 3 is given, but a table is needed: [joint.elbow]"),
    (ELASTIC + "motor = 3", "joint.elbow.motor: 3 is given, but a table is needed"),
    # presets
    ('preset = "vsa3"', "there is no preset 'vsa3', did you mean 'vsa2'"),
    ("preset = 3", "preset: give the name of a preset"),
    ('preset = "vsa2"\n[joint.elbow.motor_1]\ninertia = 3', "joint.elbow: 'kind' is missing"),
    ('preset = "vsa2"\n[joint.elbow.motor_1]\ninertia = 3', '(preset "vsa2" has joint vsa2)'),
    # TOML
    ("[joint.elbow", "is not valid TOML: Expected ']' at the end of a table declaration (at the end, line 1)"),
    (ELASTIC + "x = ", "(at the end, line 3)"),
    (ELASTIC + "x y = 3\n", "(at line 3, column 3)"),
    ("x = " + "9" * 5000, "is not valid TOML"),
    ("x = " + "[" * 5000, "nested too deeply"),
    ("#" + "x" * 2**20, "it is longer than 1024 KiB"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), CASES, ids=range(len(CASES)))
def test_messages(text, message):
    with pytest.raises(RigError) as caught:
        Rig.from_toml(text, "my.toml")
    assert str(caught.value).startswith("my.toml: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("joint.vsa2.motor_1.inertai", "7", "did you mean 'inertia'?"),
        ("joint.vsa2.motor_1.inertia", "-1", "--set: joint.vsa2.motor_1.inertia: -1 is not possible"),
        ("joint.vsa2.transmission_1.type", "linear", "'stiffness' is missing"),
        ("a b", "1", "'a b' is not the path of a key"),
        ("a\nb", "1", "is not the path of a key"),
        ("", "1", "is not the path of a key"),
        ("joint.vsa2.run[0].setpoint", "3", "joint.vsa2.run are counted from 0 and there are 0"),
    ],
)
def test_settings_that_cannot_be(key, value, message):
    with pytest.raises(RigError) as caught:
        Rig.preset("vsa2").with_setting(key, value)
    assert message in str(caught.value)


def test_sources_that_cannot_be(tmp_path):
    with pytest.raises(RigError, match="there is no rig file 'vsa', did you mean 'vsa2'"):
        Rig.load("vsa")
    with pytest.raises(RigError, match="there is no rig file"):
        Rig.load(tmp_path)
    binary = tmp_path / "log.mcap"
    binary.write_bytes(b"\x89MCAP0\r\n\xff\xfe")
    with pytest.raises(RigError, match=r"log.mcap: is not UTF-8 text \(byte 0\)"):
        Rig.load(binary)
    large = tmp_path / "large.toml"
    large.write_bytes(b"#" * (2**20 + 1))
    with pytest.raises(RigError, match="more than 1024 KiB"):
        Rig.load(large)
