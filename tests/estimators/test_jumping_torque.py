"""A motor's torque that is switched between two samples: when, no sample tells, and bands count that in."""

import numpy as np
import pytest
from scipy.linalg import expm

from vsalog.core.signals import JointSignals
from vsalog.estimators import algebraic, qr_rls, residual_rls
from vsalog.estimators.device import device_of
from vsalog.estimators.folding import estimated
from vsalog.estimators.jumps import jumped_block, jumps, jumps_start
from vsalog.rig import Rig

STIFFNESS, LINK, LINK_DAMPING = 150.0, 0.1, 0.15
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
        columns = estimated(method.build(device, signals, method.TUNING()), signals)["1"]
        last = np.flatnonzero(columns["excited"])[-1:]
        off += list(columns["stiffness"][last] / STIFFNESS - 1.0)
        claimed += list(columns["stiffness_std"][last] / STIFFNESS)
    off, deviations = np.array(off), np.array(off) / np.array(claimed)
    assert off.size > 30
    assert np.std(off) > 0.01
    assert np.sqrt(np.mean(deviations**2)) < 1.5


@pytest.mark.parametrize(("noise", "count"), [(0.0, 6), (0.05, 6), (0.05, 0)])
def test_what_is_not_known_of_jumps_is_what_integrals_are_off_by(noise, count):
    """Torques that jump at any moment, integrated by the trapezoidal rule: how far their ends are from what they should be."""
    rng, samples, height = np.random.default_rng(6), 400, 2.0
    t, off, told = T * np.arange(samples), [], []
    for _ in range(3000):
        moments = rng.uniform(10 * T, t[-1] - 10 * T, count)
        torque = height * np.sum(t[:, None] > moments, axis=1) + np.sin(3.0 * t) + noise * rng.standard_normal(samples)
        exact = height * np.sum(t[-1] - moments) + (1.0 - np.cos(3.0 * t[-1])) / 3.0
        off.append(T * (torque.sum() - 0.5 * (torque[0] + torque[-1])) - exact)
        state, first = jumps(jumps_start(), torque[:150], noise)
        _, after = jumps(state, torque[150:], noise)
        told.append(T**2 * (noise**2 * samples + first.sum() + after.sum()))
    assert np.std(off) == pytest.approx(np.sqrt(np.mean(told)), rel=0.06)


def test_a_jump_is_told_where_it_is_once():
    torque = np.where(np.arange(100) < 40, -1.0, 2.0)
    state, first = jumps(jumps_start(), torque[:41], 0.01)
    _, after = jumps(state, torque[41:], 0.01)
    told = np.concatenate((first, after))
    assert list(np.flatnonzero(told)) == [40]
    assert told[40] == pytest.approx(3.0**2 / 12.0)


def test_what_is_smooth_or_noise_or_missing_has_no_jumps():
    rng = np.random.default_rng(7)
    torque = 5.0 * np.sin(2.0 * np.pi * T * np.arange(20_000)) + 0.05 * rng.standard_normal(20_000)
    assert not jumps(jumps_start(), torque, 0.05)[1].any()
    torque[[500, 900]] = np.nan
    assert not jumps(jumps_start(), torque, 0.05)[1].any()


def test_a_fit_spreads_by_what_is_not_known_of_jumps():
    """Least squares of data that are off at some samples, by as much as is said: the spread of each coefficient at the end."""
    rng, t = np.random.default_rng(8), np.linspace(0.0, 1.0, 300)
    F = np.column_stack((t, t**2, np.sin(9.0 * t)))
    deviation = np.where(np.isin(np.arange(300), [20, 110, 111, 250]), 0.8, 0.0)
    P = np.linalg.inv(F.T @ F)
    found = P @ F.T @ (deviation[:, None] * rng.standard_normal((300, 4000)))
    directions, use = np.broadcast_to(P, (300, 3, 3)).copy(), np.ones(300, dtype=bool)
    state, first = jumped_block(np.zeros((3, 3)), F[:111], use[:111], deviation[:111] ** 2, directions[:111])
    _, after = jumped_block(state, F[111:], use[111:], deviation[111:] ** 2, directions[111:])
    assert np.sqrt(after[-1]) == pytest.approx(found.std(axis=1), rel=0.05)
    assert first[:20].max() == 0.0
    unused, none = jumped_block(np.zeros((3, 3)), F, ~use, deviation**2, directions)
    assert not unused.any()
    assert not none.any()
