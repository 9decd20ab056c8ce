"""Readings that hung for a while: found amid a motion, and nothing that a motion, a command or an encoder's steps can make."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_binding import bound, recording

from vsalog.binding.zero_order_hold import held

PERIOD = 1_000_000
N = 8000
T = np.arange(N) * 1e-3
SENSORS = 'link_position = "q"\nmotor_position = "theta"\nmotor_torque = "drive"\n'


def motion(seed=0, step=0.0, noise=0.0):
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 6.0, 2)
    x = 0.5 * np.sin(4.0 * T + phase[0]) + 0.3 * np.sin(9.0 * T + phase[1]) + rng.normal(0.0, 1.0, N) * noise
    return np.round(x / step) * step if step else x


def indices(values, turn=None, period=PERIOD):
    found = held(np.arange(len(values), dtype=np.int64) * period, np.asarray(values, float), period, turn)
    return [] if found is None else np.flatnonzero(found).tolist()


def hung(x, first, length):
    """Repeat a sample of x, so often."""
    out = x.copy()
    out[first + 1 : first + 1 + length] = out[first]
    return out


def moves(x, first, length):
    """Whether a motion goes on around a stretch as it does in it: elsewhere a jump is no wonder, or small."""
    speed = np.diff(x)[first - 2 * length : first + 3 * length]
    return speed.min() > 0.6 * speed.max() or speed.max() < 0.6 * speed.min()


@given(
    seed=st.integers(0, 50),
    first=st.integers(500, N - 1000),
    length=st.integers(20, 120),
    step=st.sampled_from([0.0, 1e-5, 1e-4]),
)
def test_an_encoder_that_hung_while_the_joint_moved_is_found(seed, first, length, step):
    x = motion(seed, step)
    if not moves(motion(seed), first, length):
        return
    # A coarse encoder may say the same once more by itself.
    found = indices(hung(x, first, length))
    assert set(range(first + 1, first + 1 + length)) <= set(found)
    assert len(found) <= length + 10


@given(
    seed=st.integers(0, 300), step=st.sampled_from([0.0, 1e-5, 1e-3, 0.02, 0.1]), slow=st.sampled_from([1, 8, 20, 50])
)
def test_a_motion_loses_nothing(seed, step, slow):
    # However coarse the encoder is, and however long a slow one is held between two of its samples.
    assert indices(np.repeat(motion(seed, step)[::slow], slow)[:N]) == []


@given(
    seed=st.integers(0, 300),
    stay=st.integers(8, 600),
    noise=st.sampled_from([0.0, 1e-4]),
    rise=st.sampled_from([1, 2, 5, 40]),
)
def test_steps_and_rests_lose_nothing(seed, stay, noise, rise):
    levels = np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, N // stay + 1), stay)[:N]
    x = np.convolve(levels, np.full(rise, 1.0 / rise), "same") + noise * np.random.default_rng(seed + 1).normal(size=N)
    assert indices(x) == []


@given(seed=st.integers(0, 100), friction=st.floats(0.2, 3.0), step=st.sampled_from([1e-4, 1e-3]))
def test_a_link_that_sticks_and_slips_loses_nothing(seed, friction, step):
    # m q̈ = k (u − q) − friction · sgn q̇, at rest as long as the spring does not overcome the friction.
    drive, q, v, out = 3.0 * motion(seed), 0.0, 0.0, np.empty(N)
    for k in range(N):
        pull = 20.0 * (drive[k] - q)
        if v == 0.0 and abs(pull) < friction:
            out[k] = q
            continue
        direction = np.sign(v) if v else np.sign(pull)
        new = v + 1e-3 * (pull - friction * direction) / 0.1
        v = 0.0 if v and new * v < 0.0 else new
        q += 1e-3 * v
        out[k] = q
    assert indices(np.round(out / step) * step) == []


def test_a_jump_behind_a_gap_is_no_wonder():
    x = hung(np.linspace(0.0, 8.0, N), 3000, 40)
    kept = np.r_[0:3030, 3041:N]
    stamps = np.arange(N, dtype=np.int64)[kept] * PERIOD
    assert held(stamps, x[kept], PERIOD) is None
    assert held(np.arange(N, dtype=np.int64) * PERIOD, x, PERIOD) is not None


@pytest.mark.parametrize(("length", "found"), [(9, 0), (10, 10), (1000, 1000), (1001, 0)])
def test_a_hitch_takes_ten_to_a_thousand_samples(length, found):
    assert len(indices(hung(np.linspace(0.0, 8.0, N), 3000, length))) == found


@pytest.mark.parametrize(("step", "found"), [(0.009, 40), (0.015, 0)])
def test_a_jump_is_no_hitch_where_one_step_nearby_is_more_than_a_quarter_of_it(step, found):
    x = np.linspace(0.0, 8.0, N)
    x[2990:] += step
    jump = x[3041] - x[3000]
    assert step + x[1] < jump / 4.0 if found else step + x[1] > jump / 4.0
    assert len(indices(hung(x, 3000, 40))) == found


def test_an_encoder_that_wraps_hangs_like_any_other():
    angle = np.mod(np.linspace(0.0, 40.0, N), 2.0 * np.pi)
    assert indices(angle, 2.0 * np.pi) == []
    for first in (600, 1250, 1256):
        assert indices(hung(angle, first, 50), 2.0 * np.pi) == list(range(first + 1, first + 51))


def test_missing_numbers_in_between_do_not_hide_it():
    x = hung(np.linspace(0.0, 8.0, N), 3000, 60)
    x[[2990, 3020, 3100]] = np.nan
    assert indices(x) == [k for k in range(3001, 3061) if k != 3020]


@pytest.mark.parametrize("role", ["link_position", "motor_position"])
def test_what_hung_is_left_out_and_said(role):
    name = {"link_position": "q", "motor_position": "theta"}[role]
    logs = {"q": motion(1), "theta": motion(2), "drive": motion(3)}
    first = next(k for k in range(1000, N) if moves(logs[name], k, 40))
    spoilt = bound(SENSORS, recording(**{n: (T, hung(x, first, 40) if n == name else x) for n, x in logs.items()}))
    assert np.flatnonzero(np.isnan(spoilt.roles[role])).tolist() == list(range(first + 1, first + 41))
    (hangs,) = [f for f in spoilt.findings if f.part == role]
    assert (hangs.code, hangs.value, hangs.evidence["samples"]) == ("sensor.stuck", 40.0, N)
    assert hangs.evidence["first"] == pytest.approx((first + 1) * 1e-3)
    # A motor's torque is a command, which may stand still and jump as it likes.
    command = bound(
        SENSORS, recording(q=(T, motion(1)), theta=(T, motion(2)), drive=(T, hung(logs["drive"], 1000, 40)))
    )
    assert not command.findings
