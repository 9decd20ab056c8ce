"""The acceleration observer of one joint: gains, decay and noise against equations written here (De Luca 2007 eq. 1, 6, 7)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import eig, expm

from vsalog.filters.acceleration_arm import Arm, ArmState, observe_arm
from vsalog.filters.acceleration_observer import (
    ElasticMotor,
    characteristic,
    error_powers,
    error_variances,
    observer_gains,
    sampled_observer,
)

MOTOR = ElasticMotor(B=40.0, K=2e5, D=300.0, D_theta=100.0)
PERIOD = 1e-3


def error_dynamics(motor, L):
    """A − L C for (θ, q, θ̇, q̇), from the motor equation B θ̈ + D_θ θ̇ + D (θ̇ − q̇) + K (θ − q) = τ, with θ measured."""
    B, K, D, Dt = motor
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-K / B, K / B, -(D + Dt) / B, D / B], [0, 0, 0, 0]])
    return A - np.outer(L, [1, 0, 0, 0])


positive = st.floats(-2, 3).map(lambda x: 10.0**x)


@given(positive, positive, st.floats(0, 2), st.floats(0, 2), positive, st.floats(0.2, 1.0))
def test_gains_give_the_polynomial_asked_for(B, ratio, D, Dt, frequency, damping):
    motor = ElasticMotor(B, B * ratio * frequency, D * B, Dt * B)
    wanted = np.polymul(*[[1, 2 * damping * frequency, frequency**2]] * 2)
    np.testing.assert_allclose(characteristic(frequency, damping), wanted[1:], rtol=1e-12)
    L = observer_gains(motor, wanted[1:])
    scaled = error_dynamics(motor, L)
    # Coefficients over powers of ω are of one size; those of a matrix come from its traces (Faddeev–LeVerrier).
    M, found = np.eye(4), []
    for k in range(1, 5):
        M = scaled @ M
        found.append(-np.trace(M) / k)
        M = M + found[-1] * np.eye(4)
    powers = frequency ** np.arange(1, 5)
    size = np.max(np.abs(wanted[1:] / powers)) + np.abs(scaled).max() / frequency
    np.testing.assert_allclose(found / powers, wanted[1:] / powers, atol=1e-8 * size**2)


def test_gains_are_those_of_remark_3_without_friction_of_the_motor():
    B, K, D = 40.0, 2e5, 300.0
    a3, a2, a1, a0 = 900.0, 3.1e5, 5e7, 3e9
    expected = [
        a3 - D / B,
        B / K * a1 - B * D / K**2 * a0,
        a2 - D / B * a3 + (D**2 - K * B) / B**2,
        B / K * a0,
    ]
    np.testing.assert_allclose(observer_gains(ElasticMotor(B, K, D, 0.0), np.array([a3, a2, a1, a0])), expected)


def single(motor, frequency, damping=1.0, period=PERIOD, held=False):
    """Return the arm of one joint whose link acceleration is measured, and its gains."""
    L = observer_gains(motor, characteristic(frequency, damping))
    Phi, before, after = sampled_observer(motor, L, period, held)
    place = np.zeros(1, dtype=np.int64)
    arm = Arm(
        np.zeros((1, 5)), np.zeros(3), place, place + 1, np.zeros((1, 3)), np.zeros((1, 3)), np.array([1e-3]),
        Phi[None], before[None], after[None], np.array([motor.K]), np.array([np.inf]), np.zeros((1, 1)), 0.05, 1e-3, period,
    )  # fmt: skip
    return arm, L


def begun(x, u):
    return ArmState(np.array([x], float), np.array([u], float), np.zeros(1, np.int64), np.ones(1, np.int64))


def truth(inertia, weight, seconds, period):
    """An elastic joint whose link is heavy or light, hangs or does not (eq. 1 for one joint), by solve_ivp."""
    B, K, D, Dt = MOTOR

    def torque(t):
        return 900.0 * np.sin(11.0 * t) + 400.0 * np.cos(29.0 * t)

    def rates(t, x):
        theta, q, v, w = x
        spring = K * (q - theta) + D * (w - v)
        return [v, w, (torque(t) + spring - Dt * v) / B, (-spring - weight * np.sin(q)) / inertia]

    time = np.arange(round(seconds / period) + 1) * period
    x = solve_ivp(rates, (0, time[-1]), [0.3, 0.302, 0.4, 0.2], t_eval=time, rtol=1e-11, atol=1e-13).y.T
    return time, x, torque(time), np.array([rates(t, s)[3] for t, s in zip(time, x, strict=True)])


E0 = np.array([1e-3, -2e-3, 0.2, -0.3])


@pytest.mark.parametrize("frequency", [60.0, 250.0])
def test_the_error_decays_at_the_eigenvalues_whatever_the_link_weighs(frequency):
    """The error next to the matrix exponential of its dynamics, and its rate along their one left eigenvector: −ω within 2 %."""
    errors = []
    period = 2.5e-4
    arm, L = single(MOTOR, frequency, period=period)
    M = error_dynamics(MOTOR, L)
    for inertia, weight in ((8.0, 0.0), (60.0, 1200.0)):
        time, x, tau, ddq = truth(inertia, weight, 0.2, period)
        start = begun(x[0] - E0, [x[0, 0], tau[0], ddq[0], 0.0])
        found = observe_arm(arm, start, x[1:, :1], tau[1:, None], ddq[1:, None])[0][:, 0]
        errors.append(x[1:] - found)
    expected = np.array([expm(M * t) @ E0 for t in time[1:]])
    size = np.abs(expected).max(axis=0)
    # What is left is θ and q̈ being no straight lines between samples.
    for error in errors:
        np.testing.assert_allclose(error / size, expected / size, atol=5e-4)
    np.testing.assert_allclose(errors[0] / size, errors[1] / size, atol=5e-4)
    values, left = eig(M, left=True, right=False)
    assert np.abs(values + frequency).max() < 0.02 * frequency
    along = np.abs(errors[0] @ left[:, 0].conj())
    seen = slice(0, round(3.0 / frequency / period))
    slope = np.polyfit(time[1:][seen], np.log(along[seen]), 1)[0]
    assert slope == pytest.approx(-frequency, rel=0.02)


@pytest.mark.parametrize("damping", [1.0, 0.7])
def test_two_observers_with_the_same_inputs_draw_together_exactly(damping):
    """No sampling stands between them: their difference is expm(M t) e₀ to rounding, for any inputs at all."""
    random = np.random.default_rng(5)
    arm, L = single(MOTOR, 200.0, damping, held=True)
    inputs = random.normal(size=(60, 1)), 500.0 * random.normal(size=(60, 1)), random.normal(size=(60, 1))
    one, other = (observe_arm(arm, begun(x, np.zeros(4)), *inputs)[0][:, 0] for x in (np.zeros(4), -E0))
    M = error_dynamics(MOTOR, L)
    expected = np.array([expm(M * k * PERIOD) @ E0 for k in range(1, 61)])
    np.testing.assert_allclose(one - other, expected, atol=1e-12 + 1e-9 * np.abs(one).max())


@pytest.mark.parametrize("held", [False, True])
def test_a_sample_is_stepped_over_exactly(held):
    """The observer's own equation with inputs drawn as lines, τ as steps where it is held, by solve_ivp."""
    random = np.random.default_rng(2)
    arm, L = single(MOTOR, 180.0, 0.8, period=4e-3, held=held)
    u = random.normal(size=(2, 4)) * [0.1, 900.0, 20.0, 0.0]
    x0 = random.normal(size=4) * 0.1
    M = error_dynamics(MOTOR, L)

    def rates(t, x):
        theta, tau, ddq, _ = u[0] + (u[1] - u[0]) * t / 4e-3
        return M @ x + L * theta + np.array([0, 0, (u[0, 1] if held else tau) / MOTOR.B, ddq])

    expected = solve_ivp(rates, (0, 4e-3), x0, rtol=1e-11, atol=1e-13).y[:, -1]
    found = observe_arm(arm, begun(x0, u[0]), u[1:, :1], u[1:, 1:2], u[1:, 2:3])[0][0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9)


def test_a_motor_that_a_link_carries_feels_that_link():
    """Eq. 7 with S: joint 2's motor equation has S₁₂ q̈₁ on its left. Truth from straight lines of q̈, by expm."""
    S, motor, T = 6.0, MOTOR, PERIOD
    L = observer_gains(motor, characteristic(200.0, 1.0))
    parts = [np.stack([part] * 2) for part in sampled_observer(motor, L, T)]
    place = np.arange(2)
    coupling = np.array([[0.0, S], [0.0, 0.0]])
    arm = Arm(
        np.zeros((2, 5)), np.zeros(3), place, np.ones(2, np.int64), np.zeros((2, 3)), np.zeros((2, 3)), np.full(2, 1e-3),
        *parts, np.full(2, motor.K), np.full(2, np.inf), coupling, 0.05, 1e-3, T,
    )  # fmt: skip
    time = np.arange(400) * T
    ddq = np.stack([30.0 * np.sin(25.0 * time), np.zeros(400)], axis=1)
    rigid = error_dynamics(motor, np.zeros(4))
    # Joint 2: its link stands, its motor is shaken by link 1 alone.
    whole = np.zeros((6, 6))
    whole[:4, :4], whole[2, 4], whole[4, 5] = rigid, -S / motor.B, 1.0
    x = np.zeros((400, 4))
    for k in range(399):
        rate = (ddq[k + 1, 0] - ddq[k, 0]) / T
        x[k + 1] = (expm(whole * T) @ [*x[k], ddq[k, 0], rate])[:4]
    theta = np.stack([np.zeros(400), x[:, 0]], axis=1)
    state = ArmState(np.zeros((2, 4)), np.zeros((2, 4)), np.zeros(2, np.int64), np.ones(1, np.int64))
    found = observe_arm(arm, state, theta[1:], np.zeros((399, 2)), ddq[1:])[0]
    np.testing.assert_allclose(found[:, 1], x[1:], atol=2e-3 * np.abs(x).max(axis=0).max())
    without = observe_arm(arm._replace(coupling=np.zeros((2, 2))), state, theta[1:], np.zeros((399, 2)), ddq[1:])[0]
    assert np.abs(without[:, 1] - x[1:]).max() > 20 * np.abs(found[:, 1] - x[1:]).max()


@pytest.mark.parametrize("held", [False, True])
def test_variances_are_those_of_the_recursion_itself(held):
    """Covariance of error and present noise together, stepped sample by sample."""
    L = observer_gains(MOTOR, characteristic(150.0, 0.9))
    Phi, before, after = observer = sampled_observer(MOTOR, L, PERIOD, held)
    start = np.array([1e-4, 2e-3, 0.1, 0.3])
    found = error_variances(observer, start, 400)
    told = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [-1, 1, 0, 0]])
    for source in range(4):
        step = np.zeros((5, 5))
        step[:4, :4], step[:4, 4] = Phi, before[:, source]
        new = np.append(after[:, source], 1.0)
        P = np.outer(new, new)
        for k in range(400):
            variances = np.diag(told @ P[:4, :4] @ told.T)
            np.testing.assert_allclose(found[k, source], variances, rtol=1e-6, atol=1e-9 * variances.max())
            P = step @ P @ step.T + np.outer(new, new)
    for k in (0, 7, 40):
        e = np.linalg.matrix_power(Phi, k) @ np.diag(start)
        np.testing.assert_allclose(found[k, 4], np.diag(told @ e @ e.T @ told.T), rtol=1e-9)


@pytest.mark.parametrize("count", [400, 401])
def test_what_an_error_makes_is_what_stepping_through_it_makes(count):
    """An error that goes round and round, stepped sample by sample until the beginning is forgotten."""
    L = observer_gains(MOTOR, characteristic(150.0, 0.9))
    Phi, before, after = observer = sampled_observer(MOTOR, L, PERIOD)
    added = np.cumsum(np.random.default_rng(0).normal(size=count))
    added -= added.mean()
    for source in (0, 2):
        e, seen, last = np.zeros(4), [], added[-1]
        for w in np.tile(added, 6):
            e = Phi @ e + before[:, source] * last + after[:, source] * w
            last = w
            seen.append([*e, e[1] - e[0]])
        stepped = np.mean(np.square(seen[-count:]), axis=0)
        np.testing.assert_allclose(error_powers(observer, source, added), stepped, rtol=1e-6)
