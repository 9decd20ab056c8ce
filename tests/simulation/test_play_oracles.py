"""The compiled plants against scipy's integrators at tight tolerance, with equations written out again here."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vsalog.rig import Rig
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    Chain,
    ChainLink,
    Coupling,
    CubicTransmission,
    ElasticJoint,
    ExponentialTransmission,
    Lever,
    LinearTransmission,
    Link,
    Motor,
    PolynomialTransmission,
    SerialJoint,
    Vsa2Transmission,
)
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

TIME = np.arange(10_001) * 1e-3
CLOSE = 1e-6  # of the signal's range


def oracle(rate, start, time=TIME, method="DOP853", rtol=1e-10):
    found = solve_ivp(rate, (time[0], time[-1]), start, method=method, t_eval=time, rtol=rtol, atol=1e-13)
    assert found.success
    return found.y


def assert_close(ours, theirs):
    assert np.max(np.abs(ours - theirs)) <= CLOSE * np.ptp(theirs)


def pull(t):
    return 1.5 * np.sin(2 * np.pi * 0.3 * t) + 0.7 * np.sin(2 * np.pi * 1.7 * t + 0.4)


LINK = Link(inertia=0.06, damping=0.05, gravity_torque=2.0)
MOTOR = Motor(inertia=0.09, damping=0.3)
SPRINGS = [
    (LinearTransmission(stiffness=25.0), lambda u: 25.0 * u),
    (CubicTransmission(stiffness=12.0, cubic=900.0), lambda u: 12.0 * u + 900.0 * u**3),
    (
        PolynomialTransmission(coefficients=(3.0, 0.4, 0.6), scale=0.15),
        lambda u: 3.0 * (u / 0.15) + 0.4 * (u / 0.15) ** 2 + 0.6 * (u / 0.15) ** 3,
    ),
    (ExponentialTransmission(stiffness=15.0, scale=0.1), lambda u: 15.0 * 0.1 * np.sinh(u / 0.1)),
]


@pytest.mark.parametrize(("spring", "torque"), SPRINGS, ids=lambda s: type(s).__name__)
def test_elastic_joints(spring, torque):
    def rate(t, x):
        q, dq, th, dth = x
        te = torque(q - th)
        return [dq, (-te - 0.05 * dq - 2.0 * np.sin(q)) / 0.06, dth, (pull(t) + te - 0.3 * dth) / 0.09]

    joint = ElasticJoint(motor=MOTOR, transmission=spring, link=LINK)
    ours = play(build({"j": joint}), {"j": {"motor_torque": pull}}, TIME)["j"]
    q, dq, th, dth = oracle(rate, [0.0] * 4)
    assert_close(ours["link_position"], q)
    assert_close(ours["link_velocity"], dq)
    assert_close(ours["motor_position"], th)
    assert_close(ours["motor_velocity"], dth)
    assert_close(ours["transmission_torque"], torque(q - th))


def vsa2_torque(k, c, phi):
    beta = np.arcsin(c * np.sin(phi / 2)) - phi / 2
    return 2 * k * beta * (c * np.cos(phi / 2) / np.sqrt(1 - (c * np.sin(phi / 2)) ** 2) - 1) / 2


def test_the_vsa2():
    def one(t):
        return 0.04 * np.sin(2 * np.pi * 0.1 * t)

    def two(t):
        return 0.045 * np.sin(2 * np.pi * t)

    def rate(t, x):
        q, dq, a, da, b, db = x
        t1, t2 = vsa2_torque(0.5, 1.8, q - a), vsa2_torque(0.5, 1.8, q - b)
        return [
            dq, (-t1 - t2 - 5e-3 * dq - 60e-3 * np.sin(q)) / 2e-3,
            da, (one(t) + t1 - 1e-3 * da) / 7.3e-3, db, (two(t) + t2 - 1e-3 * db) / 7.3e-3,
        ]  # fmt: skip

    joint = Rig.preset("vsa2").file.joint["vsa2"]
    ours = play(build({"j": joint}), {"j": {"motor_torque_1": one, "motor_torque_2": two}}, TIME)["j"]
    q, _, a, _, b, _ = oracle(rate, [0.0] * 6)
    assert_close(ours["link_position"], q)
    assert_close(ours["motor_position_1"], a)
    assert_close(ours["motor_position_2"], b)
    assert_close(ours["flexibility_torque_total"], vsa2_torque(0.5, 1.8, q - a) + vsa2_torque(0.5, 1.8, q - b))


@pytest.mark.parametrize("inertia", [1.29e-7, 1e-3], ids=["stiff secondary motor", "slow secondary motor"])
def test_the_awas(inertia):
    """B_c 529 is D_c/B_c ≈ 1.1e5 1/s: Radau in the oracle, Rodas in the product."""

    def primary(t):
        return 15 * np.sin(0.2 * np.pi * t)

    def secondary(t):
        return 150 * np.tanh(np.sin(2 * np.pi * t / 5) / 0.2)

    b, k = 2.5e-3 / (2 * np.pi), 14220.0
    B, D, bc, dc = 2.3e-5 * 2500, 0.001 * 2500, inertia * 529, 0.0141 * 529

    def rate(t, x):
        q, dq, th, dth, c, dc_ = x
        r = 0.1 - b * c
        te, psi = k * r**2 * np.sin(2 * (q - th)), -2 * k * b * r * np.sin(q - th) ** 2
        return [
            dq,
            (-te - 0.15 * dq) / 0.1,
            dth,
            (primary(t) + te - D * dth) / B,
            dc_,
            (secondary(t) - psi - dc * dc_) / bc,
        ]

    preset = Rig.preset("awas").file.joint["awas"]
    joint = SerialJoint(
        motor=preset.motor,
        secondary_motor=Motor(side="rotor", inertia=inertia, damping=0.0141, gear_ratio=23.0),
        transmission=AwasTransmission(spring_stiffness=k),
        lever=Lever(start=0.1, travel=b),
        link=Link(inertia=0.1, damping=0.15),
    )
    ours = play(build({"j": joint}), {"j": {"motor_torque": primary, "secondary_torque": secondary}}, TIME)["j"]
    q, _, th, _, c, dc_ = oracle(rate, [0.0] * 6, method="Radau")
    assert_close(ours["link_position"], q)
    assert_close(ours["motor_position"], th)
    assert_close(ours["secondary_position"], c)
    assert_close(ours["secondary_velocity"], dc_)
    assert_close(ours["lever_arm"], 0.1 - b * c)
    assert_close(ours["reaction_torque"], -2 * k * b * (0.1 - b * c) * np.sin(q - th) ** 2)


def two_links(q, dq):
    """Mass matrix and the rest of a planar arm in the vertical plane, x downwards: a textbook's, from its Lagrangian."""
    m1, m2, l1, c1, c2, i1, i2, g = 1.2, 0.8, 0.5, 0.2, 0.15, 0.03, 0.012, 9.81
    cos, sin = np.cos(q[1]), np.sin(q[1])
    coupled = i2 + m2 * (c2**2 + l1 * c2 * cos)
    M = np.array(
        [[i1 + m1 * c1**2 + i2 + m2 * (l1**2 + c2**2 + 2 * l1 * c2 * cos), coupled], [coupled, i2 + m2 * c2**2]]
    )
    h = m2 * l1 * c2 * sin
    C = np.array([-h * (2 * dq[0] * dq[1] + dq[1] ** 2), h * dq[0] ** 2])
    G = np.array(
        [(m1 * c1 + m2 * l1) * g * np.sin(q[0]) + m2 * c2 * g * np.sin(q.sum()), m2 * c2 * g * np.sin(q.sum())]
    )
    return M, C + G


@pytest.mark.parametrize("s", [0.0, 0.02], ids=["reduced model", "with S"])
def test_two_links_with_elastic_joints(s):
    chain = Chain(
        gravity=(9.81, 0.0, 0.0),
        link=(
            ChainLink(joint="a", length=0.5, mass=1.2, centre=(0.2 - 0.5, 0, 0), inertia=(0, 0, 0.03)),
            ChainLink(joint="b", length=0.4, mass=0.8, centre=(0.15 - 0.4, 0, 0), inertia=(0, 0, 0.012)),
        ),
        coupling=(Coupling(link="a", motor="b", inertia=s),) if s else (),
    )
    joint = ElasticJoint(
        motor=Motor(inertia=0.09, damping=0.4), transmission=LinearTransmission(stiffness=60.0, damping=0.05),
        link=Link(inertia=1.0, damping=0.1),
    )  # fmt: skip

    def other(t):
        return 0.6 * np.sin(2 * np.pi * 0.9 * t)

    S = np.array([[0.0, s], [0.0, 0.0]])

    def rate(t, x):
        q, dq, th, dth = x.reshape(4, 2)
        M, bias = two_links(q, dq)
        te = 60.0 * (q - th) + 0.05 * (dq - dth)
        A = np.block([[M, S], [S.T, 0.09 * np.eye(2)]])
        f = np.concatenate([-bias - 0.1 * dq - te, np.array([pull(t), other(t)]) + te - 0.4 * dth])
        a = np.linalg.solve(A, f)
        return np.concatenate([dq, a[:2], dth, a[2:]])

    machine = build({"a": joint, "b": joint}, chain)
    ours = play(machine, {"a": {"motor_torque": pull}, "b": {"motor_torque": other}}, TIME)
    found = oracle(rate, np.zeros(8))
    for i, name in enumerate("ab"):
        assert_close(ours[name]["link_position"], found[i])
        assert_close(ours[name]["link_velocity"], found[2 + i])
        assert_close(ours[name]["motor_position"], found[4 + i])


def test_the_qbmove_has_the_springs_of_its_data_sheet():
    """τ = 0.0222 sinh 6.7328 (q − θ₁) + 0.0216 sinh 6.9602 (q − θ₂); both motors are held, and the shaft is pushed."""

    def spring(i, u):
        return (0.0222 * np.sinh(6.7328 * u), 0.0216 * np.sinh(6.9602 * u))[i]

    def motors(t):
        return 0.3 * np.sin(2 * np.pi * 0.7 * t), 0.3 * np.sin(2 * np.pi * 0.5 * t + 0.3)

    def rate(t, x):
        q, dq, a, da, b, db = x
        t1, t2 = spring(0, q - a), spring(1, q - b)
        ddq = (-t1 - t2 - 0.05 * dq - 0.3 * np.sin(q)) / 0.01
        u1, u2 = motors(t)
        return [dq, ddq, da, (u1 + t1 - 0.1 * da) / 0.0233, db, (u2 + t2 - 0.1 * db) / 0.0233]

    inputs = {"motor_torque_1": lambda t: motors(t)[0], "motor_torque_2": lambda t: motors(t)[1]}
    ours = play(build(Rig.preset("qbmove").file.joint), {"qbmove": inputs}, TIME)["qbmove"]
    q, _, a, _, b, _ = oracle(rate, [0.0] * 6)
    assert np.ptp(q - a) * 6.7328 > 2.0  # far into the hardening
    assert_close(ours["link_position"], q)
    assert_close(ours["motor_position_1"], a)
    assert_close(ours["motor_position_2"], b)
    stiffness = 6.7328 * 0.0222 * np.cosh(6.7328 * (q - a)) + 6.9602 * 0.0216 * np.cosh(6.9602 * (q - b))
    assert_close(ours["stiffness_total"], stiffness)


def test_an_antagonistic_joint_with_unlike_transmissions():
    joint = AntagonisticJoint(
        motor_1=Motor(inertia=7e-3, damping=2e-3), motor_2=Motor(inertia=9e-3, damping=1e-3),
        transmission_1=Vsa2Transmission(stiffness=0.5, geometry=1.7), transmission_2=LinearTransmission(stiffness=0.3),
        link=Link(inertia=3e-3, damping=4e-3),
    )  # fmt: skip

    def one(t):
        return 0.03 * np.sin(2 * np.pi * 0.4 * t)

    def rate(t, x):
        q, dq, a, da, b, db = x
        t1, t2 = vsa2_torque(0.5, 1.7, q - a), 0.3 * (q - b)
        return [dq, (-t1 - t2 - 4e-3 * dq) / 3e-3, da, (one(t) + t1 - 2e-3 * da) / 7e-3, db, (t2 - 1e-3 * db) / 9e-3]

    ours = play(build({"j": joint}), {"j": {"motor_torque_1": one}}, TIME)["j"]
    q, _, a, _, b, _ = oracle(rate, [0.0] * 6)
    assert_close(ours["link_position"], q)
    assert_close(ours["motor_position_1"], a)
    assert_close(ours["motor_position_2"], b)
