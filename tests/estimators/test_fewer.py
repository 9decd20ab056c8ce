"""Samples too few for a motion: what they do to an estimate, told by taking every second one."""

import json

import numpy as np
import pytest
from command_line import vsalog_run
from hypothesis import given
from hypothesis import strategies as st

from vsalog.core.signals import JointSignals
from vsalog.estimators import algebraic, residual_rls
from vsalog.estimators.by_deflection import ByDeflection
from vsalog.estimators.device import device_of
from vsalog.estimators.fewer import Moved, every_second, moved_by_samples, sampling_findings, widened
from vsalog.estimators.folding import estimated
from vsalog.rig import Rig

INERTIA, DAMPING, STIFFNESS, JERK = 0.08, 0.4, 150.0, 40.0


def jerked(rate, seconds=20.0, jolt=0.11, starts=(0,), calm=np.inf):
    """A motor whose acceleration changes its sign at once, every `jolt` seconds, on a linear spring that swings beside it.

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


def traced(method, signals):
    """Return the estimate as the fold alone claims it, and as it is told."""
    own = device(signals)
    fold = method.build(own, signals, method.TUNING())
    alone = estimated(fold, signals)
    return alone, widened(alone, moved_by_samples(method, own, signals, method.TUNING(), fold))


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
def test_what_jerks_bend_is_told(rate, jolt):
    alone, told = traced(residual_rls, jerked(rate, jolt=jolt))
    assert plausible_and_wrong(alone) > 0.15
    assert plausible_and_wrong(told) < 0.05


@pytest.mark.parametrize(("rate", "jolt"), [(100.0, 0.11), (100.0, 0.23), (200.0, 0.11)])
def test_what_is_not_known_of_the_jerks_moments_is_most_of_it_at_some_rates(rate, jolt):
    _, told = traced(residual_rls, jerked(rate, jolt=jolt))
    assert plausible_and_wrong(told) < 0.01


def test_what_is_bent_at_some_deflections_and_long_ago_is_told_of_those():
    """The middle of a log's second half, where the motor rests, knows nothing of it."""
    alone, told = traced(residual_rls, jerked(50.0, jolt=0.23, calm=8.0))
    assert plausible_and_wrong(alone, 0.0) > 0.03
    assert plausible_and_wrong(told, 0.0) < 0.01
    assert told["1"]["excited"].mean() > 0.9 * alone["1"]["excited"].mean()


def test_a_motion_that_is_resolved_is_left_alone():
    signals = jerked(1000.0, jolt=0.23)
    for method in (residual_rls, algebraic):
        own = device(signals)
        fold = method.build(own, signals, method.TUNING())
        moved = moved_by_samples(method, own, signals, method.TUNING(), fold)
        assert moved.shares == {}
        assert moved.tried
        assert sampling_findings(own, moved) == []


@pytest.mark.parametrize(("rate", "enough"), [(50.0, False), (200.0, True)])
def test_where_half_the_samples_cannot_be_tried_that_is_said(rate, enough):
    """A span of 0.15 s has four samples at 25 Hz, of which algebraic makes nothing."""
    signals = jerked(rate, jolt=0.5)
    own = device(signals)
    fold = algebraic.build(own, signals, algebraic.TUNING())
    assert np.any(estimated(fold, signals)["1"]["excited"])
    moved = moved_by_samples(algebraic, own, signals, algebraic.TUNING(), fold)
    assert moved.tried == enough
    assert ([f.code for f in sampling_findings(own, moved)] == ["sampling.untried"]) != enough


@pytest.mark.parametrize(("surely", "told"), [(0.0, False), (0.02, False), (0.05, True)])
def test_what_noise_may_do_is_counted_in_without_a_word(surely, told):
    own = device(jerked(100.0, seconds=1.0))
    moved = Moved({"1": ByDeflection(np.zeros(1), np.array([0.3]))}, {"1": surely})
    found = sampling_findings(own, moved)
    assert [(f.code, f.part, f.value) for f in found] == ([("sampling.too_slow", "1", surely)] if told else [])
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
