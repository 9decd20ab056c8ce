"""Friction elements in parallel, each against its law."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vsalog.mechanics.slip_elements import slip_deflections

SLIPS = np.array([0.02, 0.1, 0.5])


def test_an_element_that_slips_at_once_holds_its_deflection_until_the_motion_turns():
    phi = np.array([0.0, 0.05, 0.2, 0.15, 0.0, -1.0, -0.9])
    expected = [
        [0.0, 0.02, 0.02, -0.02, -0.02, -0.02, 0.02],
        [0.0, 0.05, 0.1, 0.05, -0.1, -0.1, 0.0],
        [0.0, 0.05, 0.2, 0.15, 0.0, -0.5, -0.4],
    ]
    np.testing.assert_allclose(slip_deflections(phi, SLIPS, False), expected, atol=1e-15)


@pytest.mark.parametrize("slip", SLIPS)
def test_an_element_that_slips_smoothly_is_dahls(slip):
    """A step over any part of a motion that does not turn in it is exact."""
    time = np.array([0.0, 0.3, 0.5 * np.pi, 2.0, 1.5 * np.pi, 6.0])

    def rate(t, z):
        speed = 0.2 * np.cos(t)
        return speed - abs(speed) * z / slip

    solved = solve_ivp(rate, (0.0, 6.0), [0.0], t_eval=time, rtol=1e-10, atol=1e-12, max_step=0.01)
    (found,) = slip_deflections(0.2 * np.sin(time), np.array([slip]), True)
    np.testing.assert_allclose(found, solved.y[0], atol=1e-8)
