"""The plants against an independent integration of equations written out here, and against conservation of energy."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from vsalog.core.errors import SimulationError
from vsalog.mechanics import elastic_energy
from vsalog.mechanics.rigid_body import inverse_dynamics
from vsalog.rig import Rig
from vsalog.rig.schema import (
    AntagonisticJoint,
    CubicTransmission,
    ElasticJoint,
    Friction,
    Link,
    Motor,
    RigFile,
    SerialJoint,
)
from vsalog.simulation import (
    Experiment,
    awas_experiment,
    awas_rig,
    elastic_experiment,
    elastic_rig,
    simulate,
    sine,
    vsa2_experiment,
    vsa2_rig,
)

Array = NDArray[np.float64]
SECONDS = 10.0


def reference(
    equations: Callable[[float, Array], list[float]], size: int, time: Array, method: str = "DOP853"
) -> Array:
    """Solution at `time`, shape (size, N)."""
    solution = solve_ivp(
        equations, (0.0, time[-1]), np.zeros(size), method, time, rtol=1e-10, atol=1e-13, max_step=0.05
    )
    assert solution.success
    return np.asarray(solution.y)


def assert_close_in_range(experiment: Experiment, expected: dict[str, Array], tolerance: float) -> None:
    for name, values in expected.items():
        error = np.abs(experiment.truth[name] - values).max() / np.ptp(values)
        assert error < tolerance, f"{name}: {error:.2e} of its range"


def four_bar(phi: float, k: float, c: float) -> float:
    beta = np.arcsin(c * np.sin(phi / 2)) - phi / 2
    return float(k * beta * (c * np.cos(phi / 2) / np.sqrt(1 - c * c * np.sin(phi / 2) ** 2) - 1))


def test_vsa2_agrees_with_an_independent_integrator() -> None:
    # Plant of Flacco 2014 §V in N·mm: B = 7.5, D = 0.9, springs drifting by 0.0005 t.
    def equations(t: float, x: Array) -> list[float]:
        q, dq, a, da, b, db = x
        k = 500.0 + 0.0005 * t
        e1, e2 = four_bar(q - a, k, 1.8), four_bar(q - b, k, 1.8)
        return [
            dq,
            (-e1 - e2 - 5.0 * dq - 60.0 * np.sin(q)) / 2.0,
            da,
            (50.0 * np.sin(0.1 * np.pi * t) + e1 - 0.9 * da) / 7.5,
            db,
            (50.0 * np.sin(2.0 * np.pi * t) + e2 - 0.9 * db) / 7.5,
        ]

    played = vsa2_experiment(ideal=True, duration=SECONDS, drift=0.5e-6, inertia=7.5e-3, damping=0.9e-3)
    q, dq, a, da, b, db = reference(equations, 6, played.time)
    k = 500.0 + 0.0005 * played.time
    torque = np.array([four_bar(p, s, 1.8) for p, s in zip(q - a, k, strict=True)]) * 1e-3
    expected = {
        "link_position": q,
        "link_velocity": dq,
        "motor_position_1": a,
        "motor_velocity_1": da,
        "motor_position_2": b,
        "motor_velocity_2": db,
        "deflection_1": q - a,
        "flexibility_torque_1": torque,
    }
    assert_close_in_range(played, expected, 1e-6)


def test_awas_agrees_with_an_implicit_integrator() -> None:
    # Flacco 2012 eq. 53 with both motors reflected by hand; Radau copes with the stiff secondary motor.
    b_lever = 2.5e-3 / (2.0 * np.pi)

    def equations(t: float, x: Array) -> list[float]:
        q, dq, theta, dtheta, c, dc = x
        r = 0.1 - b_lever * c
        phi = q - theta
        torque = 14_220.0 * r**2 * np.sin(2.0 * phi)
        reaction = -2.0 * 14_220.0 * b_lever * r * np.sin(phi) ** 2
        command = 200.0 * np.tanh(np.sin(0.2 * np.pi * t) / 0.05)
        return [
            dq,
            (-torque - 0.15 * dq) / 0.1,
            dtheta,
            (50.0 * 0.3 * np.sin(0.2 * np.pi * t) + torque - 0.001 * 2500.0 * dtheta) / (2.3e-5 * 2500.0),
            dc,
            (command - reaction - 0.0141 * 529.0 * dc) / (1.29e-7 * 529.0),
        ]

    played = awas_experiment(ideal=True, duration=SECONDS)
    q, dq, theta, dtheta, c, dc = reference(equations, 6, played.time, "Radau")
    expected = {
        "link_position": q,
        "link_velocity": dq,
        "motor_position": theta,
        "motor_velocity": dtheta,
        "secondary_position": c,
        "secondary_velocity": dc,
        "lever_arm": 0.1 - b_lever * c,
        "deflection": q - theta,
        "flexibility_torque": 14_220.0 * (0.1 - b_lever * c) ** 2 * np.sin(2.0 * (q - theta)),
    }
    assert_close_in_range(played, expected, 1e-6)


def test_elastic_joint_agrees_with_an_independent_integrator() -> None:
    def equations(t: float, x: Array) -> list[float]:
        q, dq, a, da = x
        e = 20.0 * (q - a) + 2000.0 * (q - a) ** 3
        tau = 2.0 * np.sin(0.4 * np.pi * t) + np.sin(2.6 * np.pi * t)
        return [dq, (-e - 0.1 * dq - 3.0 * np.sin(q)) / 0.05, da, (tau + e - 0.4 * da) / 0.08]

    played = elastic_experiment(ideal=True, duration=SECONDS)
    q, dq, a, da = reference(equations, 4, played.time)
    expected = {"link_position": q, "link_velocity": dq, "motor_position": a, "motor_velocity": da}
    assert_close_in_range(played, expected, 1e-6)


def kinetic(inertia: float, velocity: Array) -> Array:
    return 0.5 * inertia * velocity**2


def assert_conserved(energy: Array) -> None:
    assert energy[0] > 0.0
    assert np.abs(energy - energy[0]).max() < 1e-6 * energy[0]


def test_energy_is_conserved_in_an_undamped_antagonistic_joint() -> None:
    joint = vsa2_rig().joint["vsa2"]
    assert isinstance(joint, AntagonisticJoint)
    motor = Motor(inertia=7.3e-3)
    free = msgspec.structs.replace(joint, motor_1=motor, motor_2=motor, link=Link(inertia=2e-3, gravity_torque=0.06))
    start = np.array([0.3, 0.0, 0.1, 0.5, 0.4, -0.3])
    truth = simulate(RigFile(joint={"j": free}), {}, 5.0, start={"j": start}).truth
    energy = kinetic(2e-3, truth["link_velocity"]) + 0.06 * (1.0 - np.cos(truth["link_position"]))
    for i in "12":
        energy = energy + kinetic(7.3e-3, truth[f"motor_velocity_{i}"])
        energy = energy + elastic_energy(joint.transmission_1, truth[f"deflection_{i}"])
    assert_conserved(energy)


def test_energy_is_conserved_in_an_undamped_elastic_joint() -> None:
    joint = elastic_rig().joint["sea"]
    assert isinstance(joint, ElasticJoint)
    free = msgspec.structs.replace(joint, motor=Motor(inertia=0.08), link=Link(inertia=0.05, gravity_torque=3.0))
    start = np.array([0.5, 0.0, 0.45, 1.0])
    truth = simulate(RigFile(joint={"j": free}), {}, 5.0, start={"j": start}).truth
    energy = (
        kinetic(0.05, truth["link_velocity"])
        + kinetic(0.08, truth["motor_velocity"])
        + 3.0 * (1.0 - np.cos(truth["link_position"]))
        + elastic_energy(joint.transmission, truth["deflection"])
    )
    assert_conserved(energy)


def test_energy_is_conserved_in_an_undamped_awas() -> None:
    # Without damping the secondary motor is not stiff: this covers the explicit step.
    joint = awas_rig().joint["awas"]
    assert isinstance(joint, SerialJoint)
    free = msgspec.structs.replace(
        joint, motor=Motor(inertia=0.06), secondary_motor=Motor(inertia=0.01), link=Link(inertia=0.1)
    )
    start = np.array([0.02, 0.0, 0.0, 0.0, 10.0, 0.5])
    truth = simulate(RigFile(joint={"j": free}), {}, 2.0, start={"j": start}).truth
    energy = (
        kinetic(0.1, truth["link_velocity"])
        + kinetic(0.06, truth["motor_velocity"])
        + kinetic(0.01, truth["secondary_velocity"])
        + elastic_energy(joint.transmission, truth["deflection"], truth["lever_arm"])
    )
    assert_conserved(energy)


@pytest.mark.parametrize("damping", [0.45, 0.55])
def test_awas_agrees_on_both_sides_of_the_stiff_limit(damping: float) -> None:
    # Reference: 64 steps per period, far below any limit.
    joint = awas_rig().joint["awas"]
    assert isinstance(joint, SerialJoint)
    secondary = Motor(inertia=2.5e-4, damping=damping)
    rig = RigFile(joint={"j": msgspec.structs.replace(joint, secondary_motor=secondary)})
    torques = {
        "motor_torque": lambda t: 5.0 * np.sin(3.0 * t),
        "secondary_torque": lambda t: 10.0 * np.sin(2.0 * t),
    }
    coarse, fine = (simulate(rig, {"j": torques}, 3.0, steps=steps).truth for steps in (4, 64))
    for name in ("secondary_position", "deflection", "link_position"):
        assert np.abs(coarse[name] - fine[name]).max() < 1e-5 * np.ptp(fine[name]), name


def test_light_motors_with_much_damping_get_enough_steps() -> None:
    # Flacco 2014 §VII, second case: B = 1e-4 and D = 1.27 settle within 80 µs, which four steps per ms cannot follow.
    spring = CubicTransmission(stiffness=5.0, cubic=20.0)
    motor = Motor(inertia=1e-4, damping=1.27)
    joint = AntagonisticJoint(
        motor_1=motor,
        motor_2=motor,
        transmission_1=spring,
        transmission_2=spring,
        link=Link(inertia=0.05, damping=0.1),
    )
    torques = {"motor_torque_1": lambda t: 2.0 * np.sin(3.0 * t), "motor_torque_2": lambda t: np.sin(5.0 * t)}
    played = simulate(RigFile(joint={"j": joint}), {"j": torques}, 2.0)

    def equations(t: float, x: Array) -> list[float]:
        q, dq, a, da, b, db = x
        e1, e2 = (5.0 * p + 20.0 * p**3 for p in (q - a, q - b))
        return [
            dq,
            (-e1 - e2 - 0.1 * dq) / 0.05,
            da,
            (2.0 * np.sin(3.0 * t) + e1 - 1.27 * da) / 1e-4,
            db,
            (np.sin(5.0 * t) + e2 - 1.27 * db) / 1e-4,
        ]

    q, _, a, da, *_ = reference(equations, 6, played.time, "Radau")
    assert_close_in_range(played, {"link_position": q, "motor_position_1": a, "motor_velocity_1": da}, 1e-6)


def test_a_rig_in_wrong_units_is_reported() -> None:
    joint = elastic_rig().joint["sea"]
    assert isinstance(joint, ElasticJoint)
    tiny = msgspec.structs.replace(joint, motor=Motor(inertia=1e-12))
    with pytest.raises(SimulationError, match="units"):
        simulate(RigFile(joint={"j": tiny}), {}, 0.1)


def test_a_link_of_a_chain_in_tar() -> None:
    """Damping far faster than a step makes the equations stiff: D q̇ balances what pulls at the link, and q is its integral."""
    rig, damping, period = Rig.preset("vsa2-2r").file, 200.0, 2e-3
    assert rig.chain is not None
    shoulder = rig.joint["shoulder"]
    assert isinstance(shoulder, AntagonisticJoint)
    assert shoulder.link is not None
    link = msgspec.structs.replace(shoulder.link, damping=damping, payload=None)  # the oracle knows of none
    joints = {**rig.joint, "shoulder": msgspec.structs.replace(shoulder, link=link)}
    torques = {"shoulder": {"motor_torque_1": sine(0.02, 0.5)}, "elbow": {"motor_torque_1": sine(0.02, 0.7)}}
    played = simulate(msgspec.structs.replace(rig, joint=joints), torques, 2.0, period=period, ideal=True).joints
    q, dq, ddq = (
        np.stack([played[name].truth[f"link_{what}"] for name in ("shoulder", "elbow")], axis=-1)
        for what in ("position", "velocity", "acceleration")
    )
    spring = played["shoulder"].truth["transmission_torque_total"]
    pull = -spring - inverse_dynamics(rig.chain, q, dq, ddq)[:, 0]
    expected = np.concatenate([[0.0], np.cumsum(0.5 * (pull[1:] + pull[:-1]) * period)]) / damping
    assert np.ptp(expected) > 1e-6
    np.testing.assert_allclose(q[:, 0], expected, atol=1e-3 * float(np.ptp(expected)))


def test_a_weight_that_swings_faster_than_samples_keeps_its_energy() -> None:
    """The steps follow gravity too, not only the springs."""
    joint = ElasticJoint(
        motor=Motor(inertia=1.0),
        transmission=CubicTransmission(stiffness=1e-3, cubic=0.0),
        link=Link(inertia=0.02, gravity_torque=2e4),
    )
    rig = RigFile(joint={"bell": joint})
    start = {"bell": np.array([0.5, 0.0, 0.0, 0.0])}
    truth = simulate(rig, {}, 0.2, ideal=True, start=start).truth
    energy = 0.01 * truth["link_velocity"] ** 2 - 2e4 * np.cos(truth["link_position"])
    assert np.ptp(truth["link_position"]) > 0.9
    assert np.ptp(energy) < 1e-4 * 2e4 * (1.0 - np.cos(0.5))


def test_bristles_at_high_speed_only_take_energy() -> None:
    """A bristle bends the faster the faster it slides: σ₀ |v| / F is 25 000 1/s here, and must not blow up."""
    friction = Friction(coulomb=0.02, presliding_stiffness=50.0)
    joint = ElasticJoint(
        motor=Motor(inertia=0.01, friction=friction),
        transmission=CubicTransmission(stiffness=5.0, cubic=0.0),
        link=Link(inertia=0.02),
    )
    start = {"fast": np.array([0.0, 10.0, 0.0, 10.0])}
    truth = simulate(RigFile(joint={"fast": joint}), {}, 2.0, ideal=True, start=start).truth
    kinetic = 0.01 * truth["link_velocity"] ** 2 + 0.005 * truth["motor_velocity"] ** 2
    energy = kinetic + 2.5 * truth["deflection"] ** 2
    assert np.all(np.diff(energy) <= 1e-9)
    # While it slides forwards, friction is the Coulomb level: the momentum falls evenly.
    momentum = 0.02 * truth["link_velocity"] + 0.01 * truth["motor_velocity"]
    np.testing.assert_allclose(momentum, 0.3 - 0.02 * np.arange(2001) * 1e-3, atol=1e-5)
