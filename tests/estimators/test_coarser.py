"""Steps that repeat with the motion: what they do to an estimate, told by coarser ones."""

from dataclasses import replace

import numpy as np
import pytest

from vsalog.core.signals import JointSignals
from vsalog.estimators import direct
from vsalog.estimators.by_deflection import ByDeflection
from vsalog.estimators.device import device_of
from vsalog.rig import Rig

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


def fold_of(signals):
    device = device_of("sea", Rig.preset("sea").file.joint["sea"], signals.roles)
    return direct.build(device, signals, direct.DirectTuning())


def estimated(fold, signals):
    state, traces = fold.step(fold.start(), signals)
    _, rest = fold.finish(state)
    return {
        name: np.concatenate([np.asarray(t["1"][name], float) for t in (*traces, *rest)])
        for name in ("stiffness", "stiffness_std", "deflection", "excited")
    }


def scores():
    """Errors in the deviations that are told, and in those without the trial, of encoders that differ by their zeros alone.

    They count where the estimate is supported without the trial.
    """
    found = []
    for k in range(12):
        signals = to_and_fro((k / 12, (5 * k % 12) / 12))
        fold = fold_of(signals)
        told = estimated(fold, signals)
        fold.coarse = {}
        untried = estimated(fold, signals)
        sure = (untried["excited"] > 0.0) & (np.arange(COUNT) > COUNT // 2)
        if sure.any():
            off = told["stiffness"] - (LINEAR + 3.0 * CUBIC * told["deflection"] ** 2)
            found.append([np.sqrt(np.median((off / c["stiffness_std"])[sure] ** 2)) for c in (told, untried)])
    return np.array(found).T


def test_what_repeats_with_the_motion_is_in_the_deviations():
    """By left-overs and rests alone it is not, else the trial would not be needed."""
    told, untried = scores()
    assert told.size >= 8
    assert np.mean(told < 1.5) > 0.9
    assert np.mean(untried < 1.5) < 0.5


@pytest.mark.parametrize(("step", "least", "most"), [(STEP, 0.05, 1.0), (STEP / 4, 0.01, 0.05), (STEP / 100, 0.0, 0.0)])
def test_finer_steps_move_less(step, least, most):
    shares = fold_of(to_and_fro((0.0, 0.4), step)).coarse
    assert least <= (np.median(shares["1"].share) if shares else 0.0) <= most


def test_sensors_without_steps_move_nothing():
    signals = to_and_fro((0.0, 0.4), 1e-9)
    rng = np.random.default_rng(0)
    for role in ("link_position", "motor_position"):
        signals.roles[role][:] += 1e-5 * rng.standard_normal(COUNT)
    assert fold_of(signals).coarse == {}


def test_two_springs_behind_one_encoder_are_moved_alike():
    signals = to_and_fro((0.0, 0.4))
    one = signals.roles
    roles = {"link_position": one["link_position"]}
    roles |= {f"{role}_{i}": one[role] for role in ("motor_position", "torque_sensor") for i in (1, 2)}
    both = replace(signals, roles=roles, resolution={role: STEP for role in roles if "position" in role})
    device = device_of("vsa2", Rig.preset("vsa2").file.joint["vsa2"], roles)
    fold = direct.build(device, both, direct.DirectTuning())

    def columns(coarse):
        fold.coarse = coarse
        state, traces = fold.step(fold.start(), both)
        _, rest = fold.finish(state)
        names = ("stiffness", "stiffness_std")
        return [np.concatenate([np.array([t[p][n] for n in names]) for t in (*traces, *rest)], axis=1) for p in "12"], [
            np.concatenate([np.asarray(t["total"][n]) for t in (*traces, *rest)]) for n in names
        ]

    (without, (_, plain)), (_, (_, told)) = (
        columns({}),
        columns({name: ByDeflection(np.zeros(1), np.array([share])) for name, share in (("1", 0.1), ("2", 0.2))}),
    )
    known = np.isfinite(plain)
    added = 0.1 * without[0][0] + 0.2 * without[1][0]
    np.testing.assert_allclose((told**2 - plain**2)[known], (added**2)[known], rtol=1e-6)
