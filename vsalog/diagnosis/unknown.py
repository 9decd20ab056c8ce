"""Transmissions of unknown type: a smooth spring is fitted to the log first, so that what is not a spring can be looked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.binding import offered_roles
from vsalog.diagnosis.causes.base import with_signal
from vsalog.residuals.channels import channels_of
from vsalog.residuals.sensing import true_roles
from vsalog.rig.schema import PolynomialTransmission, UnknownTransmission
from vsalog.signals import JointSignals

Array = NDArray[np.float64]

# Powers of the deflection that a smooth spring is given, without and with the torque at rest.
HIGHEST = 7
FEWEST = 100
# Encoders whose zero may be off.
ENCODERS = ("motor_position", "link_position")
# What a spring that is fitted to a log takes up.
TAKEN_UP = frozenset(
    {
        "transmission.stiffness",
        "transmission.nonlinearity",
        "transmission.asymmetry",
        "sensor.torque_offset",
        "sensor.encoder_offset",
        "sensor.encoder_scale",
        "sensor.encoder_eccentricity",
    }
)


def with_springs(joint: Any, signals: JointSignals, zero: str = "") -> tuple[Any, Mapping[str, str]]:
    """Return a joint whose unknown transmissions are smooth springs fitted to a log, and of each of these what to say of it.

    It is fitted to what the joint did, with what the rig says of its sensors undone. A spring that is not known does not tell
    whose the torque at zero deflection is: it is taken for the torque sensor's offset, or for that of an encoder.

    Parameters
    ----------
    joint : of the rig
    signals : of one run of the log
    zero : motor_position or link_position: the encoder whose zero is taken to be off, if it is recorded
    """
    said = {}
    unknown = unknown_in(joint)
    roles = true_roles(joint, channels_of(signals)) if unknown else {}
    for name in unknown:
        suffix = name.removeprefix("transmission")
        sensor = f"torque_sensor{suffix}"
        phi = _deflection(roles, suffix)
        if phi is None or sensor not in roles:
            continue
        torque = roles[sensor][0]
        good = np.isfinite(phi) & np.isfinite(torque)
        if np.count_nonzero(good) < FEWEST or np.ptp(phi[good]) == 0.0:
            continue
        spring, at_rest = fitted_spring(phi[good], torque[good])
        role = zero if zero == "link_position" else f"{zero}{suffix}"
        off, unit, whose = at_rest, "N*m", sensor
        if role in signals.roles and at_rest:
            free = _zero_of(spring, at_rest)
            spring, _ = fitted_spring(phi[good] - free, torque[good])
            off, unit, whose = free if role == "link_position" else -free, "rad", role
        joint = replace(joint, **{name: spring})
        signal = offered_roles(joint)[whose]
        joint = with_signal(joint, whose, offset=signal.offset + signal.gain * off)
        said[name] = (
            f"joint '{signals.joint}': the rig does not say what its spring is, so a smooth one was fitted to the log first:"
            " what is told below is what no smooth spring explains; stiffness itself, its asymmetry, encoders' gains and offsets"
            f" were not judged, nor the torque sensor's offset: the torque at zero deflection was taken for an offset of {whose},"
            f" {off:.3g} {unit}"
        )
    return joint, said


def unknown_in(joint: Any) -> list[str]:
    """Return the names of a joint's transmissions whose type is unknown."""
    names = ("transmission", "transmission_1", "transmission_2")
    return [name for name in names if isinstance(getattr(joint, name, None), UnknownTransmission)]


def fitted_spring(phi: Array, torque: Array) -> tuple[PolynomialTransmission, float]:
    """Return the polynomial spring nearest to a torque over a deflection, shape (N,) each, and the torque at rest [N·m]."""
    scale = float(np.max(np.abs(phi)))
    powers = (phi / scale)[:, None] ** np.arange(HIGHEST + 1)
    found = np.linalg.lstsq(powers, torque, rcond=1e-10)[0]
    return PolynomialTransmission(coefficients=tuple(float(c) for c in found[1:]), scale=scale), float(found[0])


def _zero_of(spring: PolynomialTransmission, at_rest: float) -> float:
    """Return the deflection nearest to zero at which a spring's torque undoes that at rest [rad]; zero where none does."""
    roots = np.polynomial.Polynomial([at_rest, *spring.coefficients]).roots()
    real = roots[np.abs(roots.imag) < 1e-9].real * spring.scale
    return float(real[np.argmin(np.abs(real))]) if real.size else 0.0


def _deflection(roles: Mapping[str, Array], suffix: str) -> Array | None:
    if f"deflection{suffix}" in roles:
        return np.asarray(roles[f"deflection{suffix}"][0])
    if "link_position" in roles and f"motor_position{suffix}" in roles:
        return np.asarray(roles["link_position"][0] - roles[f"motor_position{suffix}"][0])
    return None
