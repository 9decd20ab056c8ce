"""Effects, chains and sensor errors of a rig: units, contradictions, settings of list elements."""

import math

import pytest

from vsalog.core.errors import RigError
from vsalog.effects.cogging import Cogging
from vsalog.effects.contact import Contact
from vsalog.effects.eccentricity import Eccentricity
from vsalog.rig import Rig
from vsalog.rig.schema import (
    BoucWen,
    ElasticJoint,
    ExponentialTransmission,
    Friction,
    Motor,
    Payload,
    PolynomialTransmission,
    Signal,
    SlipElement,
)

WHOLE = """
[joint.a]
kind = "elastic"

[joint.a.motor]
torque_delay = "2 ms"
torque_step = "5 N*mm"
friction = { coulomb = "20 N*mm", static = "30 N*mm", stribeck_velocity = "3 deg/s", presliding_stiffness = "1 N*m/deg" }
cogging = [{ torque = "3 N*mm", order = 7, phase = "90 deg" }, { torque = 0.01, order = 14 }]

[joint.a.transmission]
type = "polynomial"
coefficients = ["500 N*mm", 2]
scale = "10 deg"
backlash = "0.5 deg"
drift = -1e-4
bouc_wen = { torque = "1 N*m", width = "1 deg" }

[[joint.a.transmission.slip]]
stiffness = "3 N*m/deg"
limit = "20 N*mm"

[joint.a.link]
inertia = "50 kg*cm^2"
gravity_angle = "-90 deg"
payload = { mass = "300 g", distance = "20 cm" }
contact = [{ start = "100 ms", duration = "1 min", torque = "-2 N*m" }]

[joint.a.signals.link_position]
channel = "q"
unit = "deg"
drift = "0.1 deg/s"
delay = "-3 ms"
noise = "0.2 deg"
jitter = "20 us"
dropped = 0.1
eccentricity = { amplitude = "1 deg", phase = "45 deg" }

[joint.b]
kind = "elastic"

[chain]
gravity = [0, "-9.81 m/s^2", 0]

[[chain.link]]
joint = "a"
length = "50 cm"
centre = ["-25 cm", 0, "1 mm"]

[[chain.link]]
joint = "b"
inertia = [0, 0, "20 kg*cm^2"]
accelerometer = { orientation = ["90 deg", 0, 0] }

[[chain.coupling]]
link = "a"
motor = "b"
inertia = "3 kg*cm^2"
"""


def joint_a(rig):
    joint = rig.joints["a"]
    assert isinstance(joint, ElasticJoint)
    return joint


def near(value):
    return pytest.approx(value, rel=1e-12)


def test_every_effect_becomes_si():
    rig = Rig.from_toml(WHOLE)
    joint = joint_a(rig)
    assert joint.motor.friction == Friction(
        coulomb=near(0.02), static=near(0.03), stribeck_velocity=near(math.radians(3)), presliding_stiffness=near(180 / math.pi)
    )  # fmt: skip
    assert (joint.motor.torque_delay, joint.motor.torque_step) == (near(0.002), near(0.005))
    assert joint.motor.cogging == (
        Cogging(torque=near(0.003), order=7, phase=near(math.pi / 2)),
        Cogging(torque=0.01, order=14),
    )
    assert joint.transmission == PolynomialTransmission(
        coefficients=(0.5, 2.0), scale=near(math.radians(10)), backlash=near(math.radians(0.5)), drift=-1e-4,
        bouc_wen=BoucWen(torque=1.0, width=near(math.radians(1))),
        slip=(SlipElement(stiffness=near(3 * 180 / math.pi), limit=near(0.02)),),
    )  # fmt: skip
    assert joint.link is not None
    assert joint.link.gravity_angle == near(-math.pi / 2)
    assert joint.link.payload == Payload(mass=near(0.3), distance=near(0.2))
    assert joint.link.contact == (Contact(start=near(0.1), duration=near(60.0), torque=-2.0),)
    assert joint.signals.link_position == Signal(
        channel="q", unit="deg", drift=near(math.radians(0.1)), delay=near(-0.003), noise=near(math.radians(0.2)),
        jitter=near(2e-5), dropped=0.1, eccentricity=Eccentricity(amplitude=near(math.radians(1)), phase=near(math.pi / 4)),
    )  # fmt: skip
    chain = rig.file.chain
    assert chain is not None
    assert chain.gravity == (0.0, -9.81, 0.0)
    assert chain.link[0].centre == near((-0.25, 0.0, 0.001))
    assert chain.link[1].inertia == near((0.0, 0.0, 0.002))
    assert chain.link[1].accelerometer is not None
    assert chain.link[1].accelerometer.orientation == near((math.pi / 2, 0.0, 0.0))
    assert chain.coupling[0].inertia == near(3e-4)


def test_what_is_written_loads_to_an_equal_rig():
    rig = Rig.from_toml(WHOLE)
    assert Rig.from_toml(rig.to_toml()).file == rig.file


def test_rotor_side_friction_and_cogging_are_what_the_joint_feels():
    motor = Motor(
        side="rotor", gear_ratio=50.0, inertia=1e-5, damping=1e-4, torque_offset=1e-3, torque_step=1e-4,
        friction=Friction(coulomb=0.002, static=0.003, stribeck_velocity=5.0, presliding_stiffness=0.4, presliding_damping=0.01),
        cogging=(Cogging(torque=1e-3, order=7),),
    ).reflected  # fmt: skip
    assert (motor.inertia, motor.damping) == (near(0.025), near(0.25))
    assert (motor.torque_offset, motor.torque_step) == (near(0.05), near(0.005))
    assert motor.friction == Friction(
        coulomb=near(0.1), static=near(0.15), stribeck_velocity=near(0.1), presliding_stiffness=near(1000.0),
        presliding_damping=near(25.0),
    )  # fmt: skip
    # The rotor still turns γ times as far: order counts its turns.
    assert motor.cogging == (Cogging(torque=near(0.05), order=7),)
    assert motor.reflected is motor


def test_settings_reach_into_lists():
    def changed(key, value):
        return Rig.from_toml(WHOLE).with_setting(key, value)

    cogging = joint_a(changed("joint.a.motor.cogging[0].torque", "5 N*mm")).motor.cogging
    assert cogging == (Cogging(torque=near(0.005), order=7, phase=near(math.pi / 2)), Cogging(torque=0.01, order=14))
    assert joint_a(changed("joint.a.motor.cogging.1.order", "21")).motor.cogging[1].order == 21
    spring = joint_a(changed("joint.a.transmission.coefficients[1]", "3 N*m")).transmission
    assert isinstance(spring, PolynomialTransmission)
    assert spring.coefficients == (0.5, 3.0)
    assert spring.slip == joint_a(Rig.from_toml(WHOLE)).transmission.slip
    chain = changed("chain.link[1].centre[0]", "5 cm").file.chain  # the list is at its default
    assert chain is not None
    assert chain.link[1].centre == near((0.05, 0.0, 0.0))
    chain = changed("chain.link[0].centre[0]", "5 cm").file.chain
    assert chain is not None
    assert chain.link[0].centre == near((0.05, 0.0, 0.001))
    assert chain.link[0].length == near(0.5)
    assert [link.joint for link in chain.link] == ["a", "b"]
    chain = changed("chain.link[1].accelerometer.orientation[2]", "180 deg").file.chain
    assert chain is not None
    assert chain.link[1].accelerometer is not None
    assert chain.link[1].accelerometer.orientation == near((math.pi / 2, 0.0, math.pi))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("joint.a.motor.cogging[2].torque", "1", "joint.a.motor.cogging are counted from 0 and there are 2"),
        ("joint.a.motor.cogging[0].torqe", "1", "joint.a.motor.cogging[0].torqe: there is no such key"),
        ("joint.a.motor.cogging[0].order", "0", "joint.a.motor.cogging[0].order: 0 is not possible"),
        ("joint.a.motor.cogging[0]", "1", "joint.a.motor.cogging[0]: 1 is given, but a table is needed"),
        ("joint.a.transmission.coefficients[0]", "3 N", "coefficients[0]: 'N' is a force, but a torque"),
        ("chain.link[0].joint", "c", "chain.link[0].joint: there is no joint 'c'"),
        ("joint.b.motor.cogging[0].torque", "1", "there are 0: set the list as a whole"),
        ("chain.link[7].length", "1", "chain.link are counted from 0 and there are 2"),
        ("chain.link[0].centre[3]", "1", "centre are counted from 0 and there are 3"),
        ("joint.a.signals.link_position.eccentricity.amplitude", "2", "has to be below the gain, 1,"),
    ],
)
def test_settings_in_lists_that_cannot_be(key, value, message):
    with pytest.raises(RigError) as caught:
        Rig.from_toml(WHOLE).with_setting(key, value)
    assert str(caught.value).startswith("--set: ")
    assert message in str(caught.value)


def test_a_preset_s_sensor_does_not_cling_to_a_constant():
    rig = Rig.from_toml(
        'preset = "awas"\n[joint.awas.signals]\nsetpoint = { constant = "70 mm" }\nlink_position = { constant = 0 }'
    )
    signals = rig.joints["awas"].signals
    assert signals.setpoint == Signal(constant=near(0.07), unit="m")  # type: ignore[union-attr]
    assert signals.link_position == Signal(constant=0.0)


ELASTIC = '[joint.a]\nkind = "elastic"\n'
FRICTION = ELASTIC + "[joint.a.motor.friction]\n"
SPRING = ELASTIC + "[joint.a.transmission]\n"
CHAIN = '[joint.a]\nkind = "elastic"\n[joint.b]\nkind = "elastic"\n[[chain.link]]\njoint = "a"\n[[chain.link]]\njoint = "b"\n'
COUPLING = CHAIN + "[[chain.coupling]]\ninertia = 1e-3\n"
SIGNALS = ELASTIC + "[joint.a.signals]\n"
ANGLE = SIGNALS + 'link_position = {{ channel = "q", {} }}'
DISC = "eccentricity = { amplitude = 0.1 }"

CASES = [
    (FRICTION + "coulomb = 1\nstatic = 0.5\nstribeck_velocity = 1", "static: the break-away level cannot be below 'coulomb'"),
    (FRICTION + "coulomb = 1\nstatic = 2", "joint.a.motor.friction: 'static' needs a 'stribeck_velocity'"),
    (FRICTION + "coulomb = 1\npresliding_damping = 2", "presliding_damping: does nothing without a 'presliding_stiffness'"),
    (FRICTION + "presliding_stiffness = 2", "presliding_stiffness: does nothing without a level: give 'coulomb'"),
    (FRICTION + "coulomb = -1", "coulomb: -1 is not possible: it has to be at least 0"),
    (FRICTION + 'coulomb = "1 N*m*s/rad"', "coulomb: 'N*m*s/rad' is"),
    (ELASTIC + "[joint.a.link]\ninertia = 1\nfriction = { static = 1 }", "joint.a.link.friction: 'static' needs"),
    (ELASTIC + "[joint.a.link]\ninertia = 1\ncontact = [{ start = 0, duration = 0, torque = 1 }]", "[0].duration: 0 is not"),
    (ELASTIC + "[joint.a.link]\ninertia = 1\ncontact = { start = 0 }", "write [[joint.a.link.contact]]"),
    (ELASTIC + "[joint.a.link]\ninertia = 1\npayload = { mass = 1 }", "joint.a.link.payload: 'distance' is missing"),
    (SPRING + 'type = "polynomial"\nscale = 1\ncoefficients = []', "coefficients: at least one coefficient is needed"),
    (SPRING + 'type = "polynomial"\nscale = 1\ncoefficients = 3', "coefficients: a list of numbers is needed"),
    (SPRING + 'type = "polynomial"\nscale = 0\ncoefficients = [1]', "scale: 0 is not possible"),
    (SPRING + 'type = "exponential"\nstiffness = 3', "'scale' is missing in a transmission of type \"exponential\""),
    (SPRING + 'type = "linear"\nstiffness = 3\nasymmetry = 2', "asymmetry: 2 is not possible: it has to be at most 1"),
    (SPRING + 'type = "linear"\nstiffness = 3\nbacklash = -1', "backlash: -1 is not possible"),
    (SPRING + 'type = "linear"\nstiffness = 3\nslip = [{ stiffness = 1 }]', "slip[0]: 'limit' is missing"),
    (SPRING + 'type = "linear"\nstiffness = 3\nbouc_wen = { torque = 1, width = 1, shape = 0.2 }', "shape: 0.2 is not possible"),
    (SPRING + 'type = "unknown"\ndamping = 1', "there is no such key in a transmission of type \"unknown\""),
    (CHAIN.replace('joint = "b"', 'joint = "c"'), "chain.link[1].joint: there is no joint 'c'"),
    (CHAIN.replace('joint = "b"', 'joint = "a"'), "chain.link[1].joint: joint 'a' moves another link already"),
    (CHAIN + "centre = [1, 2]", "chain.link[1].centre: 2 numbers are given, but three are needed"),
    (CHAIN + "inertia = [1, 2, -3]", "chain.link[1].inertia[2]: -3 is not possible"),
    (CHAIN + "accelerometer = { position = [1] }", "chain.link[1].accelerometer.position: 1 numbers are given"),
    ("[chain]\ngravity = [0, 9.81]", "chain.gravity: 2 numbers are given, but three are needed"),
    (COUPLING + 'link = "a"\nmotor = "c"', "chain.coupling[0].motor: 'c' is not a joint of the chain"),
    (COUPLING + 'link = "b"\nmotor = "a"', "S is strictly upper triangular"),
    (ANGLE.format("eccentricity = { amplitude = 1.0 }"), "eccentricity: its slope, 1, has to be below the gain, 1,"),
    (ANGLE.format("gain = 0.1, eccentricity = { amplitude = 0.1 }"), "its slope, 0.1, has to be below the gain, 0.1,"),
    (ANGLE.format("gain = 0"), "gain: 0 is not possible"),
    (ANGLE.format('drift = "1 deg"'), "drift: 'deg' is an angle"),
    (ANGLE.format('drift = "1 N*m/s"'), "joint.a.signals.link_position.drift: 'N*m/s' is"),
    (ANGLE.format("delay = 1e10"), "delay: 1e+10 s are longer than any log"),
    (ANGLE.format("jitter = 1e10"), "jitter: 1e+10 s are longer than any log"),
    (ANGLE.format("dropped = 1.5"), "dropped: 1.5 is not possible: it has to be at most 1"),
    (ANGLE.format("noise = -1"), "noise: -1 is not possible"),
    (SIGNALS + f'torque_sensor = {{ channel = "x", {DISC} }}', "torque_sensor.eccentricity: this error is for sensors that"),
    (SIGNALS.replace("elastic", "serial") + f'setpoint = {{ channel = "x", unit = "mm", {DISC} }}', "this error is for sensors"),
    (SIGNALS + "link_position = { constant = 1, noise = 1 }", "noise: does nothing next to a constant"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), CASES, ids=range(len(CASES)))
def test_contradictions_are_named(text, message):
    with pytest.raises(RigError) as caught:
        Rig.from_toml(text, "my.toml")
    assert message in str(caught.value)


def test_an_exponential_spring_loads():
    joint = joint_a(Rig.from_toml(SPRING + 'type = "exponential"\nstiffness = "3 N*m/deg"\nscale = "2 deg"'))
    assert joint.transmission == ExponentialTransmission(stiffness=near(3 * 180 / math.pi), scale=near(math.radians(2)))
