"""The deflection under a torque: what a motion makes of springs, dampers and loops is undone."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vsalog.mechanics.transmissions import coded, flexibility_torque
from vsalog.residuals._inverse import deflection_under
from vsalog.rig.schema import BoucWen, CubicTransmission, LinearTransmission, Vsa2Transmission

TIME = np.arange(4000) * 2e-3
NONE = np.zeros((0, 2))


def phi(t):
    return 0.2 * np.sin(2 * np.pi * 0.6 * t) + 0.05 * np.sin(2 * np.pi * 3.1 * t)


def dphi(t):
    return 0.2 * 2 * np.pi * 0.6 * np.cos(2 * np.pi * 0.6 * t) + 0.05 * 2 * np.pi * 3.1 * np.cos(2 * np.pi * 3.1 * t)


def undone(transmission, torque, limit=10.0):
    return deflection_under(coded(transmission), NONE, torque, np.zeros_like(torque), TIME, limit, 0.0, 1e-12)


@pytest.mark.parametrize(
    ("transmission", "limit"),
    [
        (LinearTransmission(stiffness=40.0), 10.0),
        (CubicTransmission(stiffness=3.0, cubic=90.0), 10.0),
        (CubicTransmission(stiffness=3.0, cubic=90.0, backlash=0.05, asymmetry=0.2, drift=0.01), 10.0),
        (Vsa2Transmission(stiffness=15.0, geometry=1.7), 1.98 * np.arcsin(1.0 / 1.7)),
    ],
)
def test_a_spring_alone_is_undone_exactly(transmission, limit):
    torque = flexibility_torque(transmission, phi(TIME), time=TIME)
    moving = torque != 0.0
    np.testing.assert_allclose(undone(transmission, torque, limit)[moving], phi(TIME)[moving], atol=1e-9)


@pytest.mark.parametrize("damping", [0.01, 1.0, 20.0])
def test_a_damper_is_undone_however_weak_or_strong(damping):
    torque = 40.0 * phi(TIME) + damping * dphi(TIME)
    found = undone(LinearTransmission(stiffness=40.0, damping=damping), torque)
    # It begins as if at rest, off by D φ̇ / k, at most 1 rad here: that dies away as exp(−k t / D), to e⁻¹² = 6e-6 of it.
    settled = 12.0 * damping / 40.0 + 0.02 < TIME
    np.testing.assert_allclose(found[settled], phi(TIME)[settled], atol=3e-5)


def test_a_loop_that_is_stiffer_than_its_spring_is_undone():
    """Fixed points of spring and loop in turn would run away here."""

    def rate(t, z):
        return [(dphi(t) - abs(dphi(t)) * z[0]) / 0.02]

    z = solve_ivp(rate, (0, TIME[-1]), [0.0], "LSODA", TIME, rtol=1e-9, atol=1e-11, max_step=5e-3).y[0]
    transmission = LinearTransmission(stiffness=10.0, bouc_wen=BoucWen(torque=2.0, width=0.02))
    found = undone(transmission, 10.0 * phi(TIME) + 2.0 * z)
    np.testing.assert_allclose(found, phi(TIME), atol=2e-3)


def test_what_is_not_known_stays_so_and_the_rest_goes_on():
    torque = 40.0 * phi(TIME)
    torque[1000:1100] = np.nan
    found = undone(LinearTransmission(stiffness=40.0), torque)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(torque))
    np.testing.assert_allclose(found[1100:], phi(TIME)[1100:], atol=1e-9)
