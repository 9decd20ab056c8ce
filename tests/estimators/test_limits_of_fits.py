"""What an estimator takes for enough and for little, from both sides: windows, shares of a stiffness, samples of a fit."""

from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from vsalog.core.basis import PolynomialBasis
from vsalog.core.errors import EstimatorError
from vsalog.core.signals import JointSignals
from vsalog.estimators.averaging_error import _course
from vsalog.estimators.device import device_of
from vsalog.estimators.equation import power_kept
from vsalog.estimators.friction_compensation import FrictionCompensation, doubt_role
from vsalog.estimators.known_effects import known_of
from vsalog.estimators.link_impedance import _noise
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.residual_motion import least_change
from vsalog.estimators.screening import screened
from vsalog.estimators.solvers import least_samples
from vsalog.estimators.state_observer import state_columns
from vsalog.estimators.torque_offset import _offset
from vsalog.estimators.tuning import RlsTuning, Tuning, read_tuning, usual_regressor
from vsalog.estimators.windows import KEPT, Behind, _shorter, suitable_windows
from vsalog.filters.savitzky_golay import savgol_filter
from vsalog.rig import Rig
from vsalog.rig.schema import Friction

SEA = Rig.preset("sea").file.joint["sea"]


def signals_of(period=1e-3, **roles):
    n = len(next(iter(roles.values())))
    starts = np.arange(n) == 0
    stamps = np.arange(n) * round(period * 1e9)
    return JointSignals("sea", period, stamps, np.arange(n) * period, roles, starts, np.zeros(n, dtype=np.int32))


def swinging(n, period=1e-3, rate=3.0):
    """A motor and a link that swing slowly, without any noise."""
    t = np.arange(n) * period
    theta = np.sin(rate * t)
    return signals_of(period, motor_position=theta, link_position=theta + 0.2 * np.sin(rate * t + 1.0))


def test_windows_of_derivatives_are_half_as_wide_again():
    signals = swinging(20_000)
    device = device_of("sea", SEA, signals.roles)
    plain, wide = (suitable_windows(device, signals, Tuning(), order)[0] for order in (None, 2))
    assert plain == 51
    assert wide / plain == pytest.approx(1.5, abs=0.05)


@pytest.mark.parametrize(("samples", "windows"), [(1020, [51, 101]), (1004, [51]), (2020, [51, 101, 201])])
def test_no_window_is_longer_than_a_tenth_of_the_run(samples, windows):
    signals = swinging(samples)
    assert suitable_windows(device_of("sea", SEA, signals.roles), signals, Tuning()) == windows


@pytest.mark.parametrize(("window", "shorter"), [(0.11, False), (0.2, True)])
def test_shorter_windows_than_the_usual_are_tried_where_that_is_longer_than_150_ms(window, shorter):
    assert bool(_shorter(swinging(1000, window / 51), Tuning(), 51)) == shorter


@pytest.mark.parametrize(("window", "kept", "enough"), [(25, 0.9996, True), (25, 0.999, False), (51, 0.985, True)])
def test_a_window_shorter_than_the_usual_has_to_keep_all_but_a_2000th_of_the_power(window, kept, enough):
    assert (kept >= Behind(window, np.ones(1), np.zeros(1)).least_kept[0]) == enough


@pytest.mark.parametrize(("noise", "quiet"), [(0.04, True), (0.07, False)])
def test_a_rate_is_quiet_whose_noise_is_below_a_twentieth(noise, quiet):
    assert Behind(51, np.ones(1), np.full(1, noise)).quiet == quiet


@pytest.mark.parametrize(("lost", "kept"), [(0.007, True), (0.014, False)])
def test_a_window_keeps_a_motion_that_loses_less_than_a_hundredth(lost, kept):
    assert (power_kept(lost) >= KEPT) == kept


@pytest.mark.parametrize(("change", "told"), [(0.02, False), (0.045, True)])
def test_a_change_of_a_stiffness_is_reported_beyond_three_hundredths(change, told):
    assert (change > least_change(0.0)) == told


@pytest.mark.parametrize(("std", "supported"), [(0.15, True), (0.3, False)])
def test_a_stiffness_is_supported_where_its_deviation_is_below_a_fifth(std, supported):
    one = np.ones(1)
    assert state_columns(one, one, 20.0 * one, 20.0 * std * one, one > 0.0)["excited"][0] == supported
    assert not state_columns(one, one, -20.0 * one, 20.0 * std * one, one > 0.0)["excited"][0]


@pytest.mark.parametrize(("share", "told"), [(0.4, []), (0.7, [0.7])])
def test_what_is_in_doubt_in_most_of_a_log_is_reported(share, told):
    fold = RegressionFold("x", "x", SimpleNamespace(joint="sea"), SimpleNamespace(window=51), (), None)
    state = SimpleNamespace(doubted={"1": int(1000 * share)}, seen=1000)
    assert [finding.value for finding in fold.findings(state)] == told


def test_a_deflection_counts_as_covered_two_windows_later():
    fold = RegressionFold("x", "x", None, SimpleNamespace(window=51), (), None)
    assert 1.5 * 51 < fold.delay < 3 * 51


@pytest.mark.parametrize(("window", "enough"), [(501, 2505), (251, 1255)])
def test_five_windows_of_a_filter_tell_how_large_slow_noise_is(window, enough):
    assert least_samples(SimpleNamespace(kind="savitzky-golay", window=window)) == enough


@pytest.mark.parametrize(("degree", "found"), [(4, True), (5, False)])
def test_a_stiffness_s_course_is_a_polynomial_of_fourth_degree(degree, found):
    phi = np.linspace(-1.0, 1.0, 2001)
    course = _course(phi, np.ones(phi.size), phi**degree, 1.0)
    assert np.allclose(course.at(phi), phi**degree, atol=1e-6) == found


@pytest.mark.parametrize(("independent", "terms"), [(9.1, 3), (5.9, 1), (12.1, 4)])
def test_a_term_of_a_course_takes_three_independent_samples(independent, terms):
    phi = np.linspace(-1.0, 1.0, 2001)
    assert _course(phi, np.ones(phi.size), phi, phi.size / independent).terms.size == terms


@pytest.mark.parametrize(("steps", "small"), [(3, True), (6, False)])
def test_a_deflection_of_fewer_than_four_steps_is_too_small(steps, small):
    phi = 1e-3 * (np.arange(3000) // 7 % (steps + 1))
    signals = signals_of(motor_position=np.zeros(3000), deflection=phi)
    found = screened(device_of("sea", SEA, signals.roles), signals, Tuning()).findings
    assert [f.code for f in found] == ["deflection.too_small"] * small


@pytest.mark.parametrize(("steps", "small"), [(30, True), (60, False)])
def test_the_steps_of_positions_that_pass_more_than_forty_even_out(steps, small):
    theta = 1e-3 * (np.arange(9000) // 7 % (steps + 1))
    signals = signals_of(motor_position=theta, link_position=theta + 1e-3 * (np.arange(9000) % 2))
    found = screened(device_of("sea", SEA, signals.roles), signals, Tuning()).findings
    assert [f.code for f in found] == ["deflection.too_small"] * small


def reaching(x, powers=1, setpoint=None):
    """What the functions of a basis reach that are x at a log's largest deflection."""
    roles = {"motor_position": np.zeros(2), "link_position": np.array([0.0, x])}
    device = device_of("sea", SEA)
    if setpoint is not None:
        roles["setpoint"] = np.full(2, setpoint)
    basis = PolynomialBasis.make(powers, setpoint_order=1 if setpoint is None else 3)
    view = SimpleNamespace(
        joint="sea", transmissions=device.transmissions, basis=basis, has_setpoint=setpoint is not None
    )
    return lambda second=False: usual_regressor(view, signals_of(**roles), second=second)


def test_a_scale_far_off_is_refused():
    assert reaching(0.7e50)() == pytest.approx(0.7e50)
    assert reaching(1.0 / 0.7e50)() == pytest.approx(1.0 / 0.7e50)
    for x in (1.4e50, 1.0 / 1.4e50):
        with pytest.raises(EstimatorError, match="deflection_scale"):
            reaching(x)()


def test_the_usual_function_is_a_ten_thousandth_of_the_largest_at_least():
    # Of 1, c, c² the geometric mean is c, a part 1/c of the largest.
    assert reaching(1.0, setpoint=0.7e4)() == pytest.approx(0.7e4)
    assert reaching(1.0, setpoint=1.4e4)() == pytest.approx(1.4e4 * 1.4)


def test_the_second_function_is_a_tenth_of_the_first_at_least():
    for x, usual in ((0.14**0.5, 0.14**1.5), (0.07**0.5, 0.1 * 0.07**0.5)):
        assert reaching(x, 2)(second=True) == pytest.approx(usual)


@pytest.mark.parametrize("name", ["window", "settle"])
def test_no_time_is_longer_than_twelve_days(name):
    assert getattr(read_tuning(RlsTuning, "direct", {name: "900000"}), name) == 9e5
    with pytest.raises(EstimatorError, match="at most"):
        read_tuning(RlsTuning, "direct", {name: "1100000"})


def rubbing(level=0.5):
    motor = replace(SEA.motor, friction=Friction(coulomb=level))
    return device_of("sea", replace(SEA, motor=motor))


def compensated(n=400, turn=200.3, period=1e-3):
    """A motor that turns round once, between two samples, with the samples that come out at once."""
    signals = signals_of(period, motor_position=0.5 * ((np.arange(n) - turn) * period) ** 2, motor_torque=np.zeros(n))
    device = rubbing()
    made = FrictionCompensation(device.transmissions, signals, "savitzky-golay", 6.0)
    return made, np.concatenate(
        [rows.roles[doubt_role(device.transmissions[0])] for rows in made.step(made.start(), signals)[1]]
    )


def test_the_direction_of_friction_is_seen_within_ten_samples():
    """Slow motion is seen, and a turn that another 21 samples later is followed by a turn back."""
    made, doubt = compensated()
    assert doubt.size == 400 - 10
    assert np.flatnonzero(np.isfinite(doubt))[0] <= 10
    t = np.arange(60) * 1e-3
    np.testing.assert_allclose(savgol_filter(t**3, made.weights)[0], 3.0 * t[10:-10] ** 2, atol=1e-9)


def test_a_turn_is_in_doubt_for_two_samples_to_either_side():
    _, doubt = compensated()
    assert np.flatnonzero(doubt[20:380]).tolist() == [179, 180, 181, 182]  # 199 to 202, around 200.3


@pytest.mark.parametrize(("share", "borne"), [(0.07, True), (0.14, False)])
def test_doubt_is_borne_up_to_a_tenth_of_friction(share, borne):
    device = rubbing(0.5)
    signals = signals_of(motor_position=np.zeros(9), link_position=np.zeros(9), motor_torque=np.linspace(0.0, 1e-3, 9))
    known = known_of(device, device.transmissions[0], signals, Tuning(), "motor_torque", motor=True)
    block = SimpleNamespace(
        rows=np.zeros(1), fit={"motor_position": np.zeros(1), "link_position": np.zeros(1),
        doubt_role(device.transmissions[0]): np.full(1, share * 0.5)},
    )  # fmt: skip
    assert (known.block(known.start(), block)[2][0] <= 1.0) == borne


@pytest.mark.parametrize(("times", "whole"), [(7.0, True), (14.0, False)])
def test_a_link_is_at_most_ten_times_as_easy_to_move_as_the_log_s_torques_say(times, whole):
    """Its damping takes up nearly all of the torque, so that a small part of that makes the accelerations."""
    rng = np.random.default_rng(0)
    rate, moves = rng.normal(size=(2, 4000))
    u = rate + moves / times
    acceleration = 5.0 * moves / times
    signals = signals_of(link_position=np.cumsum(rate) * 1e-3)
    noise = _noise(signals, u, u, rate, acceleration, 0.0)
    assert (noise.first_mobility == pytest.approx(5.0, rel=0.01)) == whole


@pytest.mark.parametrize(("times", "told"), [(20.0, False), (45.0, True)])
def test_an_offset_is_reported_where_a_ramp_alone_leaves_thirty_times_as_much(times, told):
    n, period = 4000, 1e-3
    t = (np.arange(n) - 0.5 * n) * period
    # A spring's momentum that goes with the ramp in part; what is left of it next to a ramp has the deviation 1.
    swing = np.sin(9.0 * t)
    swing -= np.polynomial.Polynomial.fit(t, swing, 1)(t)
    swing /= np.std(swing)
    F = np.column_stack((np.ones(n), swing + 2.0 * t))
    noise = np.where(np.arange(n) % 2, 1.0, -1.0) / times
    equation = SimpleNamespace(period=period, torque_noise=1e-9, leading=1)
    found = _offset(
        F, 1.0 * F[:, 1] + 0.5 * t + noise, np.column_stack((np.zeros(n), np.ones(n)))[:, 1:], np.arange(n), equation
    )
    assert (found is not None) == told
    if told:
        assert found == pytest.approx(0.5, rel=0.02)
