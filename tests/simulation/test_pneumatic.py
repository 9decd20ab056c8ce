"""The pneumatic joint against equations written out here and integrated by scipy, and against what physics conserves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp

from vsalog.errors import SimulationError
from vsalog.mechanics.pneumatic_friction import friction_level, kikuuwe_friction
from vsalog.mechanics.pneumatics import joint_torque, muscle_lengths, muscle_volume, pressure_rate, valve_flow
from vsalog.rig import Rig
from vsalog.rig.schema import (
    BraidForce,
    ExponentialForce,
    PneumaticJoint,
    SimpleFriction,
    SpringForce,
    TonduFriction,
)
from vsalog.simulation.inputs import TorqueInput
from vsalog.simulation.pneumatic import simulate_pneumatic

Array = NDArray[np.float64]
replace = msgspec.structs.replace
STRETCH = 500  # samples over which a voltage is held
SLIPPING, FREE, STUCK = 1.0, 0.0, None


def pam() -> PneumaticJoint:
    joint = Rig.preset("pam").joints["pam"]
    assert isinstance(joint, PneumaticJoint)
    return joint


PAM = pam()
SMOOTH = replace(PAM, friction=None)
# The same muscle twice, so that equal voltages balance.
EQUAL = replace(PAM, muscle_2=PAM.muscle_1)
# Sealed off: no air comes or goes.
SEALED = replace(
    SMOOTH,
    valve_1=replace(PAM.valve_1, inflow_area=0.0, outflow_area=0.0),
    valve_2=replace(PAM.valve_2, inflow_area=0.0, outflow_area=0.0),
)


def seconds(duration: float) -> Array:
    return np.arange(round(duration * 1000) + 1) * 1e-3


def stretches(seed: int, count: int, low: float = 4.0, high: float = 6.3) -> Array:
    values = np.random.default_rng(seed).uniform(low, high, count)
    return np.append(np.repeat(values, STRETCH), values[-1])


def opening(voltage: float) -> float:
    return float(np.interp(voltage, [0, 4, 5, 5.5, 6, 6.5, 10], [0, 0.2, 0.44, 0.5, 0.6, 0.8, 1]))


def nozzle(up: float, down: float) -> float:
    """Flow per area in g/s/mm² at pressures in bar, by the flow function of the textbooks; 1 bar mm² = 0.1 N."""
    r = max(down / up, (2.0 / 2.4) ** 3.5)
    return 0.1 * up * np.sqrt(7.0 * (r ** (10.0 / 7.0) - r ** (12.0 / 7.0)) / (287.0 * 293.0)) * 1e3


def pulls(psi: float, a: float, b: float) -> tuple[float, float]:
    """Muscles' pulls [N] at pressures in bar, Table II (with the sign of p_w22 turned)."""
    l1, l2 = 0.165 - 0.0365 * np.sin(psi), 0.165 + 0.0365 * np.sin(psi)
    f1 = (7.045e-3 * l1 - 1.017e-3) * a * 1e5 - 556.8 * l1 + 72.86
    f2 = (6.423e-3 * l2 - 9.184e-4) * b * 1e5 - 197.8 * l2 + 15.75
    return f1, f2


def drive(x: Array, push: float) -> float:
    f1, f2 = pulls(x[0], x[2], x[3])
    return 0.0365 * np.cos(x[0]) * (f1 - f2) - 4.117e-4 * x[0] + push


def level(x: Array) -> float:
    f1, f2 = pulls(x[0], x[2], x[3])
    tube = 4e8 * sum((1e5 * p - 101300.0) ** -2.0 for p in x[2:])
    return 0.006 * 0.2 * abs(f1 + f2 - 0.256 * 9.8) + tube


def equations(x: Array, alphas: tuple[float, float], push: float, way: float | None) -> list[float]:
    """Eq. 11 of the paper for (ψ, ψ̇, P₁, P₂) with pressures in bar, slipping in direction `way`, stuck, or free."""
    psi, omega = x[0], x[1]
    if way is STUCK:
        out, omega = [0.0, 0.0], 0.0
    else:
        friction = 0.0 if way == FREE else 2.256e-3 * omega + way * level(x)
        out = [omega, (drive(x, push) - friction) / 4.263e-4]
    for i, sign in ((0, -1.0), (1, 1.0)):
        p, l = x[2 + i], 0.165 + sign * 0.0365 * np.sin(psi)  # noqa: E741
        volume = -2.44e-2 * l * l + 6.824e-3 * l - 4.254e-4
        swelling = (2.0 * -2.44e-2 * l + 6.824e-3) * sign * 0.0365 * np.cos(psi) * omega
        m = alphas[i] * nozzle(7.1, p) - (1.0 - alphas[i]) * nozzle(p, 1.013)
        m *= (0.05184 if m > 0.0 else 0.07776) * 1e-3
        out.append(1.1 * 287.0 * 293.0 * m / volume * 1e-5 - 0.4545 * swelling / volume * p)
    return out


def solved(
    start: Array, time: Array, alphas: Callable[[float], tuple[float, float]], push: Callable[[float], float]
) -> Array:
    """Integrate without friction, shape (4, N), pressures in Pa."""
    solution = solve_ivp(
        lambda t, x: equations(x, alphas(t), push(t), FREE),
        (time[0], time[-1]), start * [1.0, 1.0, 1e-5, 1e-5], "DOP853", time, rtol=1e-10, atol=1e-12, max_step=0.02,
    )  # fmt: skip
    assert solution.success
    return np.asarray(solution.y) * np.array([[1.0], [1.0], [1e5], [1e5]])


def states(truth: Mapping[str, Array]) -> Array:
    return np.stack([truth[name] for name in ("link_position", "link_velocity", "pressure_1", "pressure_2")])


def assert_close_in_range(found: Array, expected: Array, tolerance: float) -> None:
    for row, wanted in zip(found, expected, strict=True):
        assert np.abs(row - wanted).max() < tolerance * np.ptp(wanted)


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


MODELS = [
    PAM.muscle_1.force,
    BraidForce(rest_length=0.19, rest_radius=5e-3, braid_angle=np.deg2rad(22.0)),
    ExponentialForce(rest_length=0.19, a1=1.2e-4, a2=30.0, a3=-6.0, a4=-1.5e-4, a5=2e-5, a6=-8.0),
    SpringForce(rest_length=0.14, c0=300.0, c1=2e4, c2=0.03, c3=1e-9),
]
FRICTIONS = [PAM.friction, SimpleFriction(level=0.05), TonduFriction(static=0.12, kinetic=0.03, speed=0.5), None]


@pytest.mark.parametrize("friction", FRICTIONS, ids=lambda f: type(f).__name__)
@pytest.mark.parametrize("force", MODELS, ids=lambda f: type(f).__name__)
def test_every_model_moves_as_its_formulas_say(force: object, friction: object) -> None:
    # Every effect at once: the differences of the recorded motion against the formulas for arrays.
    def muscle(gain: float, leak: float):  # type: ignore[no-untyped-def]
        return replace(PAM.muscle_1, force=force, force_gain=gain, leak_area=leak)

    joint = replace(
        PAM, muscle_1=muscle(1.1, 2e-9), muscle_2=muscle(0.95, 5e-9), friction=friction,
        valve_1=replace(PAM.valve_1, offset=0.2, area_scale=0.8), valve_2=replace(PAM.valve_2, offset=-0.1, area_scale=1.3),
    )  # fmt: skip
    time = np.arange(8001) * 1e-4
    push = 0.4 * np.sin(2.0 * np.pi * 4.0 * time)
    start = np.array([0.05, 0.3, 3e5, 3.4e5])
    inputs: dict[str, TorqueInput] = {
        "valve_1": 5.3, "valve_2": 4.7, "external_torque": lambda t: 0.4 * np.sin(2.0 * np.pi * 4.0 * t)
    }  # fmt: skip
    truth = simulate_pneumatic(joint, inputs, time, start=start)
    v = truth["link_velocity"]
    # Away from the changes between stick and slip, where the velocity has kinks.
    steady = np.array([len({*np.sign(v[max(0, k - 3) : k + 4])}) == 1 for k in range(v.size)])
    steady[:3] = steady[-3:] = False
    assert steady.mean() > 0.8
    rate = np.gradient(v, time)
    assert rate[steady] == pytest.approx(truth["link_acceleration"][steady], abs=2e-3 * np.abs(rate).max())
    torque = joint_torque(joint, truth["link_position"], truth["pressure_1"], truth["pressure_2"])
    rest = torque - 4.117e-4 * truth["link_position"] + push - truth["friction_torque"]
    assert rest / 4.263e-4 == pytest.approx(truth["link_acceleration"], abs=1e-6)
    lengths = muscle_lengths(joint, truth["link_position"])
    for i, side, alpha in ((1, -1.0, opening(5.5)), (2, 1.0, opening(4.6))):
        pressure = truth[f"pressure_{i}"]
        part, valve = getattr(joint, f"muscle_{i}"), getattr(joint, f"valve_{i}")
        speed = side * 0.0365 * np.cos(truth["link_position"]) * v
        expected = pressure_rate(
            joint.air, part, pressure, lengths[i - 1], speed, valve_flow(valve, joint.air, alpha, pressure)
        )
        found = np.gradient(pressure, time)
        assert found[steady] == pytest.approx(expected[steady], abs=2e-3 * np.abs(expected).max())


def test_a_joint_starts_at_rest_and_stays_there() -> None:
    for joint in (SMOOTH, PAM):
        truth = simulate_pneumatic(joint, {"valve_1": 5.7, "valve_2": 4.4, "external_torque": 0.2}, seconds(5.0))
        assert np.ptp(truth["link_position"]) < 1e-9
        assert np.ptp(truth["pressure_1"]) < 1e-3
        assert np.ptp(truth["pressure_2"]) < 1e-3
        assert truth["transmission_torque"][0] + 0.2 == pytest.approx(4.117e-4 * truth["link_position"][0], abs=1e-9)


def test_equal_muscles_under_equal_voltages_stay_in_the_middle() -> None:
    volts = stretches(7, 10)
    truth = simulate_pneumatic(EQUAL, {"valve_1": volts, "valve_2": volts}, seconds(5.0))
    assert np.abs(truth["link_position"]).max() < 1e-12
    assert np.ptp(truth["pressure_1"]) > 5e4


def test_exchanged_voltages_mirror_the_motion() -> None:
    u1, u2 = stretches(8, 6), stretches(9, 6)
    one = simulate_pneumatic(EQUAL, {"valve_1": u1, "valve_2": u2}, seconds(3.0))
    other = simulate_pneumatic(EQUAL, {"valve_1": u2, "valve_2": u1}, seconds(3.0))
    assert one["link_position"] == pytest.approx(-other["link_position"], abs=1e-9)
    assert one["stiffness"] == pytest.approx(other["stiffness"], rel=1e-9)


def test_more_voltage_on_muscle_1_turns_towards_positive_angles_and_more_on_both_stiffens() -> None:
    up, level_volts = np.append(np.full(100, 5.0), np.full(5901, 6.2)), np.full(6001, 5.0)
    turned = simulate_pneumatic(PAM, {"valve_1": up, "valve_2": level_volts}, seconds(6.0))
    assert turned["link_position"][-1] > turned["link_position"][0] + 0.03
    stiffened = simulate_pneumatic(PAM, {"valve_1": up, "valve_2": up}, seconds(6.0))
    assert stiffened["stiffness_isobaric"][-1] > 1.1 * stiffened["stiffness_isobaric"][0]
    assert (stiffened["stiffness"] > stiffened["stiffness_isobaric"]).all()


def test_effects_do_what_they_are_called() -> None:
    time = seconds(6.0)
    volts = np.append(np.full(100, 4.6), np.full(5901, 5.4))
    inputs = {"valve_1": volts, "valve_2": volts}
    plain = simulate_pneumatic(PAM, inputs, time)

    leaky = simulate_pneumatic(replace(PAM, muscle_1=replace(PAM.muscle_1, leak_area=5e-9)), inputs, time)
    assert leaky["pressure_1"][-1] < plain["pressure_1"][-1] - 1e4

    offset = simulate_pneumatic(replace(PAM, valve_1=replace(PAM.valve_1, offset=0.3)), inputs, time)
    shifted = simulate_pneumatic(PAM, {"valve_1": volts + 0.3, "valve_2": volts}, time)
    assert offset["pressure_1"] == pytest.approx(shifted["pressure_1"], rel=1e-12)
    assert offset["valve_1"].tolist() == volts.tolist()

    # At a constant volume half the orifice takes twice the time for everything.
    held = replace(PAM, seesaw=replace(PAM.seesaw, held_at=0.0))
    half = replace(held, valve_1=replace(PAM.valve_1, area_scale=0.5))
    fast, slow = (simulate_pneumatic(j, inputs, time)["pressure_1"] for j in (held, half))
    assert slow[100::2] == pytest.approx(fast[100:][: slow[100::2].size], rel=1e-9)

    strong = replace(held, muscle_1=replace(held.muscle_1, force_gain=1.2))
    weak, more = (simulate_pneumatic(j, inputs, time) for j in (held, strong))
    assert more["muscle_force_1"] == pytest.approx(1.2 * weak["muscle_force_1"], rel=1e-12)
    assert more["pressure_1"] == pytest.approx(weak["pressure_1"], rel=1e-12)


def test_a_clamped_joint_does_not_move_and_shows_its_torque() -> None:
    held = replace(PAM, seesaw=replace(PAM.seesaw, held_at=0.1))
    truth = simulate_pneumatic(
        held, {"valve_1": stretches(1, 8), "valve_2": stretches(2, 8), "external_torque": 5.0}, seconds(4.0)
    )
    assert (truth["link_position"] == 0.1).all()
    assert (truth["link_velocity"] == 0.0).all()
    assert np.ptp(truth["transmission_torque"]) > 0.5
    assert truth["mode"].max() <= 9.0


def test_an_emptied_muscle_is_survived() -> None:
    # The friction of the tube grows without bound as the pressure nears the outside one; the joint sticks.
    volts = np.append(np.full(100, 5.0), np.full(5901, 0.0))
    truth = simulate_pneumatic(PAM, {"valve_1": volts, "valve_2": volts}, seconds(6.0))
    assert all(np.isfinite(values).all() for values in truth.values())
    assert truth["pressure_1"][-1] == pytest.approx(101300.0, abs=2000.0)


VALVES: dict[str, TorqueInput] = {"valve_1": 5.0, "valve_2": 5.0}


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"valve_1": 5.0}, "'valve_2' is missing"),
        ({**VALVES, "motor_torque": 1.0}, "no input 'motor_torque'"),
        ({**VALVES, "valve_1": np.ones(3)}, "one value per sample"),
        ({**VALVES, "valve_1": float("nan")}, "not finite"),
    ],
)
def test_bad_inputs_are_refused(inputs: dict[str, TorqueInput], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        simulate_pneumatic(PAM, inputs, seconds(0.1))


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (np.zeros(3), "starts from"),
        (np.array([0.0, 0.0, -1.0, 4e5]), "starts from"),
        (np.array([0.9, 0.0, 4e5, 4e5]), "volume would not be positive"),
    ],
)
def test_bad_starts_are_refused(start: Array, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        simulate_pneumatic(PAM, VALVES, seconds(0.1), start=start)


def test_a_motion_beyond_the_volumes_is_said() -> None:
    with pytest.raises(SimulationError, match=r"after 0\.\d+ s the joint leaves what its model describes"):
        simulate_pneumatic(PAM, {**VALVES, "external_torque": lambda t: 400.0 * t}, seconds(1.0))


def test_impossible_units_are_said() -> None:
    tiny = replace(PAM, seesaw=replace(PAM.seesaw, inertia=4e-14))
    with pytest.raises(SimulationError, match="units"):
        simulate_pneumatic(tiny, VALVES, seconds(0.1))
    with pytest.raises(SimulationError, match="two samples"):
        simulate_pneumatic(PAM, VALVES, np.zeros(1))
    with pytest.raises(SimulationError, match="at least one step"):
        simulate_pneumatic(PAM, VALVES, seconds(0.1), steps=0)
