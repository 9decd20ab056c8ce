"""Equations: there is no residual of a motion whose equations are written out here; each missing role is computed from others."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from written_out import ELASTIC, Truth, derived, elastic, joint_of

from vsalog.diagnosis.causes.base import with_part
from vsalog.effects.cogging import Cogging
from vsalog.effects.contact import Contact
from vsalog.residuals.balance import balance, motion_of
from vsalog.rig.schema import BoucWen, Payload

TIME = np.arange(3000) * 1e-3
INSIDE = slice(20, -20)


@pytest.fixture(scope="module")
def arm():
    return elastic(TIME, Truth())


def left_over(joint, roles, time=TIME):
    return {e.name: e for e in balance(joint, roles, time, {})}


def assert_balanced(equations, names, tolerance=1e-6):
    assert sorted(equations) == sorted(names)
    for name, equation in equations.items():
        assert np.abs(equation.whole[INSIDE]).max() < tolerance, name


def test_no_residual_is_left_of_an_elastic_joint(arm):
    found = left_over(joint_of(), arm)
    assert_balanced(found, ["motor", "transmission", "link"])
    assert {n: e.side for n, e in found.items()} == {"motor": "motor", "transmission": "transmission", "link": "link"}
    assert all(e.unit == "N*m" for e in found.values())


EFFECTS = {
    # effect in the motion → what the plain rig must leave over, as written in the module's head
    "motor": (Truth(damping=0.08), lambda r: -0.03 * r["motor_position"][1]),
    "link": (Truth(link_damping=0.05), lambda r: -0.03 * r["link_position"][1]),
    "transmission": (Truth(stiffness=13.0), lambda r: 1.0 * (r["link_position"][0] - r["motor_position"][0])),
}


@pytest.mark.parametrize("side", EFFECTS)
def test_what_the_rig_lacks_is_left_over_where_it_belongs(side):
    """Signs included: a damping that the rig lacks leaves −ΔD θ̇, a stiffer spring a sensor that says Δk φ more."""
    truth, expected = EFFECTS[side]
    roles = elastic(TIME, truth)
    found = left_over(joint_of(), roles)
    np.testing.assert_allclose(found[side].whole[INSIDE], expected(roles)[INSIDE], atol=1e-6)
    if side != "transmission":  # a wrong spring is also in what the others take for transmitted
        for other in set(EFFECTS) - {side}:
            assert np.abs(found[other].whole[INSIDE]).max() < 1e-6


def test_effects_of_the_rig_are_taken_off():
    """Friction, cogging, payload, a push, damping and a gap, each by a formula of this test."""
    theta, q = (0.6 * np.stack([np.sin(w * TIME), w * np.cos(w * TIME), -w * w * np.sin(w * TIME)]) for w in (3.0, 4.0))
    q = q * 0.5
    phi = q - theta
    outside = np.maximum(np.abs(phi[0]) - 0.02, 0.0) * np.sign(phi[0])
    spring = 12.0 * outside + 150.0 * outside**3 + np.where(outside != 0.0, 0.3 * phi[1], 0.0)
    level = 0.05 + 0.04 * np.exp(-((theta[1] / 0.5) ** 2)) + 0.1 * np.abs(spring)
    motor = (
        0.02 * theta[2] + 0.05 * theta[1] + level * np.sign(theta[1]) - 0.07 * np.sin(6 * 5 * theta[0] + 0.3) - spring
    )
    u = np.clip((TIME - 1.0) / 0.4, 0.0, 1.0)
    link = (0.03 + 0.5 * 0.2**2) * q[2] + 0.02 * q[1] + (1.5 + 0.5 * 9.81 * 0.2) * np.sin(q[0])
    external = link + 0.03 * np.sign(q[1]) + spring - 0.8 * np.sin(np.pi * u) ** 2
    joint = joint_of(ELASTIC.replace("[joint.arm.signals]", '[joint.arm.signals]\nexternal_torque = "x"'))
    rubbing = {"coulomb": 0.05, "static": 0.09, "stribeck_velocity": 0.5, "load": 0.1}
    # It cogs six times a turn of the rotor, five of which are one of the joint.
    joint = with_part(joint, "motor", cogging=(Cogging(torque=0.07, order=6.0, phase=0.3),), gear_ratio=5.0)
    for part, friction in (("motor", rubbing), ("link", {"coulomb": 0.03})):
        joint = with_part(joint, part, friction=type(joint.motor.friction)(**friction))
    joint = with_part(joint, "link", payload=Payload(0.5, 0.2), contact=(Contact(1.0, 0.4, 0.8),))
    joint = with_part(joint, "transmission", damping=0.3, backlash=0.04)
    roles = {"motor_position": theta, "link_position": q, "torque_sensor": derived(spring, TIME)}
    roles |= {"motor_torque": derived(motor, TIME), "external_torque": derived(external, TIME)}
    assert_balanced(left_over(joint, roles), ["motor", "transmission", "link"], 1e-9)


def test_velocities_whose_sign_matters_are_reported(arm):
    found = left_over(joint_of(), arm)
    np.testing.assert_array_equal(found["motor"].rate, arm["motor_position"][1])
    np.testing.assert_array_equal(found["link"].rate, arm["link_position"][1])
    assert found["transmission"].rate is None


def without(roles, *names):
    return {r: v for r, v in roles.items() if r not in names}


MISSING = {
    # missing roles → the equations that are left
    (): ["motor", "transmission", "link"],
    ("torque_sensor",): ["motor", "link"],
    ("motor_torque",): ["transmission", "link"],
    ("link_position",): ["motor", "link"],
    ("motor_position",): [],
    ("motor_position", "motor_torque"): [],
    ("motor_torque", "torque_sensor"): ["link"],
    ("link_position", "torque_sensor"): ["link"],
    ("link_position", "motor_torque"): ["link"],
    ("link_position", "motor_position"): [],
}


@pytest.mark.parametrize("missing", MISSING, ids="+".join)
def test_missing_roles_are_computed_from_others(arm, missing):
    """The motion is the same, so what is left must balance too; by differences, hence less exactly."""
    found = left_over(joint_of(), without(arm, *missing))
    assert_balanced(found, MISSING[missing], 2e-3)


@pytest.mark.parametrize("missing", [("link_position",), ("link_position", "torque_sensor")])
def test_the_link_is_where_the_torque_puts_it(arm, missing):
    motion = motion_of(joint_of(), without(arm, *missing), TIME, {})
    np.testing.assert_allclose(motion.link[0][INSIDE], arm["link_position"][0][INSIDE], atol=1e-7)
    np.testing.assert_allclose(motion.link[1][INSIDE], arm["link_position"][1][INSIDE], atol=1e-3)
    assert motion.measured == {""}
    assert motion.spent == ({""} if "torque_sensor" in missing else frozenset())


@pytest.mark.parametrize("missing", ["link_position", "motor_position"])
def test_a_deflection_stands_for_a_position(arm, missing):
    phi = arm["link_position"] - arm["motor_position"]
    roles = without(arm, missing) | {"deflection": phi}
    motion = motion_of(joint_of(), roles, TIME, {})
    told = motion.link if missing == "link_position" else motion.motors[""]
    np.testing.assert_allclose(told, arm[missing], atol=1e-12)
    assert_balanced(left_over(joint_of(), roles), ["motor", "transmission", "link"])


def test_a_deflection_next_to_both_positions_is_held_against_them(arm):
    phi = arm["link_position"] - arm["motor_position"]
    found = left_over(joint_of(), arm | {"deflection": phi + np.array([[0.01], [0.0], [0.0]])})
    np.testing.assert_allclose(np.abs(found["deflection"].whole), 0.01, atol=1e-12)
    assert found["deflection"].side == "sensor"


def test_an_accelerometer_is_held_against_the_encoder(arm):
    acceleration = np.stack([arm["link_position"][2] + 0.5, *arm["link_position"][:2]])
    found = left_over(joint_of(), arm | {"link_acceleration": acceleration})
    np.testing.assert_allclose(found["link_acceleration"].whole, 0.5, atol=1e-12)


def test_a_gap_is_crossed_when_the_deflection_is_computed_from_the_torque():
    """Under a torque the spring is beyond the gap's edge; which side is the torque's sign."""
    joint = with_part(joint_of(), "transmission", backlash=0.04)
    torque = 1.5 * np.sin(3 * TIME)
    roles = {"motor_position": np.zeros((3, TIME.size)), "torque_sensor": derived(torque, TIME)}
    phi = motion_of(joint, roles, TIME, {}).deflections[""][0]
    beyond = phi - 0.02 * np.sign(torque)
    moving = np.abs(torque) > 1e-3
    np.testing.assert_allclose((12.0 * beyond + 150.0 * beyond**3)[moving], torque[moving], atol=1e-8)


def test_a_damped_transmission_with_a_loop_is_inverted_too(arm):
    """φ → τ by solving for the loop as Ikhouane and Rodellar have it, then back by the module."""
    height, width, damping = 0.1, 0.02, 0.05
    phi = 0.15 * np.sin(5.0 * TIME)
    rate = 0.75 * np.cos(5.0 * TIME)

    def loop(t, z):
        v = 0.75 * np.cos(5.0 * t) / width
        return [v - abs(v) * z[0]]

    z = solve_ivp(loop, (0.0, TIME[-1]), [0.0], "LSODA", TIME, rtol=1e-9, atol=1e-11, max_step=0.01).y[0]
    torque = 12.0 * phi + 150.0 * phi**3 + damping * rate + height * z
    joint = with_part(joint_of(), "transmission", damping=damping, bouc_wen=BoucWen(torque=height, width=width))
    roles = {"motor_position": np.zeros((3, TIME.size)), "torque_sensor": derived(torque, TIME)}
    found = motion_of(joint, roles, TIME, {}).deflections[""][0]
    assert np.sqrt(np.mean((found - phi)[INSIDE] ** 2)) < 0.01 * np.std(phi)


AWAS = """
[joint.j]
kind = "serial"
[joint.j.motor]
inertia = 0.0575
damping = 2.5
[joint.j.secondary_motor]
inertia = 0.05
damping = 0.8
[joint.j.transmission]
type = "awas"
spring_stiffness = 142.2
[joint.j.lever]
start = 0.1
travel = 0.01
[joint.j.link]
inertia = 0.1
damping = 0.15
[joint.j.signals]
motor_position = "a"
motor_torque = "b"
link_position = "c"
torque_sensor = "d"
setpoint = "e"
secondary_torque = "f"
"""


@pytest.fixture(scope="module")
def awas():
    """From the energy U = k_s r² sin² φ: the torque is ∂U/∂φ, the reaction on the secondary motor −∂U/∂θ_c with dr = −b dθ_c."""

    def accelerations(t, q, dq, a, da, c, dc):
        r, phi = 0.1 - 0.01 * c, q - a
        torque = 2 * 142.2 * r**2 * np.sin(phi) * np.cos(phi)
        slope = 2 * 142.2 * r * np.sin(phi) ** 2 * -0.01
        ddq = (-torque - 0.15 * dq) / 0.1
        dda = (8 * np.sin(3 * t) + 4 * np.sin(8 * t) + torque - 2.5 * da) / 0.0575
        return ddq, dda, (0.5 * np.sin(2 * t) - slope - 0.8 * dc) / 0.05, torque

    def equations(t, x):
        ddq, dda, ddc, _ = accelerations(t, *x)
        return [x[1], ddq, x[3], dda, x[5], ddc]

    found = solve_ivp(equations, (0, TIME[-1]), np.zeros(6), "DOP853", TIME, rtol=1e-10, atol=1e-12, max_step=0.01)
    q, dq, a, da, c, dc = found.y
    ddq, dda, ddc, torque = accelerations(TIME, *found.y)
    return {
        "link_position": np.stack([q, dq, ddq]),
        "motor_position": np.stack([a, da, dda]),
        "setpoint": np.stack([0.1 - 0.01 * c, -0.01 * dc, -0.01 * ddc]),
        "torque_sensor": derived(torque, TIME),
        "motor_torque": derived(8 * np.sin(3 * TIME) + 4 * np.sin(8 * TIME), TIME),
        "secondary_torque": derived(0.5 * np.sin(2 * TIME), TIME),
    }


def test_no_residual_is_left_of_a_serial_joint(awas):
    found = left_over(joint_of(AWAS), awas)
    assert_balanced(found, ["motor", "secondary_motor", "transmission", "link"], 1e-6)


def test_the_reaction_on_the_secondary_motor_matters(awas):
    """The equation is not balanced because all of it is small."""
    phi = awas["link_position"][0] - awas["motor_position"][0]
    assert np.abs(2 * 142.2 * 0.01 * awas["setpoint"][0] * np.sin(phi) ** 2).max() > 1e-3


def test_without_the_lever_arm_the_springs_torque_is_not_known(awas):
    assert left_over(joint_of(AWAS), without(awas, "setpoint")) == {}


PAIR = """
[joint.j]
kind = "antagonistic"
[joint.j.motor_1]
inertia = 0.01
damping = 0.03
[joint.j.motor_2]
inertia = 0.015
damping = 0.02
[joint.j.transmission_1]
type = "cubic"
stiffness = 3.0
cubic = 40.0
[joint.j.transmission_2]
type = "cubic"
stiffness = 4.0
cubic = 25.0
[joint.j.link]
inertia = 0.02
damping = 0.05
gravity_torque = 0.8
[joint.j.signals]
motor_position_1 = "a"
motor_position_2 = "b"
motor_torque_1 = "c"
motor_torque_2 = "d"
link_position = "e"
torque_sensor_1 = "f"
torque_sensor_2 = "g"
"""


@pytest.fixture(scope="module")
def pair():
    one, two = (lambda t: 0.8 * np.sin(4 * t) + 0.5), (lambda t: 0.6 * np.cos(7 * t) - 0.6)

    def accelerations(t, q, dq, a, da, b, db):
        e1, e2 = 3 * (q - a) + 40 * (q - a) ** 3, 4 * (q - b) + 25 * (q - b) ** 3
        ddq = (-e1 - e2 - 0.05 * dq - 0.8 * np.sin(q)) / 0.02
        return ddq, (one(t) + e1 - 0.03 * da) / 0.01, (two(t) + e2 - 0.02 * db) / 0.015, e1, e2

    def equations(t, x):
        ddq, dda, ddb, _, _ = accelerations(t, *x)
        return [x[1], ddq, x[3], dda, x[5], ddb]

    found = solve_ivp(equations, (0, TIME[-1]), np.zeros(6), "DOP853", TIME, rtol=1e-10, atol=1e-12, max_step=0.01)
    q, dq, a, da, b, db = found.y
    ddq, dda, ddb, e1, e2 = accelerations(TIME, *found.y)
    return {
        "link_position": np.stack([q, dq, ddq]),
        "motor_position_1": np.stack([a, da, dda]),
        "motor_position_2": np.stack([b, db, ddb]),
        "torque_sensor_1": derived(e1, TIME),
        "torque_sensor_2": derived(e2, TIME),
        "motor_torque_1": derived(one(TIME), TIME),
        "motor_torque_2": derived(two(TIME), TIME),
    }


def test_no_residual_is_left_of_an_antagonistic_joint(pair):
    found = left_over(joint_of(PAIR), pair)
    assert_balanced(found, ["motor_1", "motor_2", "transmission_1", "transmission_2", "link"])


def test_one_sensor_that_feels_both_transmissions(pair):
    total = pair["torque_sensor_1"] + pair["torque_sensor_2"]
    roles = without(pair, "torque_sensor_1", "torque_sensor_2") | {"torque_sensor": total}
    text = PAIR.replace('torque_sensor_1 = "f"\ntorque_sensor_2 = "g"', 'torque_sensor = "f"')
    found = left_over(joint_of(text), roles)
    assert_balanced(found, ["motor_1", "motor_2", "transmission", "link"])


@pytest.mark.parametrize(
    ("missing", "left"),
    [
        (("link_position",), ["agreement", "link", "motor_1", "motor_2"]),
        (("link_position", "torque_sensor_2"), ["agreement", "link", "motor_1"]),
        (("link_position", "torque_sensor_1", "torque_sensor_2"), ["agreement", "link"]),
        (("torque_sensor_1", "motor_torque_2"), ["link", "motor_1", "transmission_2"]),
    ],
)
def test_missing_roles_of_an_antagonistic_joint(pair, missing, left):
    assert_balanced(left_over(joint_of(PAIR), without(pair, *missing)), left, 5e-3)
