"""How many integration steps a machine takes in a sample period, which of them are implicit, and how much memory."""

from types import SimpleNamespace

import numpy as np
import pytest

from vsalog.core.errors import SimulationError
from vsalog.rig import Rig
from vsalog.simulation import replay, run
from vsalog.simulation.machine import build

PERIOD = 1e-3
RK4_STABLE = 2.785  # rate · step beyond which Runge and Kutta's method diverges on the real axis


def machine(stiffness=1.0, damping=0.0, friction="", hysteresis=""):
    """A motor of 1 kg·m² behind a spring, on a link that is much heavier."""
    rig = f"""
[joint.arm]
kind = "elastic"
[joint.arm.motor]
inertia = 1.0
damping = {damping}
{friction}
[joint.arm.transmission]
type = "linear"
stiffness = {stiffness}
{hysteresis}
[joint.arm.link]
inertia = 1000.0
"""
    return build(Rig.from_toml(rig).joints)


@pytest.mark.parametrize(("steps", "stiff"), [(13.0, False), (20.0, True)])
def test_equations_are_stiff_that_need_more_than_sixteen_steps_for_damping(steps, stiff):
    """Of which each settles by 0.3."""
    assert machine(damping=steps * 0.3 / PERIOD).steps(PERIOD)[1] == stiff


@pytest.mark.parametrize(("steps", "refused"), [(1500.0, False), (3000.0, True)])
def test_a_vibration_that_needs_more_than_two_thousand_steps_is_in_other_units(steps, refused):
    """Of which each turns it by 0.02."""
    built = machine(stiffness=(steps * 0.02 / PERIOD) ** 2)
    if not refused:
        assert built.steps(PERIOD)[0] == pytest.approx(steps, abs=2)
        return
    with pytest.raises(SimulationError):
        built.steps(PERIOD)


@pytest.mark.parametrize(
    ("parts", "rate"),
    [
        ({"friction": "[joint.arm.motor.friction]\ncoulomb = 1.0\npresliding_stiffness = 300.0"}, 300.0),
        ({"hysteresis": "[joint.arm.transmission.bouc_wen]\ntorque = 0.01\nwidth = 0.000334"}, 1.0 / 0.000334),
    ],
)
def test_what_has_a_memory_stays_stable_at_five_times_the_speed_that_is_expected(parts, rate):
    """Bristles at 50 rad/s, loops at 5 rad/s; and no more steps are taken than that needs."""
    fast = 50.0 if "friction" in parts else 5.0
    steps, stiff = machine(**parts).steps(PERIOD)
    assert not stiff
    assert 0.3 * RK4_STABLE < fast * rate * PERIOD / steps < RK4_STABLE


def test_what_positions_restart_from_has_a_third_of_their_noise():
    """The middle of a cubic through twenty-one samples: 0.33; through half as many it would have 0.45."""
    noise = np.random.default_rng(0).normal(size=20_000)
    assert np.std(replay._smoothed(noise, PERIOD)[0]) == pytest.approx(0.328, abs=0.03)


@pytest.mark.parametrize(("samples", "joints", "refused"), [(1500, 1, False), (3000, 1, True), (750, 2, False)])
def test_a_megabyte_holds_two_thousand_samples_of_a_joint(monkeypatch, samples, joints, refused):
    monkeypatch.setattr(run, "usable_memory", lambda: 1e6)
    scenario = SimpleNamespace(file=SimpleNamespace(period=PERIOD, duration=samples * PERIOD))
    if refused:
        with pytest.raises(SimulationError, match="memory"):
            run._samples(scenario, joints)
    else:
        assert run._samples(scenario, joints) == samples + 1
