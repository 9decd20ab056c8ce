"""The kinematic filters against a textbook Kalman filter written here with matrices."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.core.errors import FilterError
from vsalog.filters.kinematic import KinematicSettings, kinematic_filter

SETTINGS = KinematicSettings(
    acceleration_variance=1e3, variance_max=1e-4, variance_min=1e-6, shape=6.0, threshold_speed=1.5
)


def textbook(z, dt, s, x0, P0, modified):
    """Predict and update in matrix form with the Joseph covariance (Flacco 2012 eq. 18–20)."""
    x, P = x0.copy(), P0.copy()
    H = np.array([[1.0, 0.0]])
    out = [x.copy()]
    for k in range(1, len(z)):
        A = np.array([[1.0, dt[k]], [0.0, 1.0]])
        gamma = np.array([[dt[k] ** 2 / 2.0], [dt[k]]])
        x = A @ x
        P = A @ P @ A.T + s.acceleration_variance * gamma @ gamma.T
        if not np.isnan(z[k]):
            R = s.variance_max
            if modified:
                R = (s.variance_max - s.variance_min) / (
                    1.0 + np.exp((abs(x[1]) / s.threshold_speed - 1.0) * s.shape)
                ) + s.variance_min
            K = P @ H.T / (H @ P @ H.T + R)
            x = x + (K * (z[k] - x[0]))[:, 0]
            J = np.eye(2) - K @ H
            P = J @ P @ J.T + K @ K.T * R
        out.append(x.copy())
    return np.array(out)


def first_state(z, dt, s):
    x0 = np.array([z[0], 0.0])
    P0 = np.diag([s.variance_max, 100.0 * (s.threshold_speed**2 + s.variance_max / dt[0] ** 2)])
    return x0, P0


def encoder(rng, n=2000, step=2.0 * np.pi / 4059.0, T=1e-3):
    t = np.arange(n) * T
    return np.round((np.sin(2.0 * np.pi * t) + 0.1 * rng.normal() * t) / step) * step


@pytest.mark.parametrize("modified", [False, True])
@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("jitter", [False, True])
def test_agrees_with_the_textbook_filter(modified, missing, jitter):
    rng = np.random.default_rng(4)
    z = encoder(rng)
    if missing:
        z[rng.random(z.size) < 0.1] = np.nan
        z[0] = 0.0
    dt = rng.uniform(0.5e-3, 1.5e-3, z.size) if jitter else np.full(z.size, 1e-3)
    s = (
        SETTINGS
        if modified
        else KinematicSettings(
            acceleration_variance=1e3, variance_max=1e-4, variance_min=1e-4, shape=6.0, threshold_speed=1.5
        )
    )
    expected = textbook(z, dt, s, *first_state(z, dt, s), modified)
    position, velocity, _ = kinematic_filter(z, dt, s)
    np.testing.assert_allclose(position, expected[:, 0], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(velocity, expected[:, 1], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_blocks_give_the_same_bits_as_the_whole(size):
    z = encoder(np.random.default_rng(1))
    z[40:60] = np.nan
    whole = kinematic_filter(z, 1e-3, SETTINGS)
    state, parts = None, []
    for k in range(0, z.size, size):
        position, velocity, state = kinematic_filter(z[k : k + size], 1e-3, SETTINGS, state)
        parts.append((position, velocity))
    np.testing.assert_array_equal(np.concatenate([p for p, _ in parts]), whole[0])
    np.testing.assert_array_equal(np.concatenate([v for _, v in parts]), whole[1])


def test_the_modified_filter_smooths_a_slow_encoder_more_than_numerical_differentiation():
    """Flacco 2012 Fig. 12: at low speed the difference quotient of an encoder is mostly quantisation."""
    t = np.arange(20000) * 1e-3
    step = 2.0 * np.pi / 4059.0
    theta = 0.4 * np.sin(2.0 * np.pi * 0.5 * t)
    z = np.round(theta / step) * step
    truth = 0.4 * np.pi * np.cos(np.pi * t)
    _, velocity, _ = kinematic_filter(z, 1e-3, KinematicSettings.for_resolution(step, 1e-3))
    difference = np.gradient(z, 1e-3)
    error = np.sqrt(np.mean((velocity - truth)[1000:] ** 2))
    assert error < 0.2 * np.sqrt(np.mean((difference - truth)[1000:] ** 2))


@given(
    start=st.floats(-1e3, 1e3),
    speed=st.floats(-50.0, 50.0),
    period=st.floats(1e-4, 1e-1),
)
def test_a_steady_motion_is_followed_without_lag(start, speed, period):
    z = start + speed * period * np.arange(3000)
    s = KinematicSettings.for_resolution(1e-4, period)
    position, velocity, _ = kinematic_filter(z, period, s)
    scale = abs(start) + abs(speed) + 1.0
    assert abs(position[-1] - z[-1]) < 1e-6 * scale
    assert abs(velocity[-1] - speed) < 1e-5 * scale / period * 1e-2


def test_nothing_is_known_before_the_first_sample():
    position, velocity, _ = kinematic_filter(np.array([np.nan, np.nan, 1.0]), 1e-3, SETTINGS)
    assert np.isnan(position[:2]).all()
    assert np.isnan(velocity[:2]).all()
    assert position[2] == 1.0


@pytest.mark.parametrize(
    "bad",
    [
        {"acceleration_variance": 0.0},
        {"variance_max": -1.0},
        {"variance_min": np.nan},
        {"variance_min": 1.0},
        {"threshold_speed": 0.0},
    ],
)
def test_impossible_settings_are_refused(bad):
    good = {"acceleration_variance": 1.0, "variance_max": 1e-2, "variance_min": 1e-3}
    with pytest.raises(FilterError, match="kinematic filter"):
        KinematicSettings(**{**good, **bad})


def test_a_step_back_in_time_is_refused():
    with pytest.raises(FilterError, match="positive"):
        kinematic_filter(np.zeros(3), np.array([1e-3, -1e-3, 1e-3]), SETTINGS)


def test_the_tuning_at_a_millisecond_is_the_papers():
    """V_a = 1e10 and R = 10 at rest; at other rates as many samples are smoothed over."""
    for period in (1e-3, 4e-3):
        settings = KinematicSettings.for_resolution(1e-4, period)
        ratio = settings.acceleration_variance / settings.variance_max
        assert ratio == pytest.approx(1e10 / 10.0 * (1e-3 / period) ** 4)
