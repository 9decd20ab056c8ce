"""Drift: springs that soften while they are recorded, written down here, and springs that do not."""

import numpy as np
import pytest

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import device_of
from vsalog.estimators.folding import run
from vsalog.estimators.methods import direct, residual_rls
from vsalog.perturbations.drift import Drift
from vsalog.perturbations.trials import Subject, run_trials
from vsalog.rig import Rig

PERIOD, STIFFNESS, INERTIA, DAMPING = 2e-3, 40.0, 0.02, 0.2


def drifting(change, seed, seconds=40.0):
    """A linear spring whose stiffness changes evenly by that part, between a motor and a link that are moved at will."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds / PERIOD)) * PERIOD
    theta = 0.5 * np.sin(1.9 * t + rng.uniform(0, 6)) + 0.2 * np.sin(5.3 * t + rng.uniform(0, 6))
    phi = 0.1 * np.sin(2.7 * t + rng.uniform(0, 6)) + 0.05 * np.sin(7.1 * t + rng.uniform(0, 6))
    stiffness = STIFFNESS * (1.0 + change * t / t[-1])
    rate = np.gradient(theta, PERIOD)
    torque = stiffness * phi
    roles = {
        "motor_position": theta + 2e-5 * rng.standard_normal(t.size),
        "link_position": theta + phi + 2e-5 * rng.standard_normal(t.size),
        "torque_sensor": torque + 0.02 * rng.standard_normal(t.size),
        "motor_torque": INERTIA * np.gradient(rate, PERIOD)
        + DAMPING * rate
        - torque
        + 0.02 * rng.standard_normal(t.size),
    }
    stamps = np.round(t * 1e9).astype(np.int64)
    return JointSignals("sea", PERIOD, stamps, t, roles, t == 0.0, np.zeros(t.size, np.int32)), stiffness


def tried(method, signals):
    motor = {"joint.sea.motor.inertia": str(INERTIA), "joint.sea.motor.damping": str(DAMPING)}
    spec = Rig(Rig.preset("sea").file, "sea").with_settings(motor).file.joint["sea"]
    device = device_of("sea", spec, signals.roles)
    subject = Subject(method, device, signals, method.TUNING(), method.build(device, signals, method.TUNING()))
    base = run(subject.fold, signals)
    trials = run_trials(subject, (Drift(),), base)
    return trials, base.trace["1"], trials.widened(base.trace)["1"]


@pytest.mark.parametrize("method", [direct, residual_rls])
@pytest.mark.parametrize("change", [0.03, -0.03, -0.10])
def test_a_spring_that_changes_is_found_with_its_size_and_its_band_contains_the_truth(method, change):
    inside, alone = [], []
    for seed in range(4):
        signals, stiffness = drifting(change, seed)
        trials, before, after = tried(method, signals)
        (finding,) = trials.findings()
        assert (finding.code, finding.part) == ("stiffness.drifts", "1")
        assert finding.value == pytest.approx(abs(change), rel=0.25)
        late = after["excited"] & (signals.time > 0.5 * signals.time[-1])
        off = np.abs(after["stiffness"] - stiffness)[late]
        inside.append(np.mean(off < 1.96 * after["stiffness_std"][late]))
        alone.append(np.mean(off < 1.96 * before["stiffness_std"][late]))
    assert np.mean(inside) > 0.93
    assert np.mean(alone) < 0.5


@pytest.mark.parametrize("method", [direct, residual_rls])
def test_of_a_spring_that_stays_nothing_is_found_and_its_band_stays(method):
    found, ratios = 0, []
    for seed in range(20):
        trials, before, after = tried(method, drifting(0.0, seed, seconds=20.0)[0])
        found += len(trials.findings())
        both = before["excited"] & after["excited"]
        ratios.append(np.median((after["stiffness_std"] / before["stiffness_std"])[both]))
    assert found == 0
    assert np.median(ratios) < 1.3
