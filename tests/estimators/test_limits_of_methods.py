"""What single methods take for enough and for impossible, from both sides."""

from types import SimpleNamespace

import numpy as np
import pytest

from vsalog.core.errors import EstimatorError
from vsalog.core.signals import JointSignals
from vsalog.estimators.acceleration_group import Axis
from vsalog.estimators.accelerometer_check import accelerometer_findings
from vsalog.estimators.averaging_error import AveragingError
from vsalog.estimators.device import device_of
from vsalog.estimators.methods import pam_ukf, qr_rls
from vsalog.estimators.methods.acceleration_observer import AccelerationFold, AccelerationTuning
from vsalog.estimators.methods.impedance_coupled import ImpedanceCoupledFold
from vsalog.estimators.methods.pam_ukf import PamTuning, _below_outside, estimate_of
from vsalog.estimators.methods.residual_rls import ResidualRlsTuning, _bandwidth
from vsalog.estimators.observer_fold import ObserverFold, Observers
from vsalog.estimators.pam_noise import pam_noise
from vsalog.estimators.pam_states import PamFold, _held, _volume
from vsalog.estimators.residual_motion import SPEED, followers, motion_rows_block, motion_rows_start
from vsalog.estimators.screening import Screening
from vsalog.estimators.torque_rates import RateNoise, Rates
from vsalog.estimators.tuning import usual_regressor
from vsalog.filters.acceleration_arm import Arm
from vsalog.filters.derivative_weights import derivative_weights
from vsalog.filters.stiffness_observer import observer_start
from vsalog.mechanics.pneumatics import muscle_volume
from vsalog.rig import Rig

SEA, PAM = (Rig.preset(name).file.joint[name] for name in ("sea", "pam"))
PAM_DEVICE = device_of("pam", PAM)


def signals_of(period=1e-3, **roles):
    n = len(next(iter(roles.values())))
    starts = np.arange(n) == 0
    stamps = np.arange(n) * round(period * 1e9)
    return JointSignals("j", period, stamps, np.arange(n) * period, roles, starts, np.zeros(n, dtype=np.int32))


# --- acceleration-observer


def frequency_of(period=1e-3, noise=lambda frequency: 1.0, **tune):
    """The frequency of an observer whose deflection has such a noise."""
    made = SimpleNamespace(
        period=period, tuning=AccelerationTuning(**tune), device=SimpleNamespace(joint="j"),
        _deflection_variance=lambda i, frequency, deviation: noise(frequency) ** 2,
    )  # fmt: skip
    return AccelerationFold._frequency(made, 0, 1.0)


@pytest.mark.parametrize(("period", "frequency"), [(1e-3, 250.0), (1.9e-3, 250.0), (4e-3, 125.0)])
def test_an_observer_is_as_fast_as_the_paper_s_but_turns_half_a_radian_a_sample_at_most(period, frequency):
    assert frequency_of(period) == pytest.approx(frequency)


def test_an_observer_that_turns_more_than_two_radians_a_sample_is_refused():
    assert frequency_of(frequency=1900.0) == 1900.0
    with pytest.raises(EstimatorError, match="faster than the samples"):
        frequency_of(frequency=2100.0)


@pytest.mark.parametrize(("times", "fast"), [(1.3, True), (1.9, False)])
def test_a_slower_observer_has_to_have_half_as_much_noise_again_less(times, fast):
    assert (frequency_of(noise=lambda f: times if f > 200.0 else 1.0) == 250.0) == fast


@pytest.mark.parametrize(("times", "believed"), [(4.0, True), (7.0, False)])
def test_a_deflection_is_believed_up_to_five_times_what_the_motor_makes(times, believed):
    member = SimpleNamespace(view=SimpleNamespace(motor_torque="tau"), motor=SimpleNamespace(K=100.0))
    made = SimpleNamespace(
        group=SimpleNamespace(members=[member]), frequencies=[250.0], _deflection_variance=lambda *_: 0.01**2
    )
    farthest = AccelerationFold._farthest(made, np.ones(1), signals_of(tau=np.array([-2.0, 1.0])))[0]
    assert (times * (0.02 + 0.01) <= farthest) == believed


def told_of(scale=1.0, shake=0.0, rate=1.0):
    """What is reported of an acceleration so many times the motor's, with a swing of so many times its size and rate [Hz]."""
    t = np.arange(3000) * 1e-3
    theta, acceleration = -np.cos(3.0 * t) / 9.0, np.cos(3.0 * t)
    one, nothing = np.ones(1), np.zeros((1, 3))
    arm = Arm(
        links=np.zeros((1, 5)), gravity=np.zeros(3), row_link=np.zeros(1, dtype=np.int64),
        row_direct=np.ones(1, dtype=np.int64), row_point=nothing, row_axis=nothing, row_noise=1e-6 * one,
        Phi=np.zeros((1, 4, 4)), before=np.zeros((1, 4, 3)), after=np.zeros((1, 4, 3)), K=one, farthest=np.inf * one,
        coupling=np.zeros((1, 1)), reach=0.05, unit_noise=1e-6, period=1e-3,
    )  # fmt: skip
    view = SimpleNamespace(motor_position="theta", motor_torque="tau")
    group = SimpleNamespace(
        members=[SimpleNamespace(joint="j", view=view)], place=0,
        axes=[Axis("link_acceleration", 0, True, np.zeros(3), np.zeros(3))],
    )  # fmt: skip
    measured = scale * acceleration + shake * np.cos(2.0 * np.pi * rate * t)
    found = accelerometer_findings(arm, group, signals_of(theta=theta, link_acceleration=measured))
    return [finding.code for finding in found]


@pytest.mark.parametrize(("share", "told"), [(0.2, []), (-0.2, []), (0.4, ["accelerometer.scale"])])
def test_an_accelerometer_is_told_that_is_off_by_more_than_three_tenths(share, told):
    assert told_of(1.0 + share) == told


@pytest.mark.parametrize(("rate", "told"), [(8.0, []), (3.0, ["accelerometer.off"])])
def test_what_swings_faster_than_a_quarter_of_a_second_is_no_fault_of_an_accelerometer(rate, told):
    assert told_of(shake=1.0, rate=rate) == told


# --- the observers of Grioli and Bicchi, and of Serio


def test_noise_that_swings_within_a_window_averages_out_over_a_longer_memory():
    """What a memory leaves of the noise of a filter's first derivative, by its spectrum: never more than is reported."""
    window, period = 51, 1e-3
    gain = np.abs(np.fft.rfft(derivative_weights(window, 5, 1, period)[1], 2**16)) ** 2
    turn = np.linspace(0.0, np.pi, gain.size)
    for memory in (1.0, 2.0, 4.0):
        told = ObserverFold._least_variance(
            SimpleNamespace(alpha=1.0 / (memory * window * period), conditioner=SimpleNamespace(window=window), period=period),
            1.0, 1.0,
        )  # fmt: skip
        left = float((gain / (1.0 + (memory * window * turn) ** 2)).sum() / gain.sum())
        assert left < told < 3.0 * left


def test_what_was_learnt_counts_when_all_but_a_twentieth_of_the_memory_is_filled():
    """Of a memory 1 − exp(−n) is filled after n of its lengths: 0.95 after three."""
    n, memory = 400, 100
    rates, starts = Rates(np.full(n, 20.0), np.ones(n)), Observers(*(observer_start() for _ in range(4)))
    made = SimpleNamespace(
        alpha=1.0 / memory, period=1.0, rate_noise={"1": RateNoise(1e-9, 0.0, 0.0)}, averages={"1": AveragingError()},
        smoothed_away=0.0, look=Screening(), _rates=lambda *_: rates, _stale=lambda speed: np.inf,
        _least_variance=lambda noise, speed: noise,
    )  # fmt: skip
    borne = SimpleNamespace(
        view=SimpleNamespace(name="1"),
        deflection=lambda of, order: np.arange(n, dtype=float),
        torque=lambda of: np.ones(n),
    )
    part = SimpleNamespace(of={}, rows=SimpleNamespace(time=np.arange(n, dtype=float)))
    excited = ObserverFold._observed(made, SimpleNamespace(observers={"1": starts}), part, borne)["excited"]
    assert 270 < int(np.argmax(excited)) < 330
    assert excited[330:].all()


def test_another_loop_begins_with_another_inertia():
    made = SimpleNamespace(guess=(0.1, 0.3), noise=SimpleNamespace(inertia=0.01, damping=0.02))
    first, _, other = ImpedanceCoupledFold._loops(made)
    assert 1.5 < other.link[0] / first.link[0] < 3.0


# --- least squares


@pytest.mark.parametrize(("share", "allowed"), [(0.7, True), (1.4, False)])
def test_a_residual_is_no_faster_than_a_third_of_half_the_sample_rate(share, allowed):
    tuning = ResidualRlsTuning(bandwidth=share * np.pi / 3e-3)
    if allowed:
        assert _bandwidth(signals_of(x=np.zeros(1000)), tuning) == tuning.bandwidth
    else:
        with pytest.raises(EstimatorError, match="bandwidth"):
            _bandwidth(signals_of(x=np.zeros(1000)), tuning)


def test_a_prior_of_qr_rls_weighs_a_few_millionths_of_a_sample():
    t = np.arange(2000) * 1e-3
    theta = np.sin(5.0 * t)
    signals = signals_of(
        motor_position=theta, link_position=theta + 0.1 * np.sin(5.0 * t + 1.0), motor_torque=np.cos(5.0 * t)
    )
    device = device_of("j", SEA, signals.roles)
    samples = 1.0 / (qr_rls.build(device, signals, qr_rls.TUNING()).solver.p0 * usual_regressor(device, signals) ** 2)
    assert 3.5e-6 < samples < 7e-6


@pytest.mark.parametrize(("share", "told"), [(0.1, []), (0.22, [SPEED])])
def test_a_residual_follows_what_predicts_more_than_15_hundredths_of_it(share, told):
    t = np.arange(20_000) * 1e-3
    at = np.arange(t.size)
    phi, speed = 0.1 * np.sin(3.0 * t), np.cos(3.0 * t + 0.8) + 0.3 * np.cos(7.0 * t)
    rest = (speed - float(speed @ phi / (phi @ phi)) * phi)[: 390 * 51].reshape(390, 51).mean(axis=1)
    noise = np.random.default_rng(0).normal(size=390)
    noise *= np.std(rest) * np.sqrt(1.0 / share - 1.0) / np.std(noise)
    torque = 20.0 * phi + speed
    torque[1 : 1 + 390 * 51] += np.repeat(noise, 51)
    state = motion_rows_block(
        motion_rows_start(1),
        phi[:, None],
        np.ones((t.size, 1)),
        torque,
        (np.zeros(t.size), speed),
        at >= 0,
        at == 0,
        51,
        1e-3,
    )
    assert [found.suspect for found in followers(state, 0.001, 0.0)] == told


# --- the pneumatic joint


@pytest.mark.parametrize(("below", "told"), [(0.02, None), (0.07, 1), (0.14, "refused")])
def test_a_pressure_a_tenth_below_that_outside_is_not_absolute(below, told):
    pressure = np.array([4e5, (1.0 - below) * PAM.air.outside_pressure])
    if told == "refused":
        with pytest.raises(EstimatorError, match="not absolute"):
            _below_outside("pressure_1", pressure, 10.0, PAM_DEVICE)
    else:
        assert len(_below_outside("pressure_1", pressure, 10.0, PAM_DEVICE)) == bool(told)


def test_a_linear_flow_is_a_quarter_off_at_least(monkeypatch):
    monkeypatch.setattr(pam_ukf, "LinearPamFold", lambda *_, **__: None)  # which is compiled
    rng = np.random.default_rng(0)
    signals = signals_of(pressure_1=4e5 + 50.0 * rng.normal(size=100), pressure_2=4e5 + 50.0 * rng.normal(size=100))
    for flow, least, most in ((0.05, 0.18, 0.35), (0.4, 0.39, 0.41)):
        noise = estimate_of("pam-ukf", PAM_DEVICE, signals, PamTuning(model="linear", flow=flow), correct=True).noise
        assert least < noise.process[0] / noise.unknown_flow[0] < most


def pam_fold(period):
    return PamFold(PAM, period, pam_noise(PAM, period, (4.5e5, 4.5e5), (100.0, 100.0)))


def test_a_sample_of_more_than_a_thousand_steps_is_refused():
    step = 1.0 / pam_fold(1.0).steps if pam_fold(0.1).steps > 50 else 1.0
    assert 650 < pam_fold(700.0 * step).steps < 750
    with pytest.raises(EstimatorError, match="sample period"):
        pam_fold(1400.0 * step)


def test_a_missing_command_is_the_one_before_for_ten_samples():
    openings = np.full(30, np.nan)
    openings[:3] = 0.7
    held, age = _held(openings, 0.0, 0)
    assert np.isfinite(held).sum() == 3 + 10
    assert (held[:13] == 0.7).all()
    assert age == 27
    # However the log is cut.
    assert np.isfinite(_held(np.full(30, np.nan), 0.7, 4)[0]).sum() == 6


def test_a_volume_does_not_vanish_beyond_the_fitted_range():
    _, muscles, _, _, least, *_ = pam_fold(1e-3)._model
    for i, muscle in enumerate((PAM.muscle_1, PAM.muscle_2)):
        rest = float(muscle_volume(muscle, muscle.length))
        assert _volume(i, muscle.length, muscles, least) == pytest.approx(rest)
        far = min(_volume(i, x * muscle.length, muscles, least) for x in np.linspace(-3.0, 5.0, 81))
        assert 0.014 * rest < far < 0.028 * rest
