"""Contraction force of a pneumatic muscle from its pressure and length, and its two slopes, in SI.

Shin, Ibayashi, Kogiso (2021) use the linear model (eq. 6–7). Their Table IV compares it with three empirical models which they
cite by equation number only; neither the equations nor the coefficients are in their text. The three here are chosen among the
published forms: the geometry of the braid (Tondu and Lopez 2000), a fitted exponential (Sárosi 2012) and a spring whose
stiffness is a polynomial (Wickramatunge and Leephakpreeda 2010). They take the pressure above the outside one, p = P − P_out;
the linear model takes P itself, as its coefficients were fitted so.

No model is cut off at zero: the paper's is not, and a muscle pushes where its fitted line does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.rig.schema import Air, BraidForce, ExponentialForce, LinearForce, Muscle, SpringForce

Array = NDArray[np.float64]


def contraction_force(muscle: Muscle, air: Air, pressure: ArrayLike, length: ArrayLike) -> Array:
    """Return the muscle's pull F [N].

    Parameters
    ----------
    muscle, air : of the rig
    pressure : absolute [Pa], any shape
    length : of the muscle [m], broadcast against `pressure`

    Returns
    -------
    shape of both broadcast; positive where the muscle pulls
    """
    absolute, x = np.asarray(pressure, dtype=np.float64), np.asarray(length, dtype=np.float64)
    p = absolute - air.outside_pressure
    match muscle.force:
        case LinearForce() as model:
            force = (model.area_slope * x + model.area) * absolute + model.passive_slope * x + model.passive
        case BraidForce() as model:
            area, a, b = braid_numbers(model)
            force = area * p * (a * (x / model.rest_length) ** 2 - b)
        case ExponentialForce() as model:
            contraction = 1.0 - x / model.rest_length
            force = (model.a1 * p + model.a2) * np.exp(model.a3 * contraction)
            force = force + (model.a4 * contraction + model.a5) * p + model.a6
        case SpringForce() as model:
            s = x - model.rest_length
            force = (model.c0 + model.c1 * s**2 + model.c2 * p * s + model.c3 * p**2) * s
    return np.asarray(muscle.force_gain * force)


def force_slopes(muscle: Muscle, air: Air, pressure: ArrayLike, length: ArrayLike) -> tuple[Array, Array]:
    """Return ∂F/∂l [N/m] and ∂F/∂P [N/Pa]; parameters as `contraction_force`, each of the broadcast shape.

    With dε/dl = −1/l_rest and dp/dP = 1 they follow term by term; for the linear model ∂F/∂l = p_v1 P + p_w1 and
    ∂F/∂P = v(l) (Shin 2021 eq. 6–7).
    """
    absolute, x = np.broadcast_arrays(np.asarray(pressure, dtype=np.float64), np.asarray(length, dtype=np.float64))
    p = absolute - air.outside_pressure
    match muscle.force:
        case LinearForce() as model:
            by_length = model.area_slope * absolute + model.passive_slope
            by_pressure = model.area_slope * x + model.area
        case BraidForce() as model:
            area, a, b = braid_numbers(model)
            by_length = 2.0 * area * p * a * x / model.rest_length**2
            by_pressure = area * (a * (x / model.rest_length) ** 2 - b)
        case ExponentialForce() as model:
            contraction = 1.0 - x / model.rest_length
            growth = np.exp(model.a3 * contraction)
            by_length = -((model.a1 * p + model.a2) * model.a3 * growth + model.a4 * p) / model.rest_length
            by_pressure = model.a1 * growth + model.a4 * contraction + model.a5
        case SpringForce() as model:
            s = x - model.rest_length
            by_length = model.c0 + 3.0 * model.c1 * s**2 + 2.0 * model.c2 * p * s + model.c3 * p**2
            by_pressure = (model.c2 * s + 2.0 * model.c3 * p) * s
    return np.asarray(muscle.force_gain * by_length), np.asarray(muscle.force_gain * by_pressure)


def braid_numbers(model: BraidForce) -> tuple[float, float, float]:
    """Return the tube's section π r₀² [m²] and the braid's a = 3/tan²α₀ and b = 1/sin²α₀."""
    angle = model.braid_angle
    return (
        float(np.pi * model.rest_radius**2),
        float(3.0 / np.tan(angle) ** 2),
        float(1.0 / np.sin(angle) ** 2),
    )
