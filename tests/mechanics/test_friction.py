"""Friction computed from a motion: closed forms, and bristles against scipy's integrator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from vsalog.mechanics.friction import friction_block, friction_start
from vsalog.rig.schema import Friction

T = 1e-3
TIME = np.arange(4000) * T


def told(friction, velocity, load=0.0, floor=0.0, reach=0.0, state=None):
    begin = friction_start() if state is None else state
    return friction_block(begin, friction, velocity, np.broadcast_to(load, velocity.shape), floor, reach, T)


@given(v=st.floats(-5.0, 5.0).filter(lambda v: abs(v) > 1e-6), load=st.floats(-3.0, 3.0))
def test_ideal_friction_that_slides(v, load):
    friction = Friction(coulomb=0.2, static=0.5, stribeck_velocity=0.7, load=0.1)
    _, torque, way, doubt = told(friction, np.array([v]), load)
    assert torque[0] == pytest.approx(np.sign(v) * (0.2 + 0.3 * np.exp(-((v / 0.7) ** 2))))
    assert (way[0], doubt[0]) == (np.sign(v), 0.0)


def test_what_is_too_slow_to_tell_is_in_doubt_by_the_whole_level():
    friction = Friction(coulomb=0.2, static=0.5, stribeck_velocity=0.7, load=0.1)
    velocity = np.array([0.02, -0.02, 0.0, np.nan, 0.06])
    _, torque, way, doubt = told(friction, velocity, load=-2.0, floor=0.05)
    np.testing.assert_array_equal(torque[:4], 0.0)
    np.testing.assert_array_equal(way, [0.0, 0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(doubt[2:], [0.7, 0.7, 0.0])
    assert np.all(doubt[:2] > 0.69)


def test_samples_next_to_a_change_of_sign_are_in_doubt():
    velocity = np.linspace(-1.0, 1.0, 41) + 0.001
    doubt = told(Friction(coulomb=0.3), velocity, reach=2.0)[3]
    # The first sample has none before it; the others are computed from 0.05 rad/s per sample times two.
    np.testing.assert_array_equal(doubt[1:] > 0.0, np.abs(velocity[1:]) <= 0.1)


def test_no_friction_is_none():
    assert not Friction().rubs
    assert Friction(load=0.1).rubs
    assert Friction(static=0.1, stribeck_velocity=1.0).rubs


def speed(t):
    return 0.9 * np.sin(4.0 * t) + 0.3 * np.cos(11.0 * t)


@pytest.mark.parametrize(
    ("friction", "load"),
    [
        (Friction(coulomb=0.3, presliding_stiffness=20.0), 0.0),
        (Friction(coulomb=0.2, static=0.4, stribeck_velocity=0.3, presliding_stiffness=30.0, presliding_damping=0.2), 0.0),
        (Friction(coulomb=0.1, load=0.2, presliding_stiffness=15.0), 1.5),
    ],
    ids=["dahl", "lugre", "load"],
)  # fmt: skip
def test_bristles_against_an_integrator(friction, load):
    f = friction

    def level(v):
        return (
            f.coulomb + (f.breakaway - f.coulomb) * np.exp(-((v / (f.stribeck_velocity or 1.0)) ** 2)) + f.load * load
        )

    def rate(t, z):
        return speed(t) - f.presliding_stiffness * abs(speed(t)) * z / level(speed(t))

    solved = solve_ivp(rate, (0.0, TIME[-1]), [0.0], t_eval=TIME, rtol=1e-10, atol=1e-12, max_step=1e-3)
    v = speed(TIME)
    expected = f.presliding_stiffness * solved.y[0] + f.presliding_damping * rate(TIME, solved.y[0])
    _, torque, way, doubt = told(f, v, load)
    whole = torque + f.load * load * way
    # Wherever the bristles began, the truth is between the extremes; from then on it is what the integrator says.
    assert np.all(np.abs(whole - expected) <= doubt * (1.0 + 1e-3) + 2e-3 * level(0.0))
    known = doubt < 1e-4
    assert known[1500:].all()
    np.testing.assert_allclose(whole[known], expected[known], atol=3e-3 * level(0.0))


def test_noise_at_a_standstill_does_not_wear_the_bristles_doubt_away():
    rng = np.random.default_rng(0)
    friction = Friction(coulomb=0.3, presliding_stiffness=500.0)
    velocity = 0.02 * rng.standard_normal(20_000)
    assert told(friction, velocity, floor=0.0)[3][-1] < 1e-3
    assert told(friction, velocity, floor=0.1)[3][-1] == pytest.approx(0.3)


@pytest.mark.parametrize("stiffness", [None, 40.0])
def test_blocks_of_any_size_give_the_same_bits(stiffness):
    friction = Friction(coulomb=0.2, load=0.1, presliding_stiffness=stiffness)
    rng = np.random.default_rng(1)
    v, load = rng.standard_normal(300), rng.standard_normal(300)
    v[100:110] = np.nan
    whole = np.stack(friction_block(friction_start(), friction, v, load, 0.1, 1.0, T)[1:])
    for size in (1, 7, 64):
        state, parts = friction_start(), []
        for k in range(0, 300, size):
            state, *out = friction_block(state, friction, v[k : k + size], load[k : k + size], 0.1, 1.0, T)
            parts.append(np.stack(out))
        np.testing.assert_array_equal(np.hstack(parts), whole)
