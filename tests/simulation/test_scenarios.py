"""Scenario files: what they mean, what is refused and how, and what the generic ones are sized by."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from vsalog.core.errors import SimulationError
from vsalog.mechanics import flexibility_torque
from vsalog.rig import Rig, presets
from vsalog.simulation import simulate
from vsalog.simulation.inputs import Motion, Servo
from vsalog.simulation.scenario import Scenario, built_in, driven_roles, usual_scenario
from vsalog.simulation.scenario_generic import GENERIC, generic
from vsalog.simulation.scenario_schema import Drives, Part

T = (np.arange(20_000) + 0.5) * 1e-3
DOCS = Path(__file__).parents[2] / "docs" / "reference"
TEXT = "\n".join((DOCS / f"scenario{page}.md").read_text(encoding="utf-8") for page in ("s", "_library"))
EXAMPLES = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)

ELASTIC = """
[joint.elbow]
kind = "elastic"
[joint.elbow.motor]
inertia = 0.01
[joint.elbow.transmission]
type = "linear"
stiffness = 5
[joint.elbow.link]
inertia = 0.02
"""
RIG = Rig.from_toml(ELASTIC).file
TORQUE = "[[joint.elbow.motor_torque]]\n"


def signal(text, folder=Path(), role="motor_torque"):
    return Scenario.from_toml(text, "s.toml", folder).inputs(RIG)["elbow"][role]


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        ('type = "constant"\nvalue = "30 N·mm"', np.full_like(T, 0.03)),
        (
            'type = "sine"\namplitude = "2 N·m"\nfrequency = "500 mHz"\nphase = "90 deg"\noffset = 1',
            1.0 + 2.0 * np.cos(math.pi * T),
        ),
        ('type = "square"\namplitude = 2\nfrequency = 0.5', 2.0 * np.sign(np.sin(math.pi * T))),
        (
            'type = "soft_square"\namplitude = 2\nfrequency = 0.5\nsoftness = 0.3',
            2.0 * np.tanh(np.sin(math.pi * T) / 0.3),
        ),
        ('type = "sawtooth"\namplitude = 2\nfrequency = 0.05', np.where(T < 10.0, T * 0.2, T * 0.2 - 4.0)),
        ('type = "steps"\ntimes = [1, "2 s"]\nvalues = ["500 N·mm", -1]', np.where(T < 1, 0, np.where(T < 2, 0.5, -1))),
        (
            'type = "chirp"\nsweep = "linear"\namplitude = 2\nstart_frequency = 0.1\nend_frequency = 1.1',
            2.0 * np.sin(2.0 * math.pi * (0.1 * T + T**2 / 40.0)),
        ),
        (
            'type = "chirp"\namplitude = 2\nstart_frequency = 1\nend_frequency = 2\nduration = "20 s"',
            2.0 * np.sin(2.0 * math.pi * 20.0 * (2.0 ** (T / 20.0) - 1.0) / math.log(2.0)),
        ),
        (
            'type = "multisine"\nrms = 2\nspacing = 0.5\nhighest_frequency = 0.5',
            2.0 * math.sqrt(2.0) * np.cos(math.pi * T),
        ),
        ('type = "trapezoid"\namplitude = 2\nrise = 5\nhold = 10', np.interp(T, [0, 5, 15, 20], [0, 2, 2, 0])),
    ],
)
def test_each_part_means_what_it_says(part, expected):
    assert_allclose(signal(TORQUE + part)(T), expected, atol=1e-9)


def test_parts_of_a_role_are_summed_and_one_may_be_a_table():
    two = TORQUE + 'type = "constant"\nvalue = 2\n' + TORQUE + 'type = "constant"\nvalue = 3'
    assert_array_equal(signal(two)(T), 5.0)
    assert_array_equal(signal('[joint.elbow.motor_torque]\ntype = "constant"\nvalue = 2')(T), 2.0)


def test_a_servo_and_a_prescribed_position_stand_for_the_motors_torque():
    reference = '[[joint.elbow.motor_servo.reference]]\ntype = "constant"\nvalue = "90 deg"'
    servo = signal(
        '[joint.elbow.motor_servo]\nstiffness = "2 N·m/rad"\ndamping = 0.1\nlimit = "300 N·mm"\n' + reference
    )
    assert isinstance(servo, Servo)
    assert (servo.stiffness, servo.damping, servo.limit) == (2.0, 0.1, 0.3)
    assert_allclose(servo.reference(T), math.pi / 2.0)
    free = signal("[joint.elbow.motor_servo]\nstiffness = 2")
    assert free.limit == math.inf
    assert_array_equal(free.reference(T), 0.0)
    motion = signal('[[joint.elbow.motor_position]]\ntype = "constant"\nvalue = "180 deg"')
    assert isinstance(motion, Motion)
    assert_allclose(motion.position(T), math.pi)


def test_a_column_of_a_file(tmp_path):
    (tmp_path / "torque.csv").write_text("time [s],tau [N·mm],q\n10,0,7\n11,1000,7\n13,-1000,7\n")
    part = TORQUE + 'type = "csv"\nfile = "torque.csv"\ncolumn = "tau"\n'
    at = np.array([0.0, 0.5, 1.0, 2.0, 2.9, 3.0, 9.0])
    assert_allclose(signal(part, tmp_path)(at), [0.0, 0.5, 1.0, 0.0, -0.9, -1.0, -1.0], atol=1e-9)
    held = signal(part + 'interpolation = "held"', tmp_path)
    assert_allclose(held(at), [0.0, 0.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    # What the scenario says of the unit goes before what the header says; a column without either is SI.
    assert_allclose(signal(part + 'unit = "N*m"', tmp_path)(np.array([1.0])), [1000.0])
    assert_allclose(signal(part.replace("tau", "q"), tmp_path)(at), 7.0)


def test_a_column_without_time_needs_a_rate(tmp_path):
    (tmp_path / "torque.csv").write_text("tau [N·m]\n0\n1\n5\n")
    part = TORQUE + 'type = "csv"\nfile = "torque.csv"\ncolumn = "tau"\n'
    with pytest.raises(SimulationError, match="no time column: give the 'rate'"):
        signal(part, tmp_path)
    assert_allclose(signal(part + 'rate = "2 Hz"', tmp_path)(np.array([0.25, 1.0])), [0.5, 5.0])


CSV = TORQUE + 'type = "csv"\nfile = "t.csv"\ncolumn = "tau"\n'
SERVO = "[joint.elbow.motor_servo]\n"
SINE = 'type = "sine"\namplitude = 1\nfrequency = 1\n'
CASES = [
    ("colour = 1", "colour: there is no such key; known here: name, description, duration"),
    ("duration = -3", "duration: -3 is not possible: it has to be greater than 0"),
    ('duration = "3 m"', "duration: 'm' is a length, but"),
    ("period = 0", "period: 0 is not possible"),
    ("duration = inf", "duration: inf is not a finite number"),
    ("joint = 3", "joint: 3 is given, but a table is needed"),
    ("joint.elbow = 3", "joint.elbow: 3 is given, but a table is needed"),
    ("a = \n", "is not valid TOML"),
    ("[joint.elbow]\nmotor_torqe = []", "joint.elbow.motor_torqe: there is no such key, did you mean 'motor_torque'"),
    ("[joint.elbow]\nmotor_torque = 3", "joint.elbow.motor_torque: tables are wanted here: write [[joint.elbow.motor_torque]]"),
    ("[joint.elbow]\nmotor_torque = [3]", "joint.elbow.motor_torque[0]: 3 is given, but a table is needed"),
    (TORQUE, "joint.elbow.motor_torque[0]: 'type' is missing; it is one of \"constant\", \"sine\""),
    (TORQUE + 'type = "sinus"', '"sinus" is not one of "constant", "sine"'),
    (TORQUE + SINE + "ampltude = 3", "motor_torque[0].ampltude: there is no such key"),
    (TORQUE + 'type = "sine"\nfrequency = 1', "'amplitude' is missing"),
    (TORQUE + 'type = "sine"\namplitude = "3 rad"\nfrequency = 1', "amplitude: 'rad' is an angle, but a torque"),
    (TORQUE + 'type = "sine"\namplitude = "3"\nfrequency = 1', "amplitude: '3' has no unit"),
    (TORQUE + 'type = "sine"\namplitude = 1\nfrequency = "60 rpm"', "frequency: 'rpm' is an angular velocity"),
    (TORQUE + 'type = "sine"\namplitude = 1\nfrequency = 0', "frequency: 0 is not possible"),
    (TORQUE + 'type = "square"\namplitude = 1\nfrequency = 1\nduty = 2', "duty: 2 is not possible"),
    (TORQUE + 'type = "steps"\ntimes = [1, 2]\nvalues = [1]', "motor_torque[0]: 2 times are given for 1 values"),
    (TORQUE + 'type = "steps"\ntimes = [2, 2]\nvalues = [1, 2]', "times: each time has to be later than the one before"),
    (TORQUE + 'type = "steps"\ntimes = [2]\nvalues = ["1 V"]', "values[0]: 'V' is a voltage, but a torque"),
    (TORQUE + 'type = "trapezoid"\namplitude = 1\nrise = 2\nhold = 1\nperiod = 4', "period: is shorter than the trapezoid"),
    (TORQUE + 'type = "multisine"\nrms = 1\nspacing = 1\nhighest_frequency = 0.5', "there is no multiple of 'spacing'"),
    (TORQUE + 'type = "multisine"\nrms = 1\nspacing = 1e-9\nhighest_frequency = 5', "makes more than 2000 sines"),
    ("[joint.elbow.motor_servo]\ndamping = 1", "joint.elbow.motor_servo: 'stiffness' is missing"),
    (SERVO + "stiffness = -1", "stiffness: -1 is not possible: it has to be greater than 0"),
    (SERVO + "stiffness = 1\nlimit = 0", "limit: 0 is not possible"),
    (SERVO + 'stiffness = 1\n[[joint.elbow.motor_servo.reference]]\ntype = "constant"\nvalue = "1 N·m"', "[0].value: 'N·m'"),
    (SERVO + "stiffness = 1\n" + TORQUE + SINE, "joint.elbow.motor_servo: 'motor_torque' drives the same motor"),
    ("[[joint.ellbow.motor_torque]]\n" + SINE, "joint.ellbow: rig '' has no such joint, did you mean 'elbow'"),
    ("[[joint.elbow.motor_torque_1]]\n" + SINE, "has no such input; it has motor_torque, external_torque"),
    ("[[joint.elbow.valve_1]]\n" + SINE, "valve_1: this joint has no such input"),
    (CSV, "t.csv: there is no such file"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), CASES)
def test_what_is_wrong_is_reported_with_its_key(text, message, tmp_path):
    with pytest.raises(SimulationError) as error:
        signal(text, tmp_path)
    assert str(error.value).startswith("s.toml: ")
    assert message in str(error.value)
    assert "transmission" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time,current\n0,1\n1,2\n", "column: t.csv has no column 'tau'; it has current"),
        ("time,tau\n0,1\n1,\n2,3\n3,3\n4,3\n5,3\n", "column: 'tau' has rows without a number"),
        ("time,tau\n0,on\n1,off\n", "column: 'tau' holds no numbers: text"),
        ("time,tau [V]\n0,1\n1,2\n", "unit: 'V' is a voltage, but a torque"),
        ("", "t.csv: is empty"),
    ],
)
def test_a_file_that_will_not_do(content, message, tmp_path):
    (tmp_path / "t.csv").write_text(content)
    with pytest.raises(SimulationError, match=re.escape(message)):
        signal(CSV, tmp_path)


def test_a_name_mistyped():
    with pytest.raises(SimulationError, match="did you mean 'awas-exp1'"):
        Scenario.load("awas-exp1.")
    with pytest.raises(SimulationError, match=re.escape("there is no scenario '../x'")):
        Scenario.load("../x")


@pytest.mark.parametrize("preset", presets())
def test_every_preset_has_experiments_that_fit_it(preset):
    rig = Rig.preset(preset).file
    assert usual_scenario(rig) == f"{preset}-exp1"
    mine = [name for name in built_in() if re.fullmatch(rf"{preset}-exp\d", name)]
    assert mine
    for name in mine:
        scenario = Scenario.load(name)
        assert scenario.file.name == name
        assert scenario.file.description
        inputs = scenario.inputs(rig)
        assert set(inputs) == set(rig.joint)
        assert all(set(roles) <= set(driven_roles(rig.joint[joint])) for joint, roles in inputs.items())


def test_another_rig_gets_sines():
    assert usual_scenario(RIG) == "sines"
    assert Scenario.find(None, RIG).file.name == "sines"
    renamed = Rig.from_toml(ELASTIC.replace("elbow", "vsa2")).file
    assert usual_scenario(renamed) == "sines"


def test_the_papers_torques():
    vsa2 = Scenario.load("vsa2-exp1").inputs(Rig.preset("vsa2").file)["vsa2"]
    assert_allclose(vsa2["motor_torque_1"](T), 0.05 * np.sin(0.1 * math.pi * T), atol=1e-12)
    assert_allclose(vsa2["motor_torque_2"](T), 0.05 * np.sin(2.0 * math.pi * T), atol=1e-12)
    awas = Scenario.load("awas-exp1").inputs(Rig.preset("awas").file)["awas"]
    assert_allclose(awas["motor_torque"](T), 50.0 * 0.3 * np.sin(0.2 * math.pi * T), atol=1e-12)


@pytest.mark.parametrize("kind", GENERIC)
def test_generic_torques_stay_inside_the_transmissions_and_below_gravity(kind):
    for preset in ("vsa2", "sea", "awas"):
        rig = Rig.preset(preset).file
        (joint,) = rig.joint.values()
        (inputs,) = Scenario(generic(kind, rig)).inputs(rig).values()
        torques = [signal(T) for role, signal in inputs.items() if role.startswith("motor_torque") and callable(signal)]
        if kind == "servo":
            assert not torques
            continue
        assert all(np.abs(torque).max() > 0.0 for torque in torques)
        if preset == "vsa2":
            limit = float(
                flexibility_torque(joint.transmission_1, 0.9 * 2.0 * math.asin(1.0 / joint.transmission_1.geometry))
            )
            assert all(np.abs(torque).max() < limit for torque in torques)
        if preset != "awas":
            assert sum(np.abs(torque).max() for torque in torques) < joint.link.gravity_torque


@pytest.mark.parametrize("kind", GENERIC)
def test_generic_torques_grow_with_the_machine(kind):
    """A machine a thousand times as stiff, heavy and damped is driven a thousand times as hard."""
    small, large = (
        Rig.from_toml(f"""
[joint.a]
kind = "elastic"
[joint.a.motor]
inertia = {0.01 * size}
damping = {0.1 * size}
[joint.a.transmission]
type = "linear"
stiffness = {5.0 * size}
[joint.a.link]
inertia = {0.02 * size}
gravity_torque = {2.0 * size}
""").file
        for size in (1.0, 1000.0)
    )
    one, other = (Scenario(generic(kind, rig)).inputs(rig)["a"]["motor_torque"] for rig in (small, large))
    if kind == "servo":
        assert_allclose([other.stiffness, other.damping], [1000.0 * one.stiffness, 1000.0 * one.damping])
        assert_allclose(other.reference(T), one.reference(T))
    else:
        assert_allclose(other(T), 1000.0 * one(T), atol=1e-9)


def test_a_generic_valve_stays_in_its_range():
    rig = Rig.preset("pam").file
    for kind in GENERIC:
        (inputs,) = Scenario(generic(kind, rig)).inputs(rig).values()
        assert set(inputs) == {"valve_1", "valve_2"}
        for signal in inputs.values():
            assert 0.0 <= signal(T).min() < 5.5 < signal(T).max() <= 10.0


def arm(size):
    """Three axes, the first upright; masses, stiffnesses and inertias are `size` times those of a small arm."""
    text = "".join(
        f"""
[joint.axis_{i}]
kind = "elastic"
[joint.axis_{i}.motor]
inertia = {0.2 * size}
damping = {0.5 * size}
[joint.axis_{i}.transmission]
type = "linear"
stiffness = {2e3 * size}
[joint.axis_{i}.link]
inertia = 1.0
damping = {0.2 * size}
[[chain.link]]
joint = "axis_{i}"
length = 0.5
twist = "{-90 if i == 1 else 0} deg"
mass = {size / i}
centre = [-0.25, 0.0, 0.0]
inertia = [{0.01 * size}, {0.02 * size}, {0.02 * size}]
"""
        for i in (1, 2, 3)
    )
    return Rig.from_toml(text).file


@pytest.mark.parametrize("size", [1.0, 200.0])
@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_generic_servos_hold_an_arm_of_any_size_against_gravity(size, period):
    """Gravity pulls each motor off its reference by a tenth of a radian at most, and nothing swings up."""
    rig = arm(size)
    inputs = Scenario(generic("servo", rig, period)).inputs(rig)
    played = simulate(rig, inputs, 6.0, period=period, ideal=True)
    for joint, roles in inputs.items():
        off = played.joints[joint].truth["motor_position"] - roles["motor_torque"].reference(played.time)
        late = played.time > 3.0
        assert np.abs(off[late]).max() < 0.15
        assert np.ptp(played.joints[joint].truth["link_position"]) > 0.3


@pytest.mark.parametrize("example", EXAMPLES, ids=range(len(EXAMPLES)))
def test_every_example_of_the_documentation_loads(example):
    Scenario.from_toml(example)


def test_every_part_and_every_key_is_documented():
    for part in Part.__args__:
        assert f'type = "{part.__struct_config__.tag}"' in "".join(EXAMPLES), part
        section = TEXT.split(f"### {part.__struct_config__.tag}\n")[1].split("\n### ")[0].split("\n## ")[0]
        for key in part.__struct_fields__:
            assert f"`{key}`" in section, (part, key)
    for key in Drives.__struct_fields__:
        assert f"`{key}`" in TEXT, key
    for name in [*GENERIC, *built_in()]:
        assert f"`{name}`" in TEXT, name
