"""Sampling rate: what samples too few for a motion do to an estimate, found by taking every second one."""

import json

import numpy as np
import pytest
from command_line import vsalog_run
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import device_of
from vsalog.estimators.equation import REPORTED_CHANGE
from vsalog.estimators.folding import estimated, run
from vsalog.estimators.methods import algebraic, qr_rls, residual_rls
from vsalog.perturbations.sampling_rate import SamplingRate, every_second
from vsalog.perturbations.trials import Shift, Subject, run_trials, tried
from vsalog.rig import Rig
from vsalog.uncertainty.shift import Ranges, Spread

pytestmark = pytest.mark.share(3)

INERTIA, DAMPING, STIFFNESS, JERK = 0.08, 0.4, 150.0, 40.0


def jerked(rate, seconds=20.0, jolt=0.11, starts=(0,), calm=np.inf):
    """A motor whose acceleration changes its sign at once, every `jolt` seconds, on a linear spring that swings next to it.

    In closed form: the torque is what the motor's equation of motion leaves for it, sampled where it stands. From when it last
    turns before `calm` the motor rests where it is.
    """
    t = np.arange(round(seconds * rate)) / rate
    rests = 2.0 * jolt * np.floor(0.5 * calm / jolt) + 0.5 * jolt
    moves = t < rests
    phase = np.minimum(t, rests) / jolt
    half, into = np.floor(phase), (phase - np.floor(phase)) * jolt
    sign = np.where(half % 2 == 0, 1.0, -1.0)
    acceleration = JERK * sign * moves
    speed = JERK * (sign * into + np.where(sign > 0, 0.0, jolt) - jolt / 2) * moves
    angle = JERK * np.where(sign > 0, into * (into - jolt) / 2, -into * (into - jolt) / 2)
    phi = 0.02 * np.sin(2 * np.pi * 1.3 * t) + 0.3 * angle
    torque = INERTIA * acceleration + DAMPING * speed - STIFFNESS * phi
    rng = np.random.default_rng(1)
    roles = {
        "motor_position": angle + 1e-6 * rng.standard_normal(t.size),
        "link_position": angle + phi + 1e-6 * rng.standard_normal(t.size),
        "motor_torque": torque + 0.01 * rng.standard_normal(t.size),
    }
    begins = np.isin(np.arange(t.size), starts)
    stamps = np.round(t * 1e9).astype(np.int64)
    return JointSignals("sea", 1.0 / rate, stamps, t, roles, begins, np.zeros(t.size, np.int32))


def device(signals):
    return device_of("sea", Rig.preset("sea").file.joint["sea"], signals.roles)


def subject_of(method, signals):
    own = device(signals)
    return Subject(method, own, signals, method.TUNING(), method.build(own, signals, method.TUNING()))


def traced(method, signals):
    """Return the estimate as the fold alone claims it, and as it is reported."""
    subject = subject_of(method, signals)
    base = run(subject.fold, signals)
    return base.trace, run_trials(subject, (SamplingRate(),), base).widened(base.trace)


def plausible_and_wrong(trace, begin=0.5):
    """Return of how much of what is supported the stiffness is off by 3 % and by three deviations, after that part of the log."""
    columns = trace["1"]
    off = np.abs(columns["stiffness"] - STIFFNESS)
    sure = columns["excited"].copy()
    sure[: int(begin * sure.size)] = False
    assert sure.any()
    return float(np.mean((off > 0.03 * STIFFNESS)[sure] & (off > 3.0 * columns["stiffness_std"])[sure]))


def test_the_log_is_what_a_motor_does():
    signals = jerked(20_000.0, seconds=2.0)
    angle, t = signals.roles["motor_position"], signals.time
    smooth = np.convolve(angle, np.ones(41) / 41, "same")
    speed = np.gradient(smooth, t)
    assert np.abs(speed[100:-100]).max() == pytest.approx(JERK * 0.11 / 2, rel=0.05)


@pytest.mark.parametrize(("rate", "jolt"), [(50.0, 0.23), (50.0, 0.29), (400.0, 0.11), (500.0, 0.11)])
def test_what_jerks_bend_is_reported(rate, jolt):
    alone, told = traced(residual_rls, jerked(rate, jolt=jolt))
    assert plausible_and_wrong(alone) > 0.15
    assert plausible_and_wrong(told) < 0.05


@pytest.mark.parametrize(("rate", "jolt"), [(100.0, 0.11), (100.0, 0.23), (200.0, 0.11)])
def test_what_is_not_known_of_the_jerks_moments_is_most_of_it_at_some_rates(rate, jolt):
    _, told = traced(residual_rls, jerked(rate, jolt=jolt))
    assert plausible_and_wrong(told) < 0.01


def test_what_is_bent_at_some_deflections_and_long_ago_is_reported_of_those():
    """The middle of a log's second half, where the motor rests, knows nothing of it."""
    alone, told = traced(residual_rls, jerked(50.0, jolt=0.23, calm=8.0))
    assert plausible_and_wrong(alone, 0.0) > 0.03
    assert plausible_and_wrong(told, 0.0) < 0.01
    assert told["1"]["excited"].mean() > 0.9 * alone["1"]["excited"].mean()


def test_a_motion_that_is_resolved_is_left_alone():
    signals = jerked(1000.0, jolt=0.23)
    for method in (residual_rls, algebraic):
        trials = run_trials(subject_of(method, signals), (SamplingRate(),))
        (shift,) = trials.shifts.values()
        assert max([spread.most for spread in shift.spreads.values()], default=0.0) < 0.01
        assert trials.findings() == []


@pytest.mark.parametrize(("rate", "enough"), [(50.0, False), (200.0, True)])
def test_where_half_the_samples_cannot_be_tried_that_is_reported(rate, enough):
    """A span of 0.15 s has four samples at 25 Hz, of which algebraic makes nothing."""
    signals = jerked(rate, jolt=0.5)
    subject = subject_of(algebraic, signals)
    assert np.any(estimated(subject.fold, signals)["1"]["excited"])
    codes = [finding.code for finding in run_trials(subject, (SamplingRate(),)).findings()]
    assert ("sampling.untried" in codes) != enough


@pytest.mark.parametrize(("surely", "told"), [(0.0, False), (0.02, False), (0.05, True)])
def test_what_noise_may_do_is_counted_in_without_a_word(surely, told):
    subject = subject_of(residual_rls, jerked(100.0, seconds=5.0))
    shift = Shift({"1": Spread((Ranges(0.0, 0.0),), np.array([0.3]))}, {"1": surely}, {}, {}, {}, True)
    found = SamplingRate().findings(subject, shift)
    assert [(f.code, f.part, f.value) for f in found] == ([("sampling.too_slow", "1", surely)] if told else [])
    assert (surely > REPORTED_CHANGE) == told
    assert not told or found[0].evidence["stiffness_change"] == 0.3


@given(st.integers(2, 60), st.sets(st.integers(1, 59), max_size=5), st.integers(0, 1))
def test_every_second_sample(count, gaps, first):
    signals = jerked(100.0, seconds=count / 100.0, starts=(0, *gaps))
    half = every_second(signals, first)
    assert half.period == 2.0 * signals.period
    assert np.array_equal(half.stamps, signals.stamps[first::2])
    runs, kept = np.cumsum(signals.starts), np.arange(len(signals))[first::2]
    # A run begins with whatever is kept first of it.
    begins = np.diff(runs[kept], prepend=-1) != 0
    assert half.starts.tolist() == begins.tolist()


def test_the_command_says_so(tmp_path):
    signals = jerked(100.0, jolt=0.23)
    names = list(signals.roles)
    table = np.column_stack([signals.time, *signals.roles.values()])
    np.savetxt(tmp_path / "jerked.csv", table, "%.9g", ",", header=",".join(["time", *names]), comments="")
    channels = "\n".join(f'{name} = "{name}"' for name in names)
    (tmp_path / "rig.toml").write_text(
        f'[joint.elbow]\nkind = "elastic"\n[joint.elbow.motor]\ninertia = {INERTIA}\ndamping = {DAMPING}\n'
        f"[joint.elbow.signals]\n{channels}\n"
    )
    done = vsalog_run("estimate", "jerked.csv", "--rig", "rig.toml", "--json", cwd=tmp_path)
    assert done.returncode == 0
    assert "sampling.too_slow" in [finding["code"] for finding in json.loads(done.stdout)["joints"][0]["findings"]]


LINK, LINK_DAMPING = 0.1, 0.15
T, COUNT, HALF_PERIOD, LEVEL = 0.01, 1200, 1.7, 3.0


def switched(seed, inertia, damping):
    """A linear joint under a torque that is switched at moments of its own, solved in closed form from switch to switch."""
    rng = np.random.default_rng(seed)
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-STIFFNESS / inertia, -damping / inertia, STIFFNESS / inertia, 0.0, 1.0 / inertia],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [STIFFNESS / LINK, 0.0, -STIFFNESS / LINK, -LINK_DAMPING / LINK, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    whole, first = expm(A * T), rng.uniform(0.3, HALF_PERIOD)
    moments, state, states = first + HALF_PERIOD * np.arange(10), np.array([0.0, 0.0, 0.0, 0.0, LEVEL]), []
    for k in range(COUNT):
        states.append(state)
        within = moments[(moments > k * T) & (moments <= (k + 1) * T)]
        if within.size == 0:
            state = whole @ state
        else:
            into = within[0] - k * T
            state = expm(A * into) @ state
            state[4] = -state[4]
            state = expm(A * (T - into)) @ state
    theta, _, link, _, torque = np.array(states).T
    roles = {
        "motor_position": theta + 1e-6 * rng.standard_normal(COUNT),
        "link_position": link + 1e-6 * rng.standard_normal(COUNT),
        "motor_torque": torque + 0.01 * rng.standard_normal(COUNT),
    }
    t = T * np.arange(COUNT)
    return JointSignals(
        "sea", T, np.round(t * 1e9).astype(np.int64), t, roles, np.arange(COUNT) == 0, np.zeros(COUNT, np.int32)
    )


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("method", "inertia", "damping"), [(qr_rls, 0.06, 2.0), (algebraic, 0.08, 0.4), (residual_rls, 0.06, 4.0)]
)
def test_how_far_the_moments_bend_a_stiffness_is_in_its_deviation(method, inertia, damping):
    """Over forty phases the stiffness is off by some per cent, and hardly more than is claimed."""
    motor = {"joint.sea.motor.inertia": str(inertia), "joint.sea.motor.damping": str(damping)}
    spec = Rig(Rig.preset("sea").file, "sea").with_settings(motor).file.joint["sea"]
    off, claimed = [], []
    for seed in range(40):
        signals = switched(seed, inertia, damping)
        device = device_of("sea", spec, signals.roles)
        subject = Subject(method, device, signals, method.TUNING(), method.build(device, signals, method.TUNING()))
        columns = tried(subject, (SamplingRate(),))["1"]
        last = np.flatnonzero(columns["excited"])[-1:]
        off += list(columns["stiffness"][last] / STIFFNESS - 1.0)
        claimed += list(columns["stiffness_std"][last] / STIFFNESS)
    off, deviations = np.array(off), np.array(off) / np.array(claimed)
    assert off.size > 30
    assert np.std(off) > 0.01
    assert np.sqrt(np.mean(deviations**2)) < 1.5
