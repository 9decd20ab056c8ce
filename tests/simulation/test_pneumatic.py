"""The pneumatic joint against equations written out by hand and integrated by scipy, and against what physics conserves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from pam_reference import (
    PAM,
    SEALED,
    SLIPPING,
    SMOOTH,
    STRETCH,
    STUCK,
    Array,
    assert_close_in_range,
    drive,
    equations,
    level,
    opening,
    replace,
    seconds,
    solved,
    states,
    stretches,
)
from scipy.integrate import quad, solve_ivp

from vsalog.mechanics.pneumatic_friction import friction_level, kikuuwe_friction
from vsalog.mechanics.pneumatics import joint_torque, muscle_lengths, muscle_volume
from vsalog.rig.schema import (
    PneumaticJoint,
    SimpleFriction,
)
from vsalog.simulation.inputs import TorqueInput
from vsalog.simulation.pneumatic import simulate_pneumatic


def test_without_friction_it_agrees_with_an_independent_integrator() -> None:
    time, u1, u2 = seconds(10.0), stretches(1, 20), stretches(2, 20)
    truth = simulate_pneumatic(SMOOTH, {"valve_1": u1, "valve_2": u2}, time)
    pieces, x = [], states(truth)[:, 0]
    for first in range(0, time.size - 1, STRETCH):
        alphas = (opening(u1[first]), opening(u2[first]))
        piece = solved(x, time[first : first + STRETCH + 1], lambda t, a=alphas: a, lambda t: 0.0)
        pieces.append(piece[:, :-1])
        x = piece[:, -1]
    expected = np.concatenate([*pieces, x[:, None]], axis=1)
    assert np.ptp(expected[0]) > 0.1
    assert_close_in_range(states(truth), expected, 1e-6)


def test_continuous_inputs_agree_with_an_independent_integrator() -> None:
    time = seconds(10.0)

    def volts(t: Array, sign: float) -> Array:
        return np.asarray(5.2 + sign * 0.7 * np.sin(2.0 * np.pi * 0.3 * t))

    def push(t: Array) -> Array:
        return np.asarray(0.3 * np.sin(2.0 * np.pi * 1.1 * t))

    inputs: dict[str, TorqueInput] = {
        "valve_1": lambda t: volts(t, 1.0),
        "valve_2": lambda t: volts(t, -1.0),
        "external_torque": push,
    }
    truth = simulate_pneumatic(SMOOTH, inputs, time)

    def alphas(t: float) -> tuple[float, float]:
        return opening(float(volts(np.array(t), 1.0))), opening(float(volts(np.array(t), -1.0)))

    expected = solved(states(truth)[:, 0], time, alphas, lambda t: float(push(np.array(t))))
    assert_close_in_range(states(truth), expected, 1e-6)


def test_slipping_one_way_agrees_with_an_independent_integrator() -> None:
    # A push that grows keeps the joint slipping towards positive angles.
    time, start = seconds(1.0), np.array([-0.3, 0.5, 4e5, 4e5])
    inputs: dict[str, TorqueInput] = {"valve_1": 5.0, "valve_2": 4.5, "external_torque": lambda t: 3.0 * t - 1.8}
    truth = simulate_pneumatic(PAM, inputs, time, start=start)
    # The first swing ends before the slow motion begins; that part is the next test's.
    begin = int(np.flatnonzero(truth["link_velocity"] <= 0.0)[-1]) + 1
    assert time[begin] < 0.5
    after = slice(begin, None)
    solution = solve_ivp(
        lambda t, x: equations(x, (opening(5.0), opening(4.5)), 3.0 * t - 1.8, SLIPPING),
        (time[begin], time[-1]), states(truth)[:, begin] * [1.0, 1.0, 1e-5, 1e-5],
        "DOP853", time[after], rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    expected = solution.y * np.array([[1.0], [1.0], [1e5], [1e5]])
    assert_close_in_range(states(truth)[:, after], expected, 1e-6)


def test_stick_and_slip_agree_with_an_integrator_that_stops_at_events() -> None:
    time, alphas = seconds(3.0), (opening(5.0), opening(4.6))

    def push(t: float) -> float:
        return float(0.8 * np.sin(2.0 * np.pi * 0.7 * t) + 0.3 * np.sin(2.0 * np.pi * 3.1 * t))

    inputs: dict[str, TorqueInput] = {
        "valve_1": 5.0,
        "valve_2": 4.6,
        "external_torque": lambda t: 0.8 * np.sin(2.0 * np.pi * 0.7 * t) + 0.3 * np.sin(2.0 * np.pi * 3.1 * t),
    }
    start = np.array([0.0, 0.0, 4e5, 4e5])
    truth = simulate_pneumatic(PAM, inputs, time, start=start)

    t, x, way, expected, changes = 0.0, start * [1.0, 1.0, 1e-5, 1e-5], STUCK, np.empty((4, time.size)), 0
    while t < time[-1]:

        def ends(t: float, x: Array, way: float | None = way) -> float:
            return level(x) - abs(drive(x, push(t))) if way is STUCK else x[1] * way

        ends.terminal, ends.direction = True, -1.0  # type: ignore[attr-defined]
        piece = solve_ivp(
            lambda t, x, way=way: equations(x, alphas, push(t), way),
            (t, time[-1]), x, "DOP853", rtol=1e-10, atol=1e-12, events=ends, dense_output=True, max_step=2e-3,
        )  # fmt: skip
        inside = (time >= t) & (time <= piece.t[-1])
        expected[:, inside] = piece.sol(time[inside])
        t, x, changes = float(piece.t[-1]), piece.y[:, -1].copy(), changes + 1
        x[1] = 0.0
        # Just after sticking ends the torque is the level's but for rounding.
        way = float(np.sign(drive(x, push(t)))) if abs(drive(x, push(t))) > level(x) - 1e-9 else STUCK
    assert changes > 15
    expected *= np.array([[1.0], [1.0], [1e5], [1e5]])
    assert_close_in_range(states(truth), expected, 1e-6)
    stuck = truth["link_velocity"] == 0.0
    assert 0.05 < stuck.mean() < 0.95
    assert truth["link_acceleration"][stuck] == pytest.approx(0.0, abs=1e-9)


def test_kikuuwes_implicit_steps_come_to_the_same_motion_at_first_order() -> None:
    # The paper's own discretisation (eq. 10), by Euler steps of τ, with the pressures fixed.
    start, duration = np.array([0.25, 0.0, 3e5, 3e5]), 0.4
    sealed = replace(SEALED, friction=PAM.friction, air=replace(PAM.air, volume_index=1e-12))
    time = seconds(duration)
    exact = simulate_pneumatic(sealed, {"valve_1": 5.0, "valve_2": 5.0}, time, start=start)["link_position"]
    errors = []
    for parts in (5, 10, 20):
        step, psi, v, worst = 1e-3 / parts, 0.25, 0.0, 0.0
        for k in range(1, parts * (time.size - 1) + 1):
            x = np.array([psi, v, 3.0, 3.0])
            free = v + step / 4.263e-4 * drive(x, 0.0)
            v = free - step / 4.263e-4 * float(kikuuwe_friction(free, level(x), 2.256e-3, step / 4.263e-4))
            psi += step * v
            if k % parts == 0:
                worst = max(worst, abs(psi - float(exact[k // parts])))
        errors.append(worst)
    assert errors[-1] < 1e-3
    assert 1.7 < errors[0] / errors[1] < 2.3
    assert 1.7 < errors[1] / errors[2] < 2.3


@pytest.mark.parametrize("joint", [SMOOTH, PAM], ids=["without friction", "with stick and slip"])
def test_the_error_falls_with_the_fourth_power_of_the_step(joint: PneumaticJoint) -> None:
    time = seconds(4.0)
    inputs: dict[str, TorqueInput] = {
        "valve_1": stretches(3, 8),
        "valve_2": stretches(4, 8),
        "external_torque": lambda t: 0.8 * np.sin(2.0 * np.pi * 0.7 * t) + 0.3 * np.sin(2.0 * np.pi * 3.1 * t),
    }
    fine = states(simulate_pneumatic(joint, inputs, time, steps=32))
    errors = [np.abs(states(simulate_pneumatic(joint, inputs, time, steps=n)) - fine).max(axis=1) for n in (1, 2, 4)]
    for coarse, finer in pairwise(errors):
        order = np.log2(coarse / finer)
        assert ((order > 3.5) & (order < 4.7)).all(), order


def test_all_eighteen_modes_are_reached() -> None:
    # Voltages from empty to full in every pairing, and a push that makes the joint slip now and then.
    volts = [3.6, 4.5, 6.3]
    pairs = [(a, b) for a in volts for b in volts]
    hold = 4000
    u1, u2 = (np.append(np.repeat([p[i] for p in pairs], hold), pairs[-1][i]) for i in (0, 1))
    time = np.arange(u1.size) * 1e-3
    push = np.where(np.sin(2.0 * np.pi * 0.4 * time) > 0.7, 2.0 * np.sin(2.0 * np.pi * 5.0 * time), 0.0) * 0.5
    # Wide valves, so that four seconds are enough.
    wide = {key: replace(getattr(PAM, key), area_scale=6.0) for key in ("valve_1", "valve_2")}
    tame = replace(PAM, friction=SimpleFriction(level=0.35), **wide)
    truth = simulate_pneumatic(tame, {"valve_1": u1, "valve_2": u2, "external_torque": push}, time)
    assert set(truth["mode"]) == set(range(1, 19))
    # Each mode by its definition: critical ratio 0.5283.
    slips = truth["link_velocity"] != 0.0
    choked_in = [truth[f"pressure_{i}"] <= 0.52828 * 7.1e5 for i in "12"]
    choked_out = [truth[f"pressure_{i}"] >= 1.013e5 / 0.52828 for i in "12"]
    zones = [out + (1 - into.astype(int)) for into, out in zip(choked_in, choked_out, strict=True)]
    expected = 1 + 9 * slips + 3 * zones[0] + zones[1]
    # A joint that is about to slip has no velocity yet.
    assert (truth["mode"] == expected).mean() > 0.99


def test_locked_air_keeps_its_polytropic_constant() -> None:
    time = seconds(3.0)
    inputs: dict[str, TorqueInput] = {
        "valve_1": 5.0,
        "valve_2": 5.0,
        "external_torque": lambda t: 1.5 * np.sin(2.0 * np.pi * t),
    }
    truth = simulate_pneumatic(SEALED, inputs, time, start=np.array([0.1, 0.0, 3e5, 4e5]))
    for i, (muscle, length) in enumerate(
        zip((SEALED.muscle_1, SEALED.muscle_2), muscle_lengths(SEALED, truth["link_position"]), strict=True), 1
    ):
        constant = truth[f"pressure_{i}"] * muscle_volume(muscle, length) ** 0.4545
        assert np.ptp(truth[f"pressure_{i}"]) > 1e4
        assert constant == pytest.approx(constant[0], rel=1e-7)


def test_locked_air_conserves_energy() -> None:
    # The torque is then a function of the angle alone, so that kinetic energy and its integral add up to a constant.
    truth = simulate_pneumatic(
        SEALED, {"valve_1": 5.0, "valve_2": 5.0}, seconds(3.0), start=np.array([0.2, 0.0, 3e5, 4e5])
    )
    muscles = (SEALED.muscle_1, SEALED.muscle_2)
    before = [float(muscle_volume(m, x)) for m, x in zip(muscles, muscle_lengths(SEALED, 0.2), strict=True)]

    def torque(psi: float) -> float:
        now = [float(muscle_volume(m, x)) for m, x in zip(muscles, muscle_lengths(SEALED, psi), strict=True)]
        p1, p2 = (p * (a / b) ** 0.4545 for p, a, b in zip((3e5, 4e5), before, now, strict=True))
        return float(joint_torque(SEALED, psi, p1, p2)) - 4.117e-4 * psi

    picked = slice(0, None, 97)
    work = np.array([quad(torque, 0.2, psi, epsabs=1e-13)[0] for psi in truth["link_position"][picked]])
    kinetic = 0.5 * 4.263e-4 * truth["link_velocity"][picked] ** 2
    assert np.ptp(work) > 0.02
    assert np.abs(kinetic - work).max() < 1e-5 * np.ptp(work)


def test_friction_only_takes_energy_out() -> None:
    truth = simulate_pneumatic(
        PAM,
        {"valve_1": stretches(5, 8), "valve_2": stretches(6, 8), "external_torque": lambda t: np.sin(9.0 * t)},
        seconds(4.0),
    )
    power = truth["friction_torque"] * truth["link_velocity"]
    assert power.min() >= 0.0
    assert power.max() > 0.01
    pulls_now = (truth["muscle_force_1"], truth["muscle_force_2"])
    limit = friction_level(PAM, truth["pressure_1"], truth["pressure_2"], *pulls_now, truth["link_velocity"])
    stuck = truth["link_velocity"] == 0.0
    assert stuck.any()
    assert (np.abs(truth["friction_torque"][stuck]) <= limit[stuck] + 1e-9).all()
