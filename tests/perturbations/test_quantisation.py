"""Encoder resolution: what steps that repeat with the motion, or rest, do to an estimate, found by coarser ones."""

from types import SimpleNamespace

import numpy as np
import pytest

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import device_of
from vsalog.estimators.folding import run
from vsalog.estimators.methods import direct, residual_rls
from vsalog.perturbations.quantisation import Quantisation
from vsalog.perturbations.trials import Subject, run_trials
from vsalog.rig import Rig

pytestmark = pytest.mark.share(3)

PERIOD, STEP, COUNT = 5e-3, 2 * np.pi / 500, 4000
LINEAR, CUBIC = 30.0, 1000.0


def to_and_fro(shifts, step=STEP, noise=0.01):
    """A hardening spring between encoders whose zeros lie anywhere within a step; it swings round two levels, ever alike."""
    t = np.arange(COUNT) * PERIOD
    level = np.tanh(8.0 * np.sin(2 * np.pi * 0.15 * t))
    ringing = 0.25 * np.sin(2 * np.pi * 2.7 * t) * np.exp(-2.0 * ((0.3 * t) % 1.0) / 0.3)
    phi = STEP * (18.4 * level + 10.0 * ringing)
    q = STEP * (72.0 * level + 80.0 * ringing)
    torque = LINEAR * phi + CUBIC * phi**3
    roles = {
        "link_position": step * np.round(q / step + shifts[0]),
        "motor_position": step * np.round((q - phi) / step + shifts[1]),
        "torque_sensor": torque + noise * np.random.default_rng(1).standard_normal(COUNT),
    }
    starts = np.arange(COUNT) == 0
    stamps = np.arange(COUNT, dtype=np.int64) * int(PERIOD * 1e9)
    steps = {"link_position": step, "motor_position": step}
    return JointSignals("sea", PERIOD, stamps, t, roles, starts, np.zeros(COUNT, np.int32), resolution=steps)


def subject_of(signals, method=direct, **tuned):
    device, tuning = device_of("sea", Rig.preset("sea").file.joint["sea"], signals.roles), method.TUNING(**tuned)
    return Subject(method, device, signals, tuning, method.build(device, signals, tuning))


def estimates(subject):
    """Return the columns with the trials counted in, and those without."""
    base = run(subject.fold, subject.signals)
    return run_trials(subject, (Quantisation(),), base).widened(base.trace)["1"], base.trace["1"]


def test_what_repeats_with_the_motion_is_in_the_deviations():
    """Encoders that differ by their zeros alone; they count where the estimate is supported without the trial."""
    scores = []
    for k in range(12):
        subject = subject_of(to_and_fro((k / 12, (5 * k % 12) / 12)))
        told, untried = estimates(subject)
        sure = untried["excited"] & (np.arange(COUNT) > COUNT // 2)
        if sure.any():
            off = told["stiffness"] - (LINEAR + 3.0 * CUBIC * told["deflection"] ** 2)
            scores.append([np.sqrt(np.median((off / c["stiffness_std"])[sure] ** 2)) for c in (told, untried)])
    told, untried = np.array(scores).T
    assert told.size >= 8
    assert np.mean(told < 1.5) > 0.9
    # By residuals alone it is not, else the trial would not be needed.
    assert np.mean(untried < 1.5) < 0.5


@pytest.mark.parametrize(("step", "least", "most"), [(STEP, 0.05, 1.0), (STEP / 4, 0.01, 0.05), (STEP / 100, 0.0, 0.0)])
def test_finer_steps_move_less(step, least, most):
    shifts = run_trials(subject_of(to_and_fro((0.0, 0.4), step)), (Quantisation(),)).shifts
    assert least <= max([np.median(shift.spreads["1"].share) for shift in shifts.values()], default=0.0) <= most


def test_sensors_without_steps_are_not_tried():
    signals = to_and_fro((0.0, 0.4), 1e-9)
    rng = np.random.default_rng(0)
    for role in ("link_position", "motor_position"):
        signals.roles[role][:] += 1e-5 * rng.standard_normal(COUNT)
    assert run_trials(subject_of(signals), (Quantisation(),)).shifts == {}


def test_the_model_is_as_uncertain_as_its_trace():
    """The stiffness at the ends of the motion, from the covariance of the coefficients."""
    subject = subject_of(to_and_fro((0.0, 0.4)))
    base = run(subject.fold, subject.signals)
    trials = run_trials(subject, (Quantisation(),), base)
    before, after = (
        m.transmission[0]
        for m in (subject.fold.model(base.state), trials.widened_model(subject.fold.model(base.state)))
    )
    slopes = subject.device.basis.rows(np.array([0.2]), None, 1)[0, 1]
    deviations = [np.sqrt(slopes @ np.array(part.covariance) @ slopes) for part in (before, after)]
    stiffness = slopes @ np.array(before.coefficients)
    shift = next(iter(trials.shifts.values())).spreads["1"].at(np.array([0.2]))[0]
    assert deviations[1] == pytest.approx(np.hypot(deviations[0], shift * stiffness), rel=0.5)


REST_STEP, STIFFNESS, INERTIA, DAMPING = 0.01, 40.0, 0.02, 0.2


def from_rest_to_rest(seed):
    """A linear spring between coarse encoders that moves from rest to rest; written here: nothing of it is the product's."""
    rng, rest, move = np.random.default_rng(seed), 300, 40
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, move + 1) / move)
    theta, q = [np.full(rest, rng.uniform(-0.02, 0.02))], [np.full(rest, rng.uniform(-0.02, 0.02))]
    for k in range(8):
        for x, size in ((theta, 0.03), (q, 0.12)):
            goal = (-1) ** k * size * rng.uniform(0.5, 1.0)
            x.append(x[-1][-1] + (goal - x[-1][-1]) * ramp)
            x.append(np.full(rest, goal))
    theta, q = np.concatenate(theta), np.concatenate(q)
    n, torque = theta.size, STIFFNESS * (q - theta)
    motor = INERTIA * np.gradient(np.gradient(theta, PERIOD), PERIOD) + DAMPING * np.gradient(theta, PERIOD) - torque
    roles = {
        "link_position": REST_STEP * np.round(q / REST_STEP),
        "motor_position": REST_STEP * np.round(theta / REST_STEP),
        "torque_sensor": torque + rng.normal(0.0, 0.01, n),
        "motor_torque": motor + rng.normal(0.0, 0.01, n),
    }
    starts = np.zeros(n, dtype=np.bool_)
    starts[0] = True
    stamps = np.arange(n, dtype=np.int64) * int(PERIOD * 1e9)
    steps = {"link_position": REST_STEP, "motor_position": REST_STEP}
    return JointSignals(
        "sea", PERIOD, stamps, np.arange(n) * PERIOD, roles, starts, np.zeros(n, np.int32), resolution=steps
    )


@pytest.mark.every(2)
@pytest.mark.parametrize("method", ["SENSOR", "RESIDUAL"])
def test_a_spring_between_rests_is_known_as_well_as_its_encoders_tell(method):
    """Sixty logs: the stiffness at the deflections it was seen at is in its band; by residuals alone half of it does not."""
    scores = []
    for seed in range(60):
        column, _ = estimates(subject_of(from_rest_to_rest(seed), residual_rls, modality=method))
        late = slice(len(column["stiffness"]) // 2, None, 50)
        seen = (np.abs(column["deflection"][late]) > 0.03) & np.isfinite(column["stiffness_std"][late])
        scores.append(((column["stiffness"] - STIFFNESS) / column["stiffness_std"])[late][seen])
    z = np.concatenate(scores)
    assert z.size > 500
    assert np.mean(np.abs(z) < 1.96) > 0.9
    # And it is not hidden behind bands that nothing could leave.
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.1


def test_a_trial_s_steps_are_three_times_as_large():
    """In one of three places."""
    (trial, *_) = Quantisation().trials(subject_of(to_and_fro((0.0, 0.4))))
    for role in ("link_position", "motor_position"):
        apart = np.diff(np.unique(trial.signals.roles[role])) / STEP
        assert apart[apart > 0.1].min() == pytest.approx(3.0)


@pytest.mark.parametrize(("steps", "tried"), [(200, True), (450, False)])
def test_a_deflection_of_more_than_three_hundred_steps_is_not_tried(steps, tried):
    signals = to_and_fro((0.0, 0.4))
    signals.roles["motor_position"][:] = 0.0
    signals.roles["link_position"][:] = STEP * np.round(np.linspace(0.0, steps, COUNT))
    subject = SimpleNamespace(signals=signals, device=subject_of(signals).device, fold=None)
    assert (Quantisation().trials(subject) is not None) == tried
