"""Transmissions of unknown type: a smooth spring is fitted to the log first, so that what is not a spring can be looked for."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.binding import offered_roles
from vsalog.diagnosis.causes.base import with_signal
from vsalog.rig.schema import PolynomialTransmission, UnknownTransmission
from vsalog.signals import JointSignals

Array = NDArray[np.float64]

# Powers of the deflection that a smooth spring is given, without and with the torque at rest.
HIGHEST = 7
FEWEST = 100
# What a spring that is fitted to a log takes up.
TAKEN_UP = frozenset(
    {
        "transmission.stiffness",
        "transmission.nonlinearity",
        "transmission.asymmetry",
        "sensor.torque_gain",
        "sensor.torque_offset",
        "sensor.encoder_offset",
        "sensor.encoder_scale",
        "sensor.encoder_eccentricity",
    }
)


def with_springs(joint: Any, signals: JointSignals) -> tuple[Any, tuple[str, ...]]:
    """Return a joint whose unknown transmissions are smooth springs fitted to a log, and what to say of it.

    The torque at zero deflection is taken for the sensor's offset: a spring that is not known does not tell.

    Parameters
    ----------
    joint : of the rig
    signals : of one run of the log
    """
    said = []
    for name in unknown_in(joint):
        suffix = name.removeprefix("transmission")
        phi, torque = _deflection(signals, suffix), signals.roles.get(f"torque_sensor{suffix}")
        if phi is None or torque is None:
            continue
        good = np.isfinite(phi) & np.isfinite(torque)
        if np.count_nonzero(good) < FEWEST or np.ptp(phi[good]) == 0.0:
            continue
        spring, at_rest = fitted_spring(phi[good], torque[good])
        joint = replace(joint, **{name: spring})
        sensor = f"torque_sensor{suffix}"
        joint = with_signal(joint, sensor, offset=offered_roles(joint)[sensor].offset + at_rest)
        said.append(
            f"joint '{signals.joint}': the rig does not say what its spring is, so a smooth one was fitted to the log first:"
            " what is told below is what no smooth spring explains; stiffness itself, its asymmetry, gains and offsets were not"
            " judged"
        )
    return joint, tuple(said)


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


def _deflection(signals: JointSignals, suffix: str) -> Array | None:
    roles = signals.roles
    if f"deflection{suffix}" in roles:
        return np.asarray(roles[f"deflection{suffix}"])
    if "link_position" in roles and f"motor_position{suffix}" in roles:
        return np.asarray(roles["link_position"] - roles[f"motor_position{suffix}"])
    return None
