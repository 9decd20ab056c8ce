"""Gains, springs that change and springs with loops are no faults of a recording, and hide none: joints computed here."""

import math
from functools import cache
from itertools import accumulate

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from vsalog.checks.fault_search import faults_of
from vsalog.core.signals import JointSignals

pytestmark = pytest.mark.share(4)

PERIOD, STIFFNESS = 0.002, 150.0


NO_LOOP = (0.0, 1.0)


def joint(*, seed=0, **course):
    """Return channels of a motor with a spring and a link, with noise."""
    noise = np.random.default_rng(seed).standard_normal((4, int(12.0 / PERIOD)))
    size = {"motor_position": 1e-5, "link_position": 1e-5, "motor_torque": 5e-3, "torque_sensor": 5e-3}
    exact = integrated(**course)
    return {role: exact[role] + size[role] * own for role, own in zip(size, noise, strict=True)}


@cache
def integrated(*, jump=0.0, weight=0.0, speed=1.0, loop=NO_LOOP):
    """Return the channels without noise of a spring that becomes stiffer in the middle of the log, and has a Dahl loop.

    The loop has half a height [N·m] and a width [rad].
    """
    level, width = loop
    time = np.arange(0.0, 12.0, PERIOD)

    def torque(t):
        t = speed * t
        return 4.0 * np.sin(2.1 * t) + 5.0 * np.sin(7.3 * t) + 3.0 * np.sin(17.0 * t + 1.0) + 2.0 * np.sin(31.0 * t)

    def stiffness(t):
        return STIFFNESS * (1.0 + jump * (t >= 6.0))

    def rates(t, x):
        theta, omega, q, v, z = x
        spring = stiffness(t) * (q - theta) + level * z
        turned = (v - omega - abs(v - omega) * z) / width
        return (
            omega,
            (torque(t) + spring - 0.8 * omega) / 0.2,
            v,
            (-spring - 0.1 * v - weight * np.sin(q)) / 0.4,
            turned,
        )

    halves, begin = [], np.zeros(5)
    for part in (time < 6.0, time >= 6.0):
        at = time[part]
        solved = solve_ivp(rates, (at[0], at[-1] + PERIOD), begin, rtol=1e-8, atol=1e-10, dense_output=True)
        halves.append(solved.sol(at))
        begin = solved.sol(at[-1] + PERIOD)
    theta, _, q, _, z = np.hstack(halves)
    return {
        "motor_position": theta,
        "link_position": q,
        "motor_torque": torque(time),
        "torque_sensor": stiffness(time) * (q - theta) + level * z,
    }


def faults_in(roles):
    count = next(iter(roles.values())).size
    time = np.arange(count) * PERIOD
    signals = JointSignals(
        "j", PERIOD, (time * 1e9).astype(np.int64), time, roles, time == 0.0, np.zeros(count, np.int32)
    )
    return [one.fault for one in faults_of(signals)]


def found_in(roles):
    return [(fault.kind, fault.roles) for fault in faults_in(roles)]


def scaled(roles, role, gain):
    return roles | {role: gain * roles[role]}


def without(roles, *left_out):
    return {role: values for role, values in roles.items() if role not in left_out}


@pytest.fixture(scope="module")
def sound():
    return joint()


@pytest.mark.parametrize("alone", [(), ("torque_sensor",)], ids=["sensor", "motor torque alone"])
@pytest.mark.parametrize(
    ("role", "gain"), [("link_position", 1.01), ("motor_position", 0.98), ("motor_torque", 1.1), ("torque_sensor", 1.2)]
)
def test_a_gain_is_no_fault_of_the_recording(sound, role, gain, alone):
    if role not in alone:
        assert found_in(without(scaled(sound, role, gain), *alone)) == []


@pytest.mark.parametrize("alone", [(), ("torque_sensor",)], ids=["sensor", "motor torque alone"])
@pytest.mark.parametrize(("weight", "speed"), [(0.0, 1.0), (0.0, 0.1), (15.0, 0.1)])
def test_a_stiffness_that_jumps_is_no_fault_of_the_recording(weight, speed, alone):
    """With a slow torque it would be a late encoder, with a heavy link a gravity torque that was taken out."""
    assert found_in(without(joint(jump=0.25, weight=weight, speed=speed), *alone)) == []


def slow_joint(stiffness, seed=0):
    """Return channels of a joint that is moved so slowly that its link's inertia is all that its spring carries.

    The link's position is given, and what follows from it is exact for a stiffness of any course.
    """
    draw, time = np.random.default_rng(seed), np.arange(0.0, 24.0, PERIOD)
    frequency, phase = 2.0 * np.pi * np.geomspace(0.15, 3.0, 8), draw.uniform(0.0, 2.0 * np.pi, 8)
    size = 0.18 / (1.0 + frequency / (2.0 * np.pi))
    wave = np.exp(1j * (np.outer(time, frequency) + phase))
    q, v, a = (np.imag(wave * (1j * frequency) ** order) @ size for order in range(3))
    torque = 0.1 * a + 0.05 * v
    noise = draw.standard_normal((3, time.size))
    return {
        "motor_position": q + torque / stiffness(time) + 1e-5 * noise[0],
        "link_position": q + 1e-5 * noise[1],
        "torque_sensor": -torque + 5e-3 * np.abs(torque).max() * noise[2],
    }


COURSES = {
    "ramp": lambda t: 100.0 - 0.8 * t,
    "two jumps": lambda t: np.select([t < 7.3, t < 16.3], [100.0, 130.0], 90.0),
    "decay": lambda t: 70.0 + 30.0 * np.exp(-t / 5.0),
}


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
def test_a_stiffness_that_changes_is_no_fault_of_the_recording(course):
    """As one jump alone it would be a late encoder: a shifted deflection follows acceleration, whatever the spring does."""
    assert found_in(slow_joint(course)) == []


@pytest.mark.parametrize("course", [lambda t: 100.0 + 0.0 * t, *COURSES.values()], ids=["constant", *COURSES])
@pytest.mark.parametrize("role", ["motor_position", "torque_sensor"])
def test_a_late_channel_is_found_whatever_the_spring_does(course, role):
    roles = slow_joint(course)
    late = np.concatenate((np.full(10, roles[role][0]), roles[role][:-10]))
    (kind, _), *_ = found_in(roles | {role: late})
    assert kind == "late"


def test_gravity_taken_out_is_found_along_with_a_gain_or_a_jump(sound):
    for roles in (scaled(sound, "link_position", 1.01), scaled(sound, "motor_torque", 1.1), joint(jump=0.25)):
        # By the recorded angle: what a driver computes.
        torque = roles["torque_sensor"] - 6.0 * np.sin(roles["link_position"])
        assert found_in(roles | {"torque_sensor": torque}) == [("gravity", ("torque_sensor",))]


def test_a_late_torque_is_found_along_with_a_gain_or_a_jump(sound):
    for roles in (scaled(sound, "link_position", 1.01), scaled(sound, "torque_sensor", 1.1), joint(jump=0.25)):
        torque = np.concatenate((np.full(10, roles["motor_torque"][0]), roles["motor_torque"][:-10]))
        assert found_in(roles | {"motor_torque": torque}) == [("late", ("motor_torque",))]


@pytest.mark.parametrize(("role", "samples"), [("torque_sensor", 0.4), ("motor_torque", -0.4), ("link_position", 1.4)])
def test_a_delay_is_found_to_a_part_of_a_sample(sound, role, samples):
    place = np.arange(sound[role].size)
    (fault,) = faults_in(sound | {role: CubicSpline(place, sound[role])(place - samples)})
    assert (fault.kind, fault.roles) == ("late", (role,))
    assert fault.delay / PERIOD == pytest.approx(samples, abs=1.0 / 16.0)


def dahl(state, change, width):
    """The solution of dz = (1 − z sign(dφ)) dφ / width for a deflection that does not turn in between."""
    way = math.copysign(1.0, change)
    return way - (way - state) * math.exp(-abs(change) / width)


def bouc_wen(state, change, width):
    """A loop with an exponent of 2, by Euler's method."""
    return state + (1.0 - math.copysign(1.0, change) * state * abs(state)) * change / width


def slip(state, change, width):
    return min(1.0, max(-1.0, state + change / width))


LOOPS = {
    "Dahl, narrow": (dahl, 0.5, 0.01),
    "Dahl, wide": (dahl, 2.0, 0.05),
    "Bouc and Wen": (bouc_wen, 1.0, 0.02),
    "slip": (slip, 1.0, 0.013),
}
RECORDED = {
    "sensor": ("motor_position", "link_position", "torque_sensor"),
    "sensor and motor torque": ("motor_position", "link_position", "torque_sensor", "motor_torque"),
    "deflection": ("deflection", "torque_sensor"),
}


@cache
def motion_with_loop(law, level, width):
    """Return the channels without noise: both positions are given, and the torques follow from them.

    The loop is followed in steps of a twentieth of a sample, in which the deflection moves by a thousandth of it.
    """
    fine = PERIOD / 20
    time = np.arange(-2.0, 12.0, fine)
    frequency = np.array([2.1, 7.3, 17.0, 31.0])
    waves = np.exp(1j * (np.outer(time, frequency) + np.arange(4.0)))
    (phi, _, phi_acceleration), (q, _, q_acceleration) = (
        [np.imag(waves * (1j * frequency) ** order) @ size for order in range(3)]
        for size in ([0.01, 0.02, 0.015, 0.006], [0.8, 0.3, 0.05, 0.01])
    )
    states = list(accumulate(np.diff(phi).tolist(), lambda z, change: law(z, change, width), initial=0.0))
    torque = STIFFNESS * phi + level * np.array(states)
    speed = np.gradient(q - phi, fine)
    logged = slice(np.searchsorted(time, -0.5 * fine), None, 20)
    every = {
        "motor_position": q - phi,
        "link_position": q,
        "deflection": phi,
        "torque_sensor": torque,
        "motor_torque": 0.2 * (q_acceleration - phi_acceleration) + 0.8 * speed - torque,
    }
    return {role: values[logged] for role, values in every.items()}


def joint_with_loop(loop, recorded, seed):
    draw = np.random.default_rng(seed)
    noise = {role: 5e-3 if "torque" in role else 1e-5 for role in recorded}
    exact = motion_with_loop(*loop)
    return {role: exact[role] + noise[role] * draw.standard_normal(exact[role].size) for role in recorded}


@pytest.mark.every(5)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("alone", [(), ("motor_torque",)], ids=["sensor and motor torque", "sensor"])
@pytest.mark.parametrize("loop", [(0.5, 0.01), (1.0, 0.01), (2.0, 0.05)])
def test_a_loop_of_a_moving_joint_is_no_fault_of_the_recording(loop, alone, seed):
    """Of a spring without one it would be a late torque: a loop makes small motions stiffer than large ones."""
    assert found_in(without(joint(loop=loop, seed=seed), *alone)) == []


@pytest.mark.every(6)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("recorded", RECORDED.values(), ids=RECORDED)
@pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS)
def test_a_loop_is_no_fault_of_the_recording(loop, recorded, seed):
    assert found_in(joint_with_loop(loop, recorded, seed)) == []


@pytest.mark.every(12)
@pytest.mark.parametrize(
    ("recorded", "role"), [(recorded, role) for recorded in RECORDED.values() for role in recorded]
)
@pytest.mark.parametrize("loop", LOOPS.values(), ids=LOOPS)
def test_a_late_channel_is_found_where_the_spring_has_a_loop(loop, recorded, role):
    roles = joint_with_loop(loop, recorded, seed=0)
    late = np.concatenate((np.full(10, roles[role][0]), roles[role][:-10]))
    (fault,) = faults_in(roles | {role: late})
    assert fault.kind == "late"
    # Of two channels one is late as the other is early.
    assert fault.roles == (role,) or len(recorded) == 2
    # A loop of another shape than those that the search adds up costs a seventh.
    assert abs(fault.delay) == pytest.approx(10 * PERIOD, rel=1 / 7)
