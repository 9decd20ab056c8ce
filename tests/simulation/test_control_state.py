"""State feedback with feed-forward: eigenvalues, inverse dynamics, and an elastic joint in the loop, compared with scipy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vsalog.core.errors import SimulationError
from vsalog.estimation.live import LiveEstimate
from vsalog.rig import Rig
from vsalog.simulation.control_state import gains, planned
from vsalog.simulation.inputs import rest_to_rest
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

B, DM, K, D, M, DQ, G = 0.5, 0.8, 400.0, 0.6, 0.7, 0.3, 6.0
RIG = f"""
[joint.arm]
kind = "elastic"
[joint.arm.motor]
inertia = {B}
damping = {DM}
[joint.arm.transmission]
type = "linear"
stiffness = {K}
damping = {D}
[joint.arm.link]
inertia = {M}
damping = {DQ}
gravity_torque = {G}
[joint.arm.signals]
motor_position = {{ channel = "motor.data", resolution = "1e-6 rad" }}
motor_torque = {{ channel = "torque.data", noise = "0.01 N*m" }}
link_acceleration = {{ channel = "acceleration.data", noise = "0.05 rad/s^2" }}
"""
SCENARIO = """
duration = "2 s"
[joint.arm.state_feedback]
frequency = "25 rad/s"
feedback = "FEEDBACK"
[[joint.arm.state_feedback.reference]]
type = "rest_to_rest"
amplitude = "20 deg"
start = "0.2 s"
rise = "0.4 s"
"""
TIME = np.arange(1001) * 1e-3


def joint():
    return Rig.from_toml(RIG).joints["arm"]


def linear(k):
    """The joint without gravity under τ = −k x, x = (θ, q, θ̇, q̇)."""
    rows = [[0, 0, 1, 0], [0, 0, 0, 1], [-K / B, K / B, -(D + DM) / B, D / B], [K / M, -K / M, D / M, -(D + DQ) / M]]
    return np.array(rows, dtype=float) - np.outer([0, 0, 1 / B, 0], k)


@pytest.mark.parametrize(("frequency", "damping"), [(25.0, 0.7), (12.0, 0.4), (60.0, 0.9)])
def test_the_slowest_eigenvalues_are_those_asked_for(frequency, damping):
    found = np.linalg.eigvals(linear(gains(joint(), M, frequency, damping)))
    slowest = found[np.argsort(np.abs(found))][:2]
    assert np.abs(slowest) == pytest.approx(frequency, rel=1e-6)
    assert -slowest.real / np.abs(slowest) == pytest.approx(damping, rel=1e-6)
    assert (found.real < 0.0).all()


def test_the_feed_forward_moves_the_joint_as_planned():
    """scipy simulates the torque to a joint whose equations stand here."""
    q = rest_to_rest(0.4, 0.5, 0.2)(TIME)
    fine = np.linspace(0.0, 1.0, 20001)
    dq = np.gradient(rest_to_rest(0.4, 0.5, 0.2)(fine), fine)
    ddq = np.interp(TIME, fine, np.gradient(dq, fine))
    plan = planned(joint(), q, M * ddq + DQ * np.interp(TIME, fine, dq) + G * np.sin(q), TIME)

    def rate(t, x):
        theta, q, dtheta, dq = x
        spring = K * (q - theta) + D * (dq - dtheta)
        tau = np.interp(t, TIME, plan.torque)
        return [dtheta, dq, (tau + spring - DM * dtheta) / B, (-spring - DQ * dq - G * np.sin(q)) / M]

    found = solve_ivp(rate, (0.0, 1.0), plan.states[0], "DOP853", TIME, rtol=1e-10, atol=1e-12, max_step=1e-3).y
    assert np.max(np.abs(found[:2].T - plan.states[:, :2])) < 2e-5 * 0.4


def played(feedback, stiffness=K, **options):
    rig = Rig.from_toml(RIG)
    scenario = Scenario.from_toml(SCENARIO.replace("FEEDBACK", feedback))
    actual = rig.with_settings({"joint.arm.transmission.stiffness": str(stiffness)})
    inputs = {
        "arm": {"external_torque": lambda t: 40.0 * np.where((t > 1.0) & (t < 1.05), np.sin(np.pi * (t - 1) / 0.05), 0)}
    }
    return simulate(
        actual.file,
        inputs,
        2.0,
        controllers=scenario.controllers(rig.file),
        estimator=LiveEstimate,
        believed=rig.file,
        **options,
    )


def test_the_observers_state_damps_what_the_motors_alone_does_not():
    """De Luca 2007, Figs. 5 and 6, on a spring a fifth softer than the controller believes; somebody knocks on the link."""
    rest = {}
    for feedback in ("truth", "acceleration-observer", "motor"):
        q = np.degrees(played(feedback, 0.8 * K).truth["link_position"]) - 20.0
        late = q[1250:] - q[-100:].mean()
        rest[feedback] = np.sqrt(np.mean(late**2))
    assert rest["acceleration-observer"] < 2.0 * rest["truth"]
    assert rest["motor"] > 3.0 * rest["acceleration-observer"]


@pytest.mark.parametrize("feedback", ["truth", "acceleration-observer"])
def test_a_drive_that_makes_less_of_its_command_is_told_more(feedback):
    """The rig says that four fifths of what is commanded acts, and a constant next to it."""
    rig = Rig.from_toml(RIG.replace(f"damping = {DM}\n", f"damping = {DM}\ntorque_gain = 0.8\ntorque_offset = 0.5\n"))
    scenario = Scenario.from_toml(SCENARIO.replace("FEEDBACK", feedback))
    done = simulate(rig.file, {}, 1.2, controllers=scenario.controllers(rig.file), estimator=LiveEstimate)
    assert np.degrees(done.truth["link_position"][1000:]) == pytest.approx(20.0, abs=0.05)
    # Against gravity at the end: G sin q acts.
    asked = done.truth["motor_torque"][-1]
    assert 0.8 * asked + 0.5 == pytest.approx(G * np.sin(np.radians(20.0)), abs=0.05)


def test_the_controller_reads_what_the_log_records(monkeypatch):
    from vsalog.simulation.control_state import StateLoop

    seen, act = [], StateLoop.act

    def watched(self, k, said, truth):
        seen.append(dict(said["arm"]))
        act(self, k, said, truth)

    monkeypatch.setattr(StateLoop, "act", watched)
    recorded = played("acceleration-observer", seed=3).measured
    for role in ("motor_position", "motor_torque", "link_acceleration"):
        np.testing.assert_array_equal([s[role] for s in seen], recorded[role][: len(seen)])
    assert len(seen) == recorded["motor_position"].size - 1


def refused(change, feedback="truth"):
    rig = Rig.from_toml(change(RIG))
    scenario = Scenario.from_toml(SCENARIO.replace("FEEDBACK", feedback))
    with pytest.raises(SimulationError) as error:
        simulate(rig.file, {}, 0.1, controllers=scenario.controllers(rig.file), estimator=LiveEstimate)
    return str(error.value)


def test_what_cannot_be_controlled_is_refused():
    assert "linear transmission" in refused(lambda r: r.replace('"linear"', '"cubic"\ncubic = 1.0'))
    assert "motor's inertia" in refused(lambda r: r.replace(f"inertia = {B}\n", ""))
    assert "which is late" in refused(
        lambda r: r.replace('"1e-6 rad" }', '"1e-6 rad", delay = "2 ms" }'), "acceleration-observer"
    )
    twice = SCENARIO.replace("FEEDBACK", "truth") + '[[joint.arm.motor_torque]]\ntype = "constant"\nvalue = 1.0\n'
    with pytest.raises(SimulationError, match="drives the same motor"):
        Scenario.from_toml(twice)


def test_the_other_two_eigenvalues_are_half_as_fast_again():
    """Where the joint's own vibration, 37 rad/s, is slower."""
    found = np.sort(np.abs(np.linalg.eigvals(linear(gains(joint(), M, 60.0, 0.7)))))
    assert found == pytest.approx([60.0, 60.0, 90.0, 90.0], rel=1e-6)
