"""Transmissions of unknown type: a smooth spring is fitted to the log first, so that other effects can be looked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.diagnosis.causes.base import Parameter, Setting, Site, with_signal
from vsalog.diagnosis.smooth import TERMS
from vsalog.residuals.channels import channels_of
from vsalog.residuals.sensing import true_roles
from vsalog.rig.schema import PolynomialTransmission, UnknownTransmission
from vsalog.uncertainty.long_run import FEWEST_SAMPLES

Array = NDArray[np.float64]

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
    """Return a joint whose unknown transmissions are smooth springs fitted to a log, and whose offset each has at rest.

    It is fitted to what the joint did, with the sensors' errors of the rig undone. A spring that is not known does not determine
    whose the torque at zero deflection is: it is taken for the torque sensor's offset, or for that of an encoder.

    Parameters
    ----------
    joint : of the rig
    signals : of one run of the log
    zero : motor_position or link_position: the encoder whose zero is taken to be off, if it is recorded

    Returns
    -------
    The joint, and transmission → role
    """
    fitted = {}
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
        if np.count_nonzero(good) < FEWEST_SAMPLES or np.ptp(phi[good]) == 0.0:
            continue
        spring, at_rest = fitted_spring(phi[good], torque[good])
        role = zero if zero == "link_position" else f"{zero}{suffix}"
        off, fitted[name] = at_rest, sensor
        if role in signals.roles and at_rest:
            free = _zero_of(spring, at_rest)
            spring, _ = fitted_spring(phi[good] - free, torque[good])
            off, fitted[name] = free if role == "link_position" else -free, role
        joint = _with_offset(replace(joint, **{name: spring}), fitted[name], off)
    return joint, fitted


def spring_sites(setting: Setting) -> Iterator[Site]:
    """Yield the springs that were fitted to the log, of which nothing is known: they are fitted again with every set of causes.

    Unknown are the changes of the coefficients and of the offset at rest, in units of what is large in this log.
    """
    for name, role in setting.fitted.items():
        spring, suffix = getattr(setting.joint, name), name.removeprefix("transmission")
        torque = setting.torque_size()
        off = setting.deflection_size(suffix) if "position" in role else torque
        terms = tuple(Parameter(f"term_{k + 1}", "1", 0.0, 1e-3) for k in range(len(spring.coefficients) + 1))
        yield Site("transmission.spring", name, terms, partial(_refitted, name, role, torque, off), given=True)


def _refitted(name: str, role: str, torque: float, off: float, joint: Any, values: Sequence[float]) -> Any:
    """Return a joint with another spring, and another offset at rest."""
    spring = getattr(joint, name)
    coefficients = tuple(c + torque * v for c, v in zip(spring.coefficients, values[:-1], strict=True))
    return _with_offset(replace(joint, **{name: replace(spring, coefficients=coefficients)}), role, off * values[-1])


def spring_findings(name: str, joint: Any, extended: Any, fitted: Mapping[str, str]) -> list[Finding]:
    """Return what was assumed of springs that the rig does not know.

    Parameters
    ----------
    name : of the joint
    joint, extended : as the rig has it, without a spring, and with what was found
    fitted : of `with_springs`
    """
    about = partial(Finding, code="diagnosis.spring_fitted", joint=name, severity="info")
    return [
        about(
            part=role, value=_offset(extended, role) - _offset(joint, role), unit="rad" if "position" in role else "N*m"
        )
        for role in fitted.values()
    ]


def _with_offset(joint: Any, role: str, by: float) -> Any:
    """Return a joint of which a sensor's offset is larger, in the joint's unit."""
    signal = offered_roles(joint)[role]
    return with_signal(joint, role, offset=signal.offset + signal.gain * by) if by else joint


def _offset(joint: Any, role: str) -> float:
    signal = offered_roles(joint)[role]
    return float(signal.offset / signal.gain)


def unknown_in(joint: Any) -> list[str]:
    """Return the names of a joint's transmissions whose type is unknown."""
    names = ("transmission", "transmission_1", "transmission_2")
    return [name for name in names if isinstance(getattr(joint, name, None), UnknownTransmission)]


def fitted_spring(phi: Array, torque: Array) -> tuple[PolynomialTransmission, float]:
    """Return the polynomial spring nearest to a torque over a deflection, shape (N,) each, and the torque at rest [N·m]."""
    scale = float(np.max(np.abs(phi)))
    # A straight line, and as many terms as any smooth function has: a curve with more inflections is not a spring alone.
    powers = (phi / scale)[:, None] ** np.arange(TERMS + 2)
    found = np.linalg.lstsq(powers, torque, rcond=1e-10)[0]
    return PolynomialTransmission(coefficients=tuple(float(c) for c in found[1:]), scale=scale), float(found[0])


def _zero_of(spring: PolynomialTransmission, at_rest: float) -> float:
    """Return the deflection nearest to zero at which a spring's torque cancels that at rest [rad]; zero where none does."""
    roots = np.polynomial.Polynomial([at_rest, *spring.coefficients]).roots()
    real = roots[np.abs(roots.imag) < 1e-9].real * spring.scale
    return float(real[np.argmin(np.abs(real))]) if real.size else 0.0


def _deflection(roles: Mapping[str, Array], suffix: str) -> Array | None:
    if f"deflection{suffix}" in roles:
        return np.asarray(roles[f"deflection{suffix}"][0])
    if "link_position" in roles and f"motor_position{suffix}" in roles:
        return np.asarray(roles["link_position"][0] - roles[f"motor_position{suffix}"][0])
    return None
