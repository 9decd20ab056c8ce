"""A series elastic joint with the numbers of the preset `sea`, integrated by scipy: for springs that no rig describes."""

import numpy as np
from scipy.integrate import solve_ivp

INERTIA, DAMPING, LINK, LINK_DAMPING, WEIGHT, LINEAR, CUBIC = 0.08, 0.4, 0.05, 0.1, 3.0, 20.0, 2000.0
# Stiffness of the element that yields [N·m/rad].
YIELDING = 15.0


def cubic(phi):
    """The spring of the preset."""
    return LINEAR * phi + CUBIC * phi**3


SHAPES = {
    "corner": lambda phi: LINEAR * phi + np.where(np.abs(phi) > 0.04, 40.0 * (phi - 0.04 * np.sign(phi)), 0.0),
    "one-sided-corner": lambda phi: LINEAR * phi + np.where(phi > 0.03, 30.0 * (phi - 0.03), 0.0),
    "knee": lambda phi: LINEAR * phi + 0.6 * np.sign(phi) * np.logaddexp(0.0, (np.abs(phi) - 0.06) / 0.01),
}


def played(
    t,
    drive,
    softer=lambda at: 0.0,
    spring=cubic,
    loop=0.0,
    start=(0.0, 0.0),
    push=lambda at: 0.0,
    exponent=1.0,
    shape=1.0,
):
    """Return motor position, link position, torque of the transmission and stiffness of its spring, shape (N,) each.

    Parameters
    ----------
    t : shape (N,) [s]
    drive : the motor's torque, a function of time [N·m]
    softer : by which part the spring is softer, a function of time
    spring : its torque, a function of the deflection [N·m]
    loop : largest torque of an element next to the spring that yields smoothly (Bouc and Wen; Dahl's model at first) [N·m]
    start : motor and link position at the beginning [rad]
    push : what pushes the link, a function of time [N·m]
    exponent, shape : of the element, as Ikhouane and Rodellar (2007) normalise it, whose σ is the shape
    """

    def slope(at, x):
        phi, rate = x[2] - x[0], x[3] - x[1]
        torque = (1.0 - softer(at)) * spring(phi) + x[4]
        z = x[4] / loop if loop else 0.0
        yields = shape * abs(rate) * abs(z) ** (exponent - 1.0) * z + (1.0 - shape) * rate * abs(z) ** exponent
        return [
            x[1],
            (drive(at) + torque - DAMPING * x[1]) / INERTIA,
            x[3],
            (push(at) - torque - LINK_DAMPING * x[3] - WEIGHT * np.sin(x[2])) / LINK,
            YIELDING * (rate - yields) if loop else 0.0,
        ]

    begin = [start[0], 0.0, start[1], 0.0, 0.0]
    theta, _, q, _, z = solve_ivp(slope, (t[0], t[-1]), begin, t_eval=t, rtol=1e-7, atol=1e-9, max_step=0.02).y
    phi, left = q - theta, 1.0 - np.array([softer(at) for at in t])
    slopes = (spring(phi + 1e-7) - spring(phi - 1e-7)) / 2e-7
    return theta, q, left * spring(phi) + z, left * slopes
