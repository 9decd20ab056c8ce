"""Loops and bristles computed from a motion: against integrators and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vsalog.mechanics.transmissions import coded
from vsalog.residuals._loops import bristle_torque, loop_torque
from vsalog.rig.schema import BoucWen, LinearTransmission

TIME = np.arange(6000) * 1e-3
NONE = np.zeros((0, 2))


def phi(t):
    return 0.2 * np.sin(2 * np.pi * 0.6 * t) + 0.08 * np.sin(2 * np.pi * 1.9 * t)


def dphi(t):
    return 0.2 * 2 * np.pi * 0.6 * np.cos(2 * np.pi * 0.6 * t) + 0.08 * 2 * np.pi * 1.9 * np.cos(2 * np.pi * 1.9 * t)


def row(**loop):
    return coded(LinearTransmission(stiffness=1.0, bouc_wen=BoucWen(**loop)))


@pytest.mark.parametrize(("exponent", "shape"), [(1.0, 1.0), (2.0, 1.0), (1.5, 0.7)])
def test_a_bouc_wen_loop_is_that_of_an_integrator(exponent, shape):
    """ż = (φ̇ − σ |φ̇| |z|ⁿ⁻¹ z + (σ − 1) φ̇ |z|ⁿ) / w, Ikhouane and Rodellar's normalised form."""

    def rate(t, z):
        v, z = dphi(t), z[0]
        bent = shape * abs(v) * abs(z) ** (exponent - 1) * z - (shape - 1) * v * abs(z) ** exponent
        return [(v - bent) / 0.05]

    z = solve_ivp(rate, (0, TIME[-1]), [0.0], "LSODA", TIME, rtol=1e-9, atol=1e-11, max_step=5e-3).y[0]
    found = loop_torque(row(torque=0.3, width=0.05, exponent=exponent, shape=shape), NONE, phi(TIME))
    np.testing.assert_allclose(found, 0.3 * z, atol=2e-4)


def test_slip_elements_follow_until_they_slip():
    """Up by 0.3, down by 0.5, with k = 2 and limit 0.1: written out by hand."""
    path = np.concatenate([np.linspace(0, 0.3, 301), np.linspace(0.3, -0.2, 501)])
    expected = np.concatenate([np.minimum(2 * path[:301], 0.1), np.maximum(0.1 - 2 * (0.3 - path[301:]), -0.1)])
    plain = coded(LinearTransmission(stiffness=1.0))
    np.testing.assert_allclose(loop_torque(plain, np.array([[2.0, 0.1]]), path), expected, atol=1e-12)
    both = loop_torque(plain, np.array([[2.0, 0.1], [4.0, 0.2]]), path)
    np.testing.assert_allclose(both, 3 * expected, atol=1e-12)


def test_inside_a_gap_a_loop_rests():
    gap = coded(LinearTransmission(stiffness=1.0, backlash=0.1, bouc_wen=BoucWen(torque=0.3, width=0.02)))
    path = np.concatenate([np.linspace(0, 0.049, 50), np.linspace(0.049, 0.2, 200), np.linspace(0.2, 0.05, 100)])
    found = loop_torque(gap, NONE, path)
    assert np.all(found[:50] == 0.0)
    back = np.concatenate([path, np.linspace(0.05, -0.05, 100)])
    assert np.ptp(loop_torque(gap, NONE, back)[351:]) < 1e-12


def test_noise_below_the_slack_does_not_wear_a_loop_down():
    rng = np.random.default_rng(0)
    slow = np.concatenate([np.linspace(0, 0.2, 2000), np.full(4000, 0.2)])
    noisy = slow + np.where(np.arange(6000) > 2000, 1e-3 * rng.standard_normal(6000), 0.0)
    loop = row(torque=0.3, width=0.05)
    clean = loop_torque(loop, NONE, slow)
    held = loop_torque(loop, NONE, noisy, slack=6e-3)
    np.testing.assert_allclose(held, clean, atol=0.3 * 6e-3 / 0.05 * 1.1)
    worn = loop_torque(loop, NONE, noisy)
    assert abs(worn[-1000:].mean() - clean[-1]) > 0.1 * clean[-1]


def test_a_loop_rests_while_nothing_is_known():
    path = phi(TIME)
    gone = path.copy()
    gone[1000:1200] = np.nan
    loop = row(torque=0.3, width=0.05)
    found = loop_torque(loop, NONE, gone)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(gone))
    kept = np.concatenate([path[:1000], path[1200:]])
    np.testing.assert_array_equal(found[~np.isnan(found)], loop_torque(loop, NONE, kept))


@pytest.mark.parametrize("stiffness", [20.0, 400.0])
def test_bristles_are_those_of_an_integrator(stiffness):
    """Dahl: ṫ = σ₀ (ẋ − |ẋ| t / F)."""

    def rate(t, z):
        return [stiffness * (dphi(t) - abs(dphi(t)) * z[0] / 0.5)]

    z = solve_ivp(rate, (0, TIME[-1]), [0.0], "LSODA", TIME, rtol=1e-9, atol=1e-11, max_step=5e-3).y[0]
    found = bristle_torque(phi(TIME), np.full(TIME.size, 0.5), stiffness, 0.0)
    # A reversal may lie between two samples: half a step of the path is all that can be missed.
    np.testing.assert_allclose(found, z, atol=stiffness * 5e-6 + 1e-6)


def test_bristles_that_slide_one_way_reach_their_level_as_an_exponential():
    x = np.linspace(0.0, 0.05, 500)
    found = bristle_torque(x, np.full(500, 0.4), 100.0, 0.0)
    np.testing.assert_allclose(found, 0.4 * (1 - np.exp(-100.0 * x / 0.4)), atol=1e-12)
