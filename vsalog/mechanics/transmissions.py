"""Flexible transmissions: energy U(φ), flexibility torque τ_e = ∂U/∂φ and stiffness σ = ∂τ_e/∂φ, in SI.

The functions dispatch on the structures of `vsalog.rig.schema`. NaN goes in and comes out as NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vsalog.errors import RigError
from vsalog.rig.schema import (
    AwasTransmission,
    CubicTransmission,
    LinearTransmission,
    Transmission,
    UnknownTransmission,
    Vsa2Transmission,
)

Array = NDArray[np.float64]


def flexibility_torque(transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None = None) -> Array:
    """Return the flexibility torque τ_e [N·m].

    Parameters
    ----------
    transmission : of the rig
    phi : deflection q − θ [rad], any shape
    setpoint : lever arm r [m], broadcast against `phi`; only a transmission with a set-point (AwAS) takes it

    Returns
    -------
    shape of `phi` and `setpoint` broadcast; NaN where a VSA-II is at or beyond its singularity C sin(φ/2) = 1

    Raises
    ------
    RigError
        The transmission has no nominal model, or its set-point is missing.
    """
    x = np.asarray(phi, dtype=np.float64)
    match transmission:
        case LinearTransmission(stiffness=k):
            return np.asarray(k * x)
        case CubicTransmission(stiffness=k1, cubic=k3):
            return np.asarray((k1 + k3 * x**2) * x)
        case Vsa2Transmission(stiffness=k, geometry=c):
            beta, slope, _ = _four_bar(x, c)
            return 2.0 * k * beta * slope
        case AwasTransmission(spring_stiffness=k):
            return np.asarray(k * _lever_arm(setpoint) ** 2 * np.sin(2.0 * x))
        case UnknownTransmission():
            raise _no_model("flexibility torque")


def stiffness(transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None = None) -> Array:
    """Return the stiffness σ = ∂τ_e/∂φ [N·m/rad] (Flacco 2012 eq. 5, 11, 13).

    Parameters and errors are those of `flexibility_torque`.
    """
    x = np.asarray(phi, dtype=np.float64)
    match transmission:
        case LinearTransmission(stiffness=k):
            return np.full(x.shape, k)
        case CubicTransmission(stiffness=k1, cubic=k3):
            return np.asarray(k1 + 3.0 * k3 * x**2)
        case Vsa2Transmission(stiffness=k, geometry=c):
            beta, slope, curvature = _four_bar(x, c)
            return 2.0 * k * (slope**2 + beta * curvature)
        case AwasTransmission(spring_stiffness=k):
            return np.asarray(2.0 * k * _lever_arm(setpoint) ** 2 * np.cos(2.0 * x))
        case UnknownTransmission():
            raise _no_model("stiffness")


def elastic_energy(transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None = None) -> Array:
    """Return the elastic energy U [J], zero in the undeformed transmission.

    Parameters and errors are those of `flexibility_torque`.
    """
    x = np.asarray(phi, dtype=np.float64)
    match transmission:
        case LinearTransmission(stiffness=k):
            return np.asarray(0.5 * k * x**2)
        case CubicTransmission(stiffness=k1, cubic=k3):
            return np.asarray((0.5 * k1 + 0.25 * k3 * x**2) * x**2)
        case Vsa2Transmission(stiffness=k, geometry=c):
            beta, _, _ = _four_bar(x, c)
            return k * beta**2
        case AwasTransmission(spring_stiffness=k):
            return np.asarray(k * _lever_arm(setpoint) ** 2 * np.sin(x) ** 2)
        case UnknownTransmission():
            raise _no_model("elastic energy")


def reaction_torque(transmission: AwasTransmission, phi: ArrayLike, setpoint: ArrayLike, travel: float) -> Array:
    """Return ψ_e = ∂U/∂θ_c [N·m], what an AwAS' springs do to its secondary motor (Flacco 2012 eq. 52).

    Parameters
    ----------
    transmission : of the rig
    phi : deflection [rad]
    setpoint : lever arm r = r₀ − b θ_c [m]
    travel : b [m/rad]
    """
    r = np.asarray(setpoint, dtype=np.float64)
    return np.asarray(-2.0 * transmission.spring_stiffness * travel * r * np.sin(phi) ** 2)


def _four_bar(phi: Array, c: float) -> tuple[Array, Array, Array]:
    """Return β, ∂β/∂φ and ∂²β/∂φ² of the VSA-II's mechanism (Flacco 2012 eq. 48), else NaN.

    With s = sin(φ/2) and D = 1 − C²s²:  β = asin(C s) − φ/2,  β′ = C cos(φ/2) / (2√D) − 1/2,
    β″ = C (C² − 1) s / (4 D^{3/2}), since C²cos²(φ/2) − D = C² − 1.
    """
    half = 0.5 * phi
    s = np.sin(half)
    # |φ| ≥ π is beyond the singularity too, though the sine comes back below 1/C there.
    reachable = (np.abs(c * s) < 1.0) & (np.abs(phi) < np.pi)
    s = np.where(reachable, s, np.nan)
    d = 1.0 - (c * s) ** 2
    beta = np.arcsin(c * s) - half
    slope = 0.5 * (c * np.cos(half) / np.sqrt(d) - 1.0)
    curvature = 0.25 * c * (c**2 - 1.0) * s / d**1.5
    return beta, slope, curvature


def _lever_arm(setpoint: ArrayLike | None) -> Array:
    if setpoint is None:
        raise RigError("an 'awas' transmission needs the lever arm r [m] as its set-point")
    return np.asarray(setpoint, dtype=np.float64)


def _no_model(what: str) -> RigError:
    return RigError(
        f"the transmission's type is 'unknown', so its nominal {what} cannot be computed;"
        " give a type (linear, cubic, vsa2, awas) and its parameters in the rig"
    )
