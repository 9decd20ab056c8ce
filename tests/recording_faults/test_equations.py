"""The parts that faults of recordings are found with, compared with closed forms and scipy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from vsalog.checks.constrained_fit import residual_of
from vsalog.checks.joint_equations import equation, names_of
from vsalog.checks.smoothed_motion import motion_of
from vsalog.core.dependence import above_zero
from vsalog.core.signals import JointSignals

PERIOD = 1e-3
T = np.arange(10_000) * PERIOD


def signals_of(roles, resolution=None, starts=()):
    begins = np.zeros(T.size, dtype=bool)
    begins[[0, *starts]] = True
    stamps = (T * 1e9).astype(np.int64)
    return JointSignals("j", PERIOD, stamps, T, roles, begins, np.zeros(T.size, np.int32), resolution=resolution or {})


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(0, 3))
def test_a_constrained_fit_is_scipys(seed, positive, free):
    rng = np.random.default_rng(seed)
    P, F, y = rng.standard_normal((60, positive)), rng.standard_normal((60, free)), rng.standard_normal(60)
    left, x = residual_of(y, F, P)
    expected, norm = optimize.nnls(np.column_stack((P, F, -F)), y)
    assert np.linalg.norm(left) == pytest.approx(norm, rel=1e-9)
    np.testing.assert_allclose(x, expected[:positive], atol=1e-8)


def test_columns_that_say_the_same_or_nothing_do_no_harm():
    y, column = np.sin(T[:200]), np.cos(T[:200])
    left, x = residual_of(y, np.ones((200, 2)), np.column_stack((column, column, np.zeros(200), np.ones(200))))
    once, _ = residual_of(y, np.ones((200, 1)), column[:, None])
    np.testing.assert_allclose(left, once, atol=1e-9)
    assert np.isfinite(x).all()


def test_filtered_derivatives_are_those_of_the_sine():
    w = 2.0 * np.pi * 1.3
    motion = motion_of(signals_of({"link_position": 0.7 + np.sin(w * T)}), 0.1)
    value, rate, acceleration = motion.values["link_position"][:, motion.rows]
    at = w * T[motion.rows]
    # One factor for all of them: that of a Gaussian's narrowest filter, nearly 1.
    np.testing.assert_allclose(value, 0.7 + np.sin(at), atol=2e-4)
    np.testing.assert_allclose(rate, w * np.cos(at), atol=2e-4 * w)
    np.testing.assert_allclose(acceleration, -(w**2) * np.sin(at), atol=2e-4 * w**2)


def test_a_noisy_encoder_gets_a_wider_filter_and_the_noise_that_is_left_is_foretold():
    noise = 1e-4 * np.random.default_rng(1).standard_normal(T.size)
    clean, noisy = np.sin(3.0 * T), np.sin(3.0 * T) + noise
    motion = motion_of(signals_of({"link_position": noisy}), 0.1)
    acceleration, expected = motion.values["link_position"][2, motion.rows], -9.0 * np.sin(3.0 * T[motion.rows])
    left = float(np.std(acceleration - expected))
    assert left < 0.11 * np.std(expected)
    assert left == pytest.approx(float(np.std(motion.noise["link_position"][2, motion.rows])), rel=0.3)
    assert motion_of(signals_of({"link_position": clean}), 0.1).noise["link_position"][2].std() < 0.01


def test_what_a_filter_reaches_across_a_gap_is_not_known():
    motion = motion_of(signals_of({"link_position": np.sin(T)}, starts=(5000,)), 0.1)
    unknown = np.flatnonzero(~motion.known["link_position"])
    assert unknown[0] < 5000 < unknown[-1]
    assert unknown.size < 40


def test_a_log_that_is_too_short_has_no_motion():
    short = signals_of({"link_position": np.sin(T)})[:100]
    assert motion_of(short, 0.1) is None


def rows_of(x):
    return np.array([x, np.gradient(x, PERIOD), np.gradient(np.gradient(x, PERIOD), PERIOD)])[:, 50:-50]


def test_equations_hold_for_the_joint_of_the_textbook():
    theta, phi = np.sin(2.0 * T), 0.05 * np.sin(5.0 * T) + 0.02 * np.cos(11.0 * T)
    q = theta + phi
    spring = 80.0 * phi + 500.0 * phi**3 + 0.3 * np.gradient(phi, PERIOD)
    drive = 0.2 * rows_of(theta)[2] + 0.7 * rows_of(theta)[1] - spring[50:-50]
    roles = {
        "link_position": rows_of(q),
        "motor_position": rows_of(theta),
        "torque_sensor": rows_of(spring),
        "motor_torque": np.array([drive, drive, drive]),
    }
    assert names_of(roles) == ("spring ", "motor ", "pair ")
    for name, at_most in (("spring ", 1e-4), ("motor ", 1e-9), ("pair ", 0.01)):
        eq = equation(name, roles)
        left, _ = residual_of(eq.y, eq.free, eq.positive)
        assert float(left @ left) < at_most * float(np.sum((eq.scale - eq.scale.mean()) ** 2)), name
    turned = {**roles, "torque_sensor": -roles["torque_sensor"]}
    eq = equation("spring ", turned)
    left, _ = residual_of(eq.y, eq.free, eq.positive)
    assert float(left @ left) > 0.9 * float(np.sum((eq.y - eq.y.mean()) ** 2))


def test_the_names_follow_from_the_roles():
    one = rows_of(np.sin(T))
    assert names_of({"link_position": one, "motor_torque": one}) == ("body motor_torque",)
    assert names_of({"deflection": one, "torque_sensor": one}) == ("spring ",)
    assert names_of({"torque_sensor": one}) == ()
    twins = {f"{role}_{n}": one for role in ("motor_position", "torque_sensor", "motor_torque") for n in (1, 2)}
    assert names_of({"link_position": one, **twins}) == ("spring _1", "motor _1", "spring _2", "motor _2")


@pytest.mark.parametrize("scores", [np.arange(24.0) - 6.0, np.r_[np.full(22, 0.01), 9.0, 8.0], -np.arange(24.0)])
def test_the_probability_of_scores_above_zero_is_scipys(scores):
    mean = stats.ttest_1samp(scores, 0.0, alternative="greater").pvalue
    signs = stats.binomtest(int(np.sum(scores > 0.0)), scores.size, alternative="greater").pvalue
    assert above_zero(scores) == pytest.approx(min(1.0, 2.0 * min(mean, signs)), rel=1e-9)


def test_scores_of_chance_are_above_zero_no_oftener_than_said():
    rng = np.random.default_rng(11)
    size = np.exp(2.0 * rng.standard_normal((4000, 24)))
    alarms = [above_zero(one) <= 0.01 for one in size * rng.standard_normal((4000, 24))]
    assert stats.binomtest(int(np.sum(alarms)), 4000, 0.01, alternative="greater").pvalue > 1e-3


def test_noise_without_steps_is_foretold_where_the_signal_rests():
    """A signal without steps is given those of its noise: read again it is noisy at rest, too."""
    noise = 0.01 * np.random.default_rng(4).standard_normal(T.size)
    torque = np.where(T % 2.0 < 1.0, 0.5, -0.5) + noise
    step = 0.01 * np.sqrt(12.0)
    motion = motion_of(signals_of({"torque_sensor": torque, "link_position": np.sin(T)}, {"torque_sensor": step}), 0.1)
    left, foretold = motion.values["torque_sensor"][0][2100:2900] - 0.5, motion.noise["torque_sensor"][0][2100:2900]
    assert np.std(foretold) == pytest.approx(np.std(left), rel=0.3)
    assert abs(foretold.mean()) < 5.0 * 0.01 / np.sqrt(800.0)
