"""Flexible transmissions: energy U(φ), flexibility torque τ_e = ∂U/∂φ and stiffness σ = ∂τ_e/∂φ, in SI.

The functions dispatch on the structures of `vsalog.rig.schema`. NaN goes in and comes out as NaN. The rig's
additions to a spring's nominal torque (added cubic, asymmetry, backlash, drift) are included; damping and hysteresis depend on
more than the deflection and belong to the simulation.
"""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from vsalog.core.errors import RigError
from vsalog.mechanics import _atoms
from vsalog.rig.schema import (
    AwasTransmission,
    CubicTransmission,
    ExponentialTransmission,
    KnownTransmission,
    LinearTransmission,
    PolynomialTransmission,
    Transmission,
    UnknownTransmission,
    Vsa2Transmission,
)

Array = NDArray[np.float64]


def flexibility_torque(
    transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None = None, time: ArrayLike = 0.0
) -> Array:
    """Return the flexibility torque τ_e [N·m].

    Parameters
    ----------
    transmission : of the rig
    phi : deflection q − θ [rad], any shape
    setpoint : lever arm r [m], broadcast against `phi`; only a transmission with a set-point (AwAS) takes it
    time : from the start [s], broadcast against `phi`; matters where the rig has a drift

    Returns
    -------
    shape of `phi`, `setpoint` and `time` broadcast; NaN where a VSA-II is at or beyond its singularity C sin(φ/2) = 1

    Raises
    ------
    RigError
        The transmission has no nominal model, or its set-point is missing.
    """
    return _evaluated(transmission, phi, setpoint, time, "flexibility torque")[1].copy()  # frees the others


def stiffness(
    transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None = None, time: ArrayLike = 0.0
) -> Array:
    """Return the stiffness σ = ∂τ_e/∂φ [N·m/rad] (Flacco 2012 eq. 5, 11, 13); 0 inside a gap.

    Parameters and errors are those of `flexibility_torque`.
    """
    return _evaluated(transmission, phi, setpoint, time, "stiffness")[2].copy()


def torque_and_stiffness(
    transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None = None, time: ArrayLike = 0.0
) -> tuple[Array, Array]:
    """Return both at once, [N·m] and [N·m/rad].

    Parameters and errors are those of `flexibility_torque`.
    """
    return _evaluated(transmission, phi, setpoint, time, "torque and stiffness")[1:]


def elastic_energy(
    transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None = None, time: ArrayLike = 0.0
) -> Array:
    """Return the elastic energy U [J], zero in the undeformed transmission.

    Parameters and errors are those of `flexibility_torque`.
    """
    return _evaluated(transmission, phi, setpoint, time, "elastic energy")[0]


def reaction_torque(
    transmission: AwasTransmission, phi: ArrayLike, setpoint: ArrayLike, travel: float, time: ArrayLike = 0.0
) -> Array:
    """Return ψ_e = ∂U/∂θ_c [N·m], the torque of an AwAS' springs on its secondary motor (Flacco 2012 eq. 52).

    Parameters
    ----------
    transmission : of the rig
    phi : deflection [rad]
    setpoint : lever arm r = r₀ − b θ_c [m]
    travel : b [m/rad]
    time : from the start [s]
    """
    # U is proportional to r², but for the added cubic, which has no lever.
    plain = _without_added(transmission)
    r = np.asarray(setpoint, dtype=np.float64)
    return np.asarray(-2.0 * travel / r * elastic_energy(plain, phi, r, time))


def coded(transmission: KnownTransmission) -> Array:
    """Return the row of numbers that the compiled functions work with."""
    own: tuple[float, ...]
    match transmission:
        case LinearTransmission(stiffness=k):
            code, own = _atoms.Law.LINEAR, (k, 0.0)
        case CubicTransmission(stiffness=k1, cubic=k3):
            code, own = _atoms.Law.CUBIC, (k1, k3)
        case PolynomialTransmission(coefficients=c, scale=s):
            code, own = _atoms.Law.POLYNOMIAL, (s, *c)
        case ExponentialTransmission(stiffness=k, scale=s):
            code, own = _atoms.Law.EXPONENTIAL, (k, s)
        case Vsa2Transmission(stiffness=k, geometry=c):
            code, own = _atoms.Law.VSA2, (k, c)
        case AwasTransmission(spring_stiffness=k):
            code, own = _atoms.Law.AWAS, (k, 0.0)
    t, loop = transmission, transmission.bouc_wen
    effects = (t.added_cubic, t.asymmetry, 0.5 * t.backlash, t.drift, t.damping)
    shape = (0.0, 1.0, 1.0, 1.0) if loop is None else (loop.torque, loop.width, loop.exponent, loop.shape)
    return np.array([float(code), *effects, *shape, *own])


def _evaluated(
    transmission: Transmission, phi: ArrayLike, setpoint: ArrayLike | None, time: ArrayLike, what: str
) -> tuple[Array, Array, Array]:
    if isinstance(transmission, UnknownTransmission):
        raise RigError(
            f"the transmission's type is 'unknown', so its nominal {what} cannot be computed;"
            " give a type (linear, cubic, polynomial, exponential, vsa2, awas) and its parameters in the rig"
        )
    if isinstance(transmission, AwasTransmission) and setpoint is None:
        raise RigError("an 'awas' transmission needs the lever arm r [m] as its set-point")
    arm = setpoint if setpoint is not None and isinstance(transmission, AwasTransmission) else 0.0
    given = (np.asarray(v, dtype=np.float64) for v in (phi, arm, time))
    x, r, t = (v.copy() for v in np.broadcast_arrays(*given))
    out = np.empty((3, x.size))
    _atoms.springs(coded(transmission), x.ravel(), r.ravel(), t.ravel(), out)
    energy, torque, stiff = out.reshape((3, *x.shape))
    return energy, torque, stiff


def _without_added(transmission: AwasTransmission) -> AwasTransmission:
    return replace(transmission, added_cubic=0.0) if transmission.added_cubic else transmission
