"""Loops computed from a deflection: Bouc–Wen against scipy's integrator, slip elements against the stop operator."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from vsalog.mechanics.hysteresis import loop_block, loop_level, loop_start
from vsalog.rig.schema import BoucWen, LinearTransmission, SlipElement, UnknownTransmission

TIME = np.arange(5001) * 1e-3
A = 0.05


def phi(t):
    return A * (np.sin(3.0 * t) + 0.4 * np.sin(7.3 * t))


def phi_dot(t):
    return A * (3.0 * np.cos(3.0 * t) + 0.4 * 7.3 * np.cos(7.3 * t))


def told(transmission, deflection, **options):
    return loop_block(loop_start(transmission), transmission, deflection, **options)[1:]


@pytest.mark.parametrize("gap", [0.0, 0.02])
@pytest.mark.parametrize(("exponent", "shape"), [(1.0, 1.0), (2.0, 0.7), (1.5, 1.4)])
@pytest.mark.parametrize("begun", [-0.9, 0.6])
def test_bouc_wen_against_an_integrator(gap, exponent, shape, begun):
    loop = BoucWen(torque=0.7, width=0.02, exponent=exponent, shape=shape)
    transmission = LinearTransmission(stiffness=10.0, bouc_wen=loop, backlash=gap)

    def rate(t, z):
        d = phi_dot(t) if abs(phi(t)) > 0.5 * gap else 0.0
        below = np.abs(z) ** (exponent - 1.0)
        return (d - shape * abs(d) * below * z + (shape - 1.0) * d * below * np.abs(z)) / 0.02

    solved = solve_ivp(rate, (0.0, TIME[-1]), [begun], t_eval=TIME, rtol=1e-9, atol=1e-11, max_step=5e-3)
    torque, doubt = told(transmission, phi(TIME))
    off = np.abs(torque - 0.7 * solved.y[0])
    assert np.all(off <= doubt + 1e-3)
    assert np.max(off[1500:]) < 1e-3
    assert np.max(doubt[1500:]) < 1e-3


@given(
    steps=st.lists(st.floats(-0.03, 0.03), min_size=1, max_size=40),
    begun=st.floats(-1.0, 1.0),
    limits=st.tuples(st.floats(0.05, 1.0), st.floats(0.05, 1.0)),
)
def test_slip_elements_are_stops_and_the_doubt_holds_every_beginning(steps, begun, limits):
    elements = tuple(SlipElement(stiffness=k, limit=y) for k, y in zip((20.0, 60.0), limits, strict=True))
    deflection = np.concatenate(([0.01], 0.01 + np.cumsum(steps)))
    torque, doubt = told(LinearTransmission(stiffness=1.0, slip=elements), deflection)
    for k, now in enumerate(deflection):
        # A stop stretched along the whole way: a spring that never holds more than its limit.
        expected = 0.0
        for e in elements:
            held = begun * e.limit
            for a, b in pairwise(deflection[: k + 1]):
                held = np.clip(held + e.stiffness * (b - a), -e.limit, e.limit)
            expected += held
        assert abs(torque[k] - expected) <= doubt[k] + 1e-12, now


def test_a_slip_element_that_was_drawn_through_is_known_exactly():
    transmission = LinearTransmission(stiffness=1.0, slip=(SlipElement(stiffness=100.0, limit=0.5),))
    torque, doubt = told(transmission, np.array([0.0, 0.004, 0.012, 0.009, -0.1]))
    np.testing.assert_allclose(doubt, [0.5, 0.3, 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(torque[2:], [0.5, 0.2, -0.5], atol=1e-12)


def test_noise_below_the_slack_wears_nothing_down():
    transmission = LinearTransmission(stiffness=1.0, bouc_wen=BoucWen(torque=1.0, width=0.01))
    rng = np.random.default_rng(0)
    deflection = np.concatenate((np.linspace(0.0, 0.1, 200), 0.1 + 1e-4 * rng.uniform(-1.0, 1.0, 20_000)))
    assert abs(told(transmission, deflection)[0][-1]) < 0.2
    assert told(transmission, deflection, slack=3e-4)[0][-1] == pytest.approx(1.0, abs=0.03)


def test_slack_costs_no_accuracy_in_a_motion():
    transmission = LinearTransmission(stiffness=1.0, bouc_wen=BoucWen(torque=1.0, width=0.02, exponent=1.5))
    plain, slack = (told(transmission, phi(TIME), slack=s)[0][2000:] for s in (0.0, 1e-4))
    assert np.max(np.abs(plain - slack)) < 1e-6


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_blocks_of_any_size_give_the_same_bits(size):
    transmission = LinearTransmission(
        stiffness=1.0,
        backlash=0.01,
        bouc_wen=BoucWen(torque=1.0, width=0.02),
        slip=(SlipElement(stiffness=9.0, limit=0.1),),
    )
    deflection = phi(TIME)
    deflection[700:710] = np.nan
    whole = np.stack(told(transmission, deflection, slack=1e-5))
    state, parts = loop_start(transmission), []
    for k in range(0, deflection.size, size):
        state, *out = loop_block(state, transmission, deflection[k : k + size], 1e-5)
        parts.append(np.stack(out))
    np.testing.assert_array_equal(np.hstack(parts), whole)
    assert np.isnan(whole[:, 700:710]).all()
    assert np.isfinite(whole[:, 710:]).all()


def test_the_level_of_all_loops():
    loops = LinearTransmission(
        stiffness=1.0, bouc_wen=BoucWen(torque=0.4, width=0.02), slip=(SlipElement(stiffness=9.0, limit=0.1),) * 2
    )
    assert loop_level(loops) == pytest.approx(0.6)
    assert loop_level(LinearTransmission(stiffness=1.0)) == loop_level(UnknownTransmission()) == 0.0
