"""Stiffness control: what the feed-forward finds, what the loop on an estimate removes, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed
from scipy.optimize import fsolve

from vsalog.binding.joint import bind
from vsalog.core.errors import EstimatorError, RigError, SimulationError
from vsalog.estimation.joint import choose
from vsalog.estimation.live import LiveEstimate
from vsalog.estimators.device import device_of
from vsalog.estimators.folding import run
from vsalog.rig import Rig
from vsalog.rig.schema import LinearTransmission, UnknownTransmission
from vsalog.simulation.control_stiffness import StiffnessLoop
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

SCENARIO = """
duration = "SECONDS s"
period = "5 ms"
[joint.NAME.stiffness_control]
feedback = "FEEDBACK"
frequency = "25 rad/s"
bandwidth = "4 rad/s"
[[joint.NAME.stiffness_control.position]]
type = "POSITION"
[[joint.NAME.stiffness_control.stiffness]]
STIFFNESS
"""
SWING = 'sine"\namplitude = "20 deg"\nfrequency = "0.5 Hz'
HELD = 'constant"\nvalue = "25 deg'
SOFTER = {
    "vsa2": {f"joint.vsa2.transmission_{i}.stiffness": "0.4 N*m/rad" for i in (1, 2)},
    "qbmove": {f"joint.qbmove.transmission_{i}.stiffness": "0.12 N*m/rad" for i in (1, 2)},
    "awas": {"joint.awas.transmission.spring_stiffness": "11376 N/m"},
}


def constant(value):
    return f'type = "constant"\nvalue = "{value}"'


def scenario(name, feedback, stiffness, position=HELD, seconds=2.5):
    text = SCENARIO.replace("NAME", name).replace("FEEDBACK", feedback).replace("POSITION", position)
    return Scenario.from_toml(text.replace("STIFFNESS", stiffness).replace("SECONDS", str(seconds)))


def played(name, asked, actual=None, **options):
    """The controller knows the preset; the machine is another one."""
    rig = Rig.preset(name)
    machine = rig if actual is None else rig.with_settings(actual)
    done = simulate(
        machine.file, asked.inputs(rig.file), asked.file.duration, period=asked.file.period, believed=rig.file,
        controllers=asked.controllers(rig.file), estimator=LiveEstimate, **options,
    )  # fmt: skip
    return done.time, done.joints[name].truth


def stiffness_of(truth):
    return truth.get("stiffness_total", truth.get("stiffness"))


@pytest.mark.parametrize(("name", "wanted"), [("vsa2", 0.5), ("qbmove", 1.4), ("awas", 150.0)])
def test_the_feed_forward_sets_stiffness_and_position_where_the_rig_is_right(name, wanted):
    """The link is held at 25°, where gravity pulls it; the residual is the motors' friction: none."""
    _, truth = played(name, scenario(name, "none", constant(f"{wanted} N·m/rad"), seconds=4.0), ideal=True)
    assert stiffness_of(truth)[-1] == pytest.approx(wanted, rel=2e-3)
    assert np.degrees(truth["link_position"][-1]) == pytest.approx(25.0, abs=0.1)


def test_the_motors_are_where_the_springs_equations_say():
    """Both equations of the qbmove, torque and stiffness, by scipy's solver with its data sheet's springs."""

    def off(x):
        first, second = (np.radians(25.0) - theta for theta in x)
        torque = 0.0222 * np.sinh(6.7328 * first) + 0.0216 * np.sinh(6.9602 * second) + 0.3 * np.sin(np.radians(25.0))
        sigma = 0.0222 * 6.7328 * np.cosh(6.7328 * first) + 0.0216 * 6.9602 * np.cosh(6.9602 * second)
        return torque, sigma - 1.4

    _, truth = played("qbmove", scenario("qbmove", "none", constant("1.4 N·m/rad"), seconds=4.0), ideal=True)
    expected = fsolve(off, [0.8, 0.1], xtol=1e-12)
    assert [truth[f"motor_position_{i}"][-1] for i in (1, 2)] == pytest.approx(expected, abs=2e-3)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("name", "feedback", "wanted", "within"),
    [("vsa2", "direct", 0.5, 0.015), ("vsa2", "residual-rls", 0.5, 0.03), ("qbmove", "direct", 1.4, 0.03)],
)
def test_the_loop_removes_what_a_wrong_spring_leaves(name, feedback, wanted, within):
    """The springs are 20 % softer than the rig states: the feed-forward is wrong by as much, the loop by what the estimate is."""
    errors = {}
    for by in ("none", feedback):
        time, truth = played(name, scenario(name, by, constant(f"{wanted} N·m/rad"), SWING, 4.0), SOFTER[name])
        late = time > 2.0  # the last period of the swing
        errors[by] = abs(np.mean(stiffness_of(truth)[late]) / wanted - 1.0)
    assert errors["none"] > 0.15
    assert errors[feedback] < within


def test_a_serial_joint_follows_a_reference_that_moves():
    """A push keeps the spring of the AwAS excited, whose position loop holds it nearly still."""
    moving = 'type = "sine"\noffset = "150 N·m/rad"\namplitude = "40 N·m/rad"\nfrequency = "0.25 Hz"'
    push = """
[joint.awas.external_torque]
type = "sine"
amplitude = "4 N·m"
frequency = "0.7 Hz"
"""
    asked = scenario("awas", "direct", moving + push, SWING, 5.0)
    time, truth = played("awas", asked, SOFTER["awas"])
    rig = Rig.preset("awas").file
    # The secondary motor's loop lags as its own equation says.
    arriving = StiffnessLoop(rig, "awas", replace(asked.controllers(rig)["awas"], feedback="none"), time).arriving
    late = time > 3.0
    assert np.max(np.abs(truth["stiffness"][late] / arriving[late] - 1.0)) < 0.05


def test_the_reference_arrives_as_a_critically_damped_loop_lets_it():
    """B = 7.3e-3, D = 1e-3 at 25 rad/s: a double pole, whose answer to a step is 1 − (1 + ω t) exp −ω t."""
    asked = scenario("vsa2", "none", 'type = "steps"\ntimes = ["0 s", "1 s"]\nvalues = ["0.4 N·m/rad", "0.5 N·m/rad"]')
    rig, time = Rig.preset("vsa2").file, np.arange(501) * 5e-3
    loop = StiffnessLoop(rig, "vsa2", asked.controllers(rig)["vsa2"], time)
    pole = 25.0 * np.sqrt(1.0 + 1e-3 / (7.3e-3 * 25.0))
    t = np.maximum(time - 1.0, 0.0)
    assert loop.arriving == pytest.approx(0.4 + 0.1 * (1.0 - (1.0 + pole * t) * np.exp(-pole * t)), abs=1e-9)


def test_what_the_motors_cannot_reach_is_not_summed_up():
    """Of the softer springs 275 N·m/rad is beyond the lever's end; back at 150 the loop need not unwind first."""
    wanted = 'type = "steps"\ntimes = ["0 s", "2.5 s"]\nvalues = ["275 N·m/rad", "150 N·m/rad"]\nrise = "0.2 s"'
    time, truth = played("awas", scenario("awas", "truth", wanted, seconds=5.0), SOFTER["awas"])
    sigma = truth["stiffness"]
    assert sigma[time < 2.5].max() == pytest.approx(0.8 * 2.0 * 14220.0 * 0.1**2, rel=1e-3)
    assert sigma[time > 4.0] == pytest.approx(150.0, rel=0.02)


@pytest.mark.parametrize("name", ["vsa2", "awas"])
def test_a_live_estimate_is_what_the_log_gives(name):
    """Sample by sample as from the whole log; the lever makes a set-point's angle a length in both."""
    rig = Rig.preset(name).file
    asked = Scenario.find(f"{name}-exp1", rig).lasting(1.5, 5e-3)
    done = simulate(rig, asked.inputs(rig), 1.5, period=5e-3)
    recording, joint = done.recording(), rig.joint[name]
    choice = choose(name, joint, "direct", {"filter": "kinematic"}, rig)
    signals = bind([recording], name, joint, choice.roles)
    whole = run(choice.method.build(device_of(name, joint, signals.roles, rig), signals, choice.tuning), signals).trace
    live = LiveEstimate(rig, name, "direct", {"filter": "kinematic"})
    live.prepare(recording)
    measured = done.joints[name].measured
    found = [
        live.take(k, {name: {role: float(measured[role][k]) for role in live.reads[name]}})
        for k in range(done.time.size)
    ]
    for column in ("deflection", "stiffness", "stiffness_std"):
        assert [row[column] for row in found] == pytest.approx(whole["total"][column], rel=1e-6, nan_ok=True), column


def refused(rig, asked, error=SimulationError):
    with pytest.raises(error) as caught:
        simulate(rig.file, {}, 0.1, period=5e-3, controllers=asked.controllers(rig.file), estimator=LiveEstimate)
    return str(caught.value)


def test_what_cannot_be_controlled_is_refused():
    vsa2, stiff = Rig.preset("vsa2"), constant("0.5 N·m/rad")
    with pytest.raises(SimulationError, match=r"joint\.sea\.stiffness_control"):
        scenario("sea", "none", stiff).controllers(Rig.preset("sea").file)
    spring = LinearTransmission(stiffness=0.5)
    joint = changed(vsa2.joints["vsa2"], transmission_1=spring, transmission_2=spring)
    linear = vsa2.with_joints({"vsa2": joint})
    assert "0.5" in refused(linear, scenario("vsa2", "none", stiff))
    assert "above zero" in refused(vsa2, scenario("vsa2", "none", constant("-1 N·m/rad")))
    assert "0.1" in refused(vsa2, scenario("vsa2", "none", constant("0.1 N·m/rad")))
    assert "direkt" in refused(vsa2, scenario("vsa2", "direkt", stiff), EstimatorError)
    assert "batch-ls" in refused(vsa2, scenario("vsa2", "batch-ls", stiff), EstimatorError)
    unknown = vsa2.with_joints({"vsa2": changed(joint, transmission_1=UnknownTransmission())})
    refused(unknown, scenario("vsa2", "none", stiff), RigError)


def test_a_reference_that_begins_below_the_softest_is_followed_later():
    """It rises from zero, as steps with a rise do; unloaded and at rest the VSA-II has 0.32 N·m/rad."""
    rising = 'type = "steps"\ntimes = ["0 s"]\nvalues = ["0.5 N·m/rad"]\nrise = "0.5 s"'
    _, truth = played("vsa2", scenario("vsa2", "truth", rising, seconds=3.0), SOFTER["vsa2"], ideal=True)
    assert stiffness_of(truth)[-1] == pytest.approx(0.5, rel=5e-3)
