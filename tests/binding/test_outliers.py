"""Samples that stand alone: what no motion makes is left out, and whatever could have happened stays."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import lagrange
from test_binding import bound, recording

from vsalog.filters.outliers import Outliers

TURN = 2.0 * np.pi
N = 10_001
T = np.arange(N) * 1e-3
SENSORS = "".join(
    f'{role} = "{name}"\n'
    for role, name in [
        ("link_position", "q"), ("motor_position", "theta"), ("torque_sensor", "tau"), ("motor_torque", "drive"),
        ("link_acceleration", "acc"),
    ]
)  # fmt: skip


def motion(seed=0, amplitude=0.5):
    rng = np.random.default_rng(seed)
    return amplitude * np.sin(4.0 * T) + 0.3 * np.sin(1.3 * T) + rng.normal(0.0, 2e-4, N)


def stand_alone(values, turn=None):
    return Outliers(values, turn).among(values)


def indices(values, turn=None):
    alone = stand_alone(np.asarray(values), turn)
    return [] if alone is None else np.flatnonzero(alone).tolist()


def log(**spoilt):
    made = {"q": motion(1), "theta": motion(2), "tau": 20.0 * motion(3), "drive": motion(4), "acc": motion(5)}
    for name, (at, value) in spoilt.items():
        made[name][at] = value
    return recording(**{name: (T, x) for name, x in made.items()})


@pytest.mark.parametrize(
    ("role", "name", "at", "value"),
    [
        ("link_position", "q", [6002], 2.0),
        ("link_position", "q", [0], 9.0),
        ("link_position", "q", [N - 1], 9.0),
        ("motor_position", "theta", [377, 1400, 1401, 5000, 5001, 5002], -3.0),
        ("torque_sensor", "tau", [300, 303], 1e31),
    ],
)
def test_samples_that_stand_alone_are_missing_and_named(role, name, at, value):
    signals, clean = bound(SENSORS, log(**{name: (at, value)})), bound(SENSORS, log())
    # One alone is on the cubic through its neighbours then, as a sample that is missing; more, and the ends, are not known.
    lone = [k for k in at if 0 < k < N - 1 and not {k - 1, k + 1} & set(at)]
    assert np.flatnonzero(np.isnan(signals.roles[role])).tolist() == [k for k in at if k not in lone]
    for k in lone:
        around = k + np.array([-2, -1, 1, 2])
        cubic = lagrange((around - k).astype(float), clean.roles[role][around])
        assert signals.roles[role][k] == pytest.approx(cubic(0.0), rel=1e-9)
    kept = np.setdiff1d(np.arange(N), at)
    np.testing.assert_array_equal(signals.roles[role][kept], clean.roles[role][kept])
    (outliers,) = [f for f in signals.findings if f.part == role]
    assert (outliers.code, outliers.value, outliers.evidence["samples"]) == ("recording.outliers", len(at), N)
    assert outliers.evidence["first"] == pytest.approx(at[0] * 1e-3)
    assert not clean.findings


@pytest.mark.parametrize("wild", [9e9, -1e30, 1e300])
@pytest.mark.parametrize("step", [1.0, 0.01])
def test_a_wild_number_does_not_hide_behind_its_size(wild, step):
    x = np.round(20.0 * motion() / step) * step
    x[3000] = wild
    assert indices(x) == [3000]


def test_a_lost_packet_that_reads_zero_is_found_wherever_it_would_show():
    for at in (500, 1234, 7777):
        x = 0.8 + motion(at)
        assert abs(x[at]) > 0.1
        x[at] = 0.0
        assert indices(x) == [at]


def test_what_a_command_or_a_blow_makes_is_left_alone():
    signals = bound(SENSORS, log(drive=([100], 50.0), acc=([100], 50.0)))
    assert np.isfinite(signals.roles["motor_torque"]).all()
    assert np.isfinite(signals.roles["link_acceleration"]).all()
    assert not signals.findings


@pytest.mark.parametrize("at", [2000, 3000, 3142, 3500, 6200])
@pytest.mark.parametrize("value", [0.0, 5.0, 8.0])
def test_a_wild_sample_of_an_encoder_that_wraps_is_no_turn(at, value):
    turning = np.mod(T + np.random.default_rng(6).normal(0.0, 1e-4, N), TURN)
    far = np.abs(np.angle(np.exp(1j * (value - turning[at]))))
    turning[at] = value
    q = bound('link_position = "q"', recording(q=(T, turning))).roles["link_position"]
    q = q - TURN * np.round((q[100] - T[100]) / TURN)
    kept = np.arange(N) != at
    np.testing.assert_allclose(q[kept], T[kept], atol=2e-3)
    # Left out and bridged, or taken for what it is.
    assert abs(q[at] - T[at]) == pytest.approx(0.0 if far > 0.5 or value > TURN else far, abs=2e-3)


def test_hovering_where_an_encoder_begins_again_loses_nothing():
    x = np.mod(0.02 * np.sin(T) + np.random.default_rng(7).normal(0.0, 1e-3, N), TURN)
    assert indices(x, TURN) == []


def test_a_multiturn_encoder_that_loses_a_turn_for_a_sample_is_not_turned():
    x = 3.0 * T
    x[4000] -= TURN
    assert indices(x, TURN) == [4000]


@pytest.mark.parametrize("length", [4, 5, 8, 20])
@pytest.mark.parametrize("shape", ["square", "half a sine"])
def test_a_push_of_four_samples_or_more_stays(length, shape):
    x = motion()
    x[5000 : 5000 + length] += (
        5.0 if shape == "square" else 5.0 * np.sin(np.pi * np.arange(1, length + 1) / (length + 1))
    )
    assert indices(x) == []


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.integers(4, 90), st.floats(-1e3, 1e3)), min_size=2, max_size=120),
    st.sampled_from([0.0, 1e-9, 1.0]),
    st.integers(0, 2**31),
)
def test_steps_lose_nothing(levels, noise, seed):
    x = np.concatenate([np.full(n, level) for n, level in levels])
    assert indices(x + np.random.default_rng(seed).normal(0.0, 1.0, x.size) * noise) == []


NOISES = {
    "normal": lambda rng, n: rng.normal(size=n),
    "laplace": lambda rng, n: rng.laplace(size=n),
    "uniform": lambda rng, n: rng.uniform(size=n),
    "student 4": lambda rng, n: rng.standard_t(4, n),
    "exponential": lambda rng, n: rng.exponential(size=n),
    "lognormal": lambda rng, n: rng.lognormal(size=n),
    "two levels": lambda rng, n: rng.integers(0, 2, n).astype(float),
    "seldom a step": lambda rng, n: (rng.uniform(size=n) < 0.005).astype(float),
    "counts": lambda rng, n: rng.poisson(0.05, n).astype(float),
    "either of two": lambda rng, n: rng.normal(size=n) + 1e3 * (rng.uniform(size=n) < 0.1),
    "walk": lambda rng, n: rng.standard_t(4, n).cumsum(),
}


@settings(max_examples=150)
@given(st.sampled_from(sorted(NOISES)), st.integers(300, 6000), st.integers(0, 2**31), st.floats(1e-6, 1e6))
def test_pure_noise_stays(kind, n, seed, scale):
    """Of enough samples: by chance two levels may come as three samples in a hundred, which nobody could tell from wrong ones."""
    assert indices(scale * NOISES[kind](np.random.default_rng(seed), n)) == []


@settings(max_examples=80)
@given(st.floats(8.0, 2000.0), st.floats(0.0, 7.0), st.integers(100, 5000), st.sampled_from([None, 1e-3, 0.1]))
def test_a_smooth_motion_however_coarsely_sampled_stays(per_period, phase, n, step):
    x = np.sin(TURN * np.arange(n) / per_period + phase)
    assert indices(x if step is None else np.round(x / step) * step, TURN) == []


def test_short_logs_are_left_alone():
    x = motion()[:99]
    x[50] = 90.0
    assert indices(x) == []


@pytest.mark.parametrize("quantised", [False, True])
def test_an_hour_without_a_spike_costs_next_to_nothing(quantised):
    t = np.arange(3_600_000) * 1e-3
    x = np.sin(t) + np.random.default_rng(8).normal(0.0, 1e-3, t.size)
    x = np.round(x, 3) if quantised else x
    stand_alone(x[:1000])
    took = []
    for _ in range(3):
        begun = time.process_time()
        assert stand_alone(x, TURN) is None
        took.append(time.process_time() - begun)
    assert min(took) < 0.1


def far_in_noise(times, share=0.01, n=10_000):
    """Student's noise with a sample so many times as far as all but one in fifty are; so large a part of it is far."""
    rng = np.random.default_rng(11)
    x = rng.standard_t(8, n)
    usual = np.quantile(np.abs(x), 0.98)
    at = rng.permutation(np.arange(50, n - 50, 50))[: max(1, int(share * n))]
    x[at] = times * usual
    return x, sorted(at.tolist())


@pytest.mark.parametrize(("times", "found"), [(15.0, False), (40.0, True)])
def test_one_sample_in_a_million_is_beyond_by_chance(times, found):
    # P(|x| > k u) = P(|x| > u) / k^3 of Student's t with three degrees of freedom, far out: of 0.02 a millionth at k = 27.1.
    x, at = far_in_noise(times, share=0.0)
    assert indices(x) == (at if found else [])


@pytest.mark.parametrize(("share", "found"), [(0.015, True), (0.02, False)])
def test_more_than_one_in_fifty_are_no_outliers(share, found):
    x = np.tile(motion(), 2)
    at = np.arange(100, x.size - 100, round(1.0 / share) if found else 45)
    x[at] = 30.0
    assert indices(x) == (at.tolist() if found else [])


@pytest.mark.parametrize(("share", "found"), [(0.03, False), (0.09, True)])
def test_what_is_off_by_less_than_a_twentieth_of_the_range_spoils_nothing(share, found):
    x = np.sin(T)
    x[5000] += 2.0 * share
    assert indices(x) == ([5000] if found else [])


@pytest.mark.parametrize(("every", "left_out"), [(67, True), (33, False)])
def test_pulses_that_are_rarer_than_one_sample_in_fifty_are_left_out(every, left_out):
    """What comes more often is what the signal usually does."""
    values, at = 0.5 * np.sin(4.0 * T), np.arange(25, N - 25, every)
    values[at] += 1.0
    assert indices(values) == (at.tolist() if left_out else [])


@pytest.mark.parametrize(("share", "left_out"), [(0.07, True), (0.035, False)])
def test_what_is_off_by_less_than_a_twentieth_of_the_range_is_kept(share, left_out):
    values = np.sin(4.0 * T)
    values[6002] += share * np.ptp(values)
    assert indices(values) == ([6002] if left_out else [])
