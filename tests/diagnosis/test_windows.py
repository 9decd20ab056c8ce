"""Simulation in windows: the states a motion began with are found, errors are those of noise, and the gain is counted right."""

from dataclasses import replace

import numpy as np
import pytest
from written_out import Truth, channels, drive, joint_of, log, motion, signals

from vsalog.core.errors import SimulationError
from vsalog.diagnosis.causes.base import with_part, with_signal
from vsalog.diagnosis.gain import Compared, compared
from vsalog.residuals import windows_mechanical
from vsalog.residuals.channels import channels_of
from vsalog.residuals.windows import Shot, Windows, begun, by_states, in_runs, in_windows, player_of, shoot, windows_of
from vsalog.residuals.windows_mechanical import Lengths
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

SECONDS, PERIOD = 6.0, 2e-3


@pytest.fixture(scope="module")
def clean():
    """A log of the rig's own physics by scipy, its windows, and the true motion.

    The encoders' steps are large enough to be reported as such; what drives the joint is recorded without noise.
    """
    time, said = log(duration=SECONDS, loud=6.0)
    said["motor_torque"] = drive(0)(time)
    windows = windows_of(joint_of(), channels_of(signals(said, PERIOD)), False)
    return windows, motion(Truth(), SECONDS, PERIOD, 0)[1]


def true_states(windows, moved):
    first = windows.spans[:, 0]
    q, a = moved["link_position"], moved["motor_position"]
    return np.stack([q[0][first], q[1][first], a[0][first], a[1][first]], axis=-1)


def test_windows_are_half_seconds_one_after_the_other(clean):
    windows, _ = clean
    assert np.all(np.diff(windows.spans, axis=1) == round(0.5 / PERIOD))
    assert np.all(windows.spans[1:, 0] >= windows.spans[:-1, 1])
    assert set(windows.roles) == {"motor_position", "link_position", "torque_sensor"}
    inside = windows.window
    for w, (first, last) in enumerate(windows.spans):
        assert np.all(inside[first:last] == w)
    assert np.count_nonzero(inside >= 0) == windows.spans.size // 2 * round(0.5 / PERIOD)


def test_from_the_true_states_the_simulation_is_the_motion(clean):
    """scipy's motion against the player's, window by window: what is left is what the sensors added, sample by sample."""
    windows, moved = clean
    shot = shoot(joint_of(), windows, true_states(windows, moved))
    inside = windows.window >= 0
    # Straight lines between the torque's samples are off by up to T²/8 of its curvature, 1.5e-4 N·m, and move it this far.
    for role, most in {"motor_position": 5e-5, "link_position": 5e-5, "torque_sensor": 5e-4}.items():
        added = windows.channels.raw[role] - moved[role][0]
        np.testing.assert_allclose(shot.errors[role][inside], added[inside], atol=most)
        assert np.isnan(shot.errors[role][~inside]).all()


def test_a_window_ends_where_the_next_one_begins(clean):
    """scipy's states at the beginnings of the windows that follow one another without a gap."""
    windows, moved = clean
    expected = true_states(windows, moved)
    ends = shoot(joint_of(), windows, expected).ends
    follow = np.flatnonzero(windows.spans[1:, 0] == windows.spans[:-1, 1]) + 1
    assert follow.size > 5
    # A velocity is that of one sample before: off by T times an acceleration of up to 60 rad/s².
    np.testing.assert_allclose(ends[follow - 1][:, [0, 2]], expected[follow][:, [0, 2]], atol=3e-4)
    np.testing.assert_allclose(ends[follow - 1][:, [1, 3]], expected[follow][:, [1, 3]], atol=60.0 * PERIOD)


@pytest.fixture(scope="module")
def bristled():
    """A joint whose motor's bristles give way by a fifth of its motion, played through, and its log without noise."""
    friction = type(joint_of().motor.friction)(coulomb=1.0, presliding_stiffness=20.0)
    joint = with_part(joint_of(), "motor", friction=friction)
    time = np.arange(round(SECONDS / PERIOD)) * PERIOD
    truth = play(build({"arm": joint}), {"arm": {"motor_torque": drive(0)}}, time)["arm"]
    said = {r: truth[r] for r in ("motor_position", "link_position")} | {"torque_sensor": truth["transmission_torque"]}
    windows = windows_of(joint, channels_of(signals(said | {"motor_torque": drive(0)(time)}, PERIOD)), False)
    names = ("link_position", "link_velocity", "motor_position", "motor_velocity")
    return joint, windows, np.stack([truth[n] for n in names], axis=-1)


@pytest.mark.parametrize("lead", [0.5, 0.0])
def test_bristles_are_run_in_before_a_window(bristled, monkeypatch, lead):
    """Begun with the true positions and velocities, but with bristles that nobody measured: they follow the motion before."""
    joint, windows, states = bristled
    monkeypatch.setattr(windows_mechanical, "FREE", Lengths(0.5, lead))
    off = []
    for w in range(2, len(windows.spans)):
        one = windows.part([w])
        errors = shoot(joint, one, states[one.spans[:, 0]]).errors["motor_position"]
        off.append(float(np.nanmax(np.abs(errors))))
    # Where the motor stuck for all of that time, nothing tells how far its bristles give way.
    assert (np.median(off) < 1e-3 * np.ptp(states[:, 2])) == (lead > 0.0)


def test_a_run_alone_is_simulated_as_it_is_among_others(bristled):
    """What bristles remember goes on within a run of windows, and not from one run to the next."""
    joint, windows, states = bristled
    first = windows.part([w for w in range(len(windows.spans)) if w not in (3, 7)])
    runs = np.cumsum(np.r_[True, first.spans[1:, 0] != first.spans[:-1, 1]])
    whole = in_windows(shoot(joint, first, states[first.spans[:, 0]]), first)
    for run in np.unique(runs):
        own = first.part(np.flatnonzero(runs == run))
        np.testing.assert_array_equal(in_windows(shoot(joint, own, states[own.spans[:, 0]]), own), whole[runs == run])


def test_steps_are_as_fine_as_a_vibrations_phase_asks_for():
    """Two inertias on a spring, let go: cos ωt, against RK4's phase error of angle⁴/120 of what the vibration turns.

    The vibration turns by 0.4 rad in a sample, so that a period takes two steps of 0.2 rad.
    """
    motor, link, turn = 0.02, 0.03, 0.4
    reduced = motor * link / (motor + link)
    text = (
        f"[joint.arm]\nkind = 'elastic'\n[joint.arm.motor]\ninertia = {motor}\n[joint.arm.transmission]\ntype = 'linear'\n"
        f"stiffness = {reduced * (turn / PERIOD) ** 2}\n[joint.arm.link]\ninertia = {link}\n[joint.arm.signals]\n"
        "motor_position = 'a'\nlink_position = 'q'\nmotor_torque = 'u'\n"
    )
    turned = turn * np.arange(2000)
    # The centre of mass rests: the link swings by the motor's part of the deflection.
    said = {"link_position": motor, "motor_position": -link}
    said = {role: 0.1 * part / (motor + link) * np.cos(turned) for role, part in said.items()}
    found = channels_of(signals({**said, "motor_torque": np.zeros_like(turned)}, PERIOD))
    windows = windows_of(joint_of(text), found, False)
    first = windows.spans[:, 0]
    speed = -np.sin(turned[first]) / np.cos(turned[first]) * turn / PERIOD
    q, a = (said[r][first] for r in ("link_position", "motor_position"))
    shot = shoot(joint_of(text), windows, np.stack([q, q * speed, a, a * speed], axis=-1))
    worst = np.nanmax(np.abs(shot.errors["link_position"])) / np.max(said["link_position"])
    most = 0.2**4 / 120.0 * turn * (windows.spans[0, 1] - windows.spans[0, 0])
    # Its amplitude falls by angle⁵/144 per step, a little less than that.
    assert most / 16.0 < worst < 2.0 * most


def surprise(shot, windows, expected):
    """How far states are from the true ones, over the spread that noise gives a least-squares fit of them, (JᵀJ)⁻¹."""
    J = by_states(joint_of(), windows, shot)
    spread = np.sqrt(np.stack([np.diag(np.linalg.inv(j.T @ j)) for j in J]))
    return (shot.states - expected) / spread


def test_the_states_a_motion_began_with_are_found(clean):
    """From the measured ones, whose velocities are derivatives of an encoder's steps, to as good as noise allows."""
    windows, moved = clean
    shot = begun(joint_of(), windows)
    assert np.sqrt(np.mean(surprise(shot, windows, true_states(windows, moved)) ** 2)) < 1.5
    assert np.all(np.mean(in_windows(shot, windows) ** 2, axis=1) < 1.3)


def test_they_are_found_from_far_off_too(clean):
    windows, moved = clean
    expected = true_states(windows, moved)
    away = expected + np.random.default_rng(0).standard_normal(expected.shape) * [0.01, 0.1, 0.01, 0.1]
    shot = begun(joint_of(), windows, away)
    assert np.sqrt(np.mean(surprise(shot, windows, expected) ** 2)) < 1.5
    assert np.all(np.mean(in_windows(shot, windows) ** 2, axis=1) < 1.3)


def test_windows_of_a_motor_that_sticks_are_begun_where_they_were():
    """Where it sticks, its velocity is none, and its derivative tells nothing."""
    truth = Truth(coulomb=1.2)
    found = channels(truth, duration=SECONDS)
    rubbing = with_part(joint_of(), "motor", friction=type(joint_of().motor.friction)(coulomb=1.2))
    windows = windows_of(rubbing, found, False)
    rates = motion(truth, SECONDS, PERIOD, 0)[1]["motor_position"][1][windows.spans[:, 0]]
    assert np.count_nonzero(np.abs(rates) < 1e-3) >= 2
    shot = begun(rubbing, windows)
    assert np.sqrt(np.mean(in_windows(shot, windows) ** 2)) < 1.5


def test_a_wrong_rig_cannot_hide_in_the_states(clean):
    windows, _ = clean
    wrong = with_part(joint_of(), "link", gravity_torque=1.8)
    assert np.mean(in_windows(begun(wrong, windows), windows) ** 2) > 20.0


def test_no_window_reaches_over_a_gap_or_into_what_is_not_known():
    _, said = log(duration=SECONDS)
    said["motor_position"] = said["motor_position"].copy()
    said["motor_position"][1000:1010] = np.nan
    bound = signals(said, PERIOD)
    bound.starts[2000] = True
    spans = windows_of(joint_of(), channels_of(bound), False).spans
    for first, last in spans:
        assert not (first < 2000 < last)
        assert last <= 1000 or first >= 1010
    assert len(spans) >= 7


def test_a_joint_without_its_own_torque_moves_as_its_encoder_says():
    """The motor's motion is prescribed; only the link and the torque sensor answer."""
    found = channels(duration=SECONDS, roles=["motor_position", "link_position", "torque_sensor"])
    windows = windows_of(joint_of(), found, False)
    assert set(windows.roles) == {"link_position", "torque_sensor"}
    shot = begun(joint_of(), windows)
    assert np.sqrt(np.nanmean(shot.errors["link_position"] ** 2)) < 5e-4


@pytest.mark.parametrize(
    ("roles", "words"),
    [
        (["link_position", "motor_torque"], "motor is not recorded"),
        (["link_position", "torque_sensor"], "motor is not recorded"),
    ],
)
def test_what_cannot_be_simulated_is_reported(roles, words):
    with pytest.raises(SimulationError, match=words):
        windows_of(joint_of(), channels(duration=2.0, roles=roles), False)


def test_a_log_shorter_than_a_window_is_reported():
    with pytest.raises(SimulationError, match=r"as long as 0\.5 s"):
        windows_of(joint_of(), channels(duration=0.4), False)


def test_sensors_that_the_rig_has_wrong_are_in_the_errors(clean):
    """An offset of the rig's torque sensor is an error of that size in its signal, and of no other."""
    windows, moved = clean
    states = true_states(windows, moved)
    off = with_signal(joint_of(), "torque_sensor", offset=0.3)
    plain, shifted = shoot(joint_of(), windows, states), shoot(off, windows, states)
    inside = windows.window >= 0
    np.testing.assert_allclose((plain.errors["torque_sensor"] - shifted.errors["torque_sensor"])[inside], 0.3)
    np.testing.assert_array_equal(plain.errors["link_position"][inside], shifted.errors["link_position"][inside])


def test_floors_are_what_noise_alone_makes(clean):
    """The rig is right: its error is the floor, in each role."""
    windows, _ = clean
    joint = joint_of()
    gain = compared(joint, joint, windows)
    assert gain.before is gain.after
    for role in windows.roles:
        assert gain.rmse(gain.before, role) == pytest.approx(gain.floor[role], rel=0.15), role


def test_noise_of_the_recorded_torque_is_in_the_floor():
    """A motor's torque recorded with ten times the noise moves the simulation; the encoder's floor must know."""
    time, said = log(duration=SECONDS)
    rng = np.random.default_rng(1)
    said["motor_torque"] = drive(0)(time) + 0.3 * rng.standard_normal(time.size)
    found = channels_of(signals(said, PERIOD))
    windows = windows_of(joint_of(), found, False)
    gain = compared(joint_of(), joint_of(), windows)
    assert gain.floor["motor_position"] > 1.5 * found.noise["motor_position"].floor
    assert gain.rmse(gain.before, "motor_position") == pytest.approx(gain.floor["motor_position"], rel=0.35)


def by_hand(before, after):
    """A comparison with these errors in windows of ten samples."""
    n = before.size
    spans = np.stack([np.arange(0, n, 10), np.arange(10, n + 1, 10)], axis=-1)
    found = channels(duration=1.0)
    windows = Windows(replace(found, raw={"x": np.arange(float(n))}, noise={}), spans, ("x",), False)
    return Compared(
        windows, *(Shot(spans, {"x": x}, np.full(spans.shape, np.nan)) for x in (before, after)), {"x": 1.0}
    )


def test_the_reduction_and_its_interval_are_those_of_a_bootstrap_by_hand():
    """Windows are drawn again, with their errors; not samples."""
    rng = np.random.default_rng(2)
    size = np.repeat(rng.uniform(0.5, 3.0, 40), 10)
    before, after = size * rng.standard_normal(400), 0.4 * size * rng.standard_normal(400)
    reduction, (low, high) = by_hand(before, after).reduction("x")
    b, a = (np.sum(e.reshape(40, 10) ** 2, axis=1) for e in (before, after))
    assert reduction == pytest.approx(1 - np.sqrt(a.sum() / b.sum()))
    drawn = []
    for _ in range(4000):
        i = rng.integers(0, 40, 40)
        drawn.append(1 - np.sqrt(a[i].sum() / b[i].sum()))
    expected = np.quantile(drawn, [0.025, 0.975])
    np.testing.assert_allclose([low, high], expected, atol=0.015)
    assert low < reduction < high


def test_the_error_is_that_of_the_samples_in_the_windows():
    before = np.arange(100.0)
    gain = by_hand(before, 0.5 * before)
    assert gain.rmse(gain.before, "x") == pytest.approx(np.sqrt(np.mean(before**2)))
    assert gain.reduction("x")[0] == pytest.approx(0.5)
    assert gain.reduction("x")[1] == pytest.approx((0.5, 0.5))


def test_the_right_rig_helps_and_the_wrong_one_does_not(clean):
    windows, _ = clean
    wrong = with_part(joint_of(), "motor", damping=0.08)
    assert compared(wrong, joint_of(), windows).helps
    assert not compared(joint_of(), wrong, windows).helps


@pytest.mark.parametrize("delay", [-0.04, -0.003, 0.003, 0.04])
@pytest.mark.parametrize("role", ["motor_position", "link_position"])
def test_windows_of_a_plain_rig_hold_for_one_whose_encoder_is_late_or_early(clean, role, delay):
    """What windows begin with is known with the delay that is found, too, which reaches over what a filter leaves unknown."""
    windows, moved = clean
    late = with_signal(joint_of(), role, delay=delay)
    states = player_of(late, windows.channels).measured_states()[windows.spans[:, 0]]
    assert np.isfinite(states).all()
    shot = shoot(late, windows, true_states(windows, moved))
    time = np.arange(windows.channels.time.size) * PERIOD
    inside = windows.window >= 0
    expected = windows.channels.raw[role] - np.interp(time - delay, time, moved[role][0])
    # Over 40 ms beyond a window's end the motion is not quite a parabola; over 3 ms it is, to the encoder's step.
    most = 1e-4 if abs(delay) < 0.01 else 0.02
    np.testing.assert_allclose(shot.errors[role][inside], expected[inside], atol=most)


def test_a_late_torque_was_recorded_before_its_window(clean):
    """Each window played alone is simulated as in a row: its first torque is that of before it, not its own first sample."""
    windows, moved = clean
    late = with_part(joint_of(), "motor", torque_delay=0.02)
    states = true_states(windows, moved)
    row = shoot(late, windows, states).errors["motor_position"]
    third = windows.part([2])
    alone = shoot(late, third, states[2:3]).errors["motor_position"]
    first, last = third.spans[0]
    np.testing.assert_allclose(alone[first:last], row[first:last], atol=1e-9)


def test_a_long_log_is_simulated_in_forty_windows():
    time = np.arange(8000) * 5e-3
    said = {
        role: np.sin((k + 1.0) * time)
        for k, role in enumerate(("motor_position", "link_position", "motor_torque", "torque_sensor"))
    }
    assert len(windows_of(joint_of(), channels_of(signals(said, 5e-3)), False).spans) == 40


def test_a_long_log_is_simulated_in_four_runs():
    chosen = in_runs(100, 40)
    assert np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1)[0].tolist() == list(range(10))
    assert np.count_nonzero(np.diff(chosen) > 1) == 3


@pytest.mark.parametrize(("share", "length"), [(0.0, 20), (0.05, 20), (0.1, 25), (1.0, 250)])
def test_the_first_part_of_a_window_has_twenty_samples_at_least(share, length):
    windows = Windows(None, np.array([[0, 250], [250, 500]]), (), False)
    np.testing.assert_array_equal(windows.first(share).spans, [[0, length], [250, 250 + length]])


@pytest.mark.parametrize(("times", "within"), [(1.8, True), (2.5, False)])
def test_an_error_of_up_to_twice_its_noise_is_within_it(times, within):
    gain = by_hand(np.zeros(100), np.full(100, times))
    assert gain.within(gain.after) is within
