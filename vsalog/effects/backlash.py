"""Backlash: a gap of the deflection in which a transmission transmits nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.effects.base import Default, Effect, Exactness, OneNumber
from vsalog.effects.counterpart import Counterpart, term

Array = NDArray[np.float64]


def beyond_gap(phi: float, half_gap: float) -> tuple[float, float]:
    """Return the deflection less the gap, and the side: +1, −1, 0 inside the gap."""
    if half_gap <= 0.0:
        return phi, 1.0 if phi >= 0.0 else -1.0
    if phi > half_gap:
        return phi - half_gap, 1.0
    if phi < -half_gap:
        return phi + half_gap, -1.0
    return (np.nan if np.isnan(phi) else 0.0), 0.0


def engaged(phi: Array, gap: float, values: Array) -> Array:
    """Return values where a transmission touches and 0 inside its gap, shape (N,).

    Parameters
    ----------
    phi : shape (N,), deflection [rad]
    gap : its whole width [rad]
    values : shape (N,), such as the deflection's rate, which damps
    """
    return np.where(np.abs(phi) > 0.5 * gap, values, 0.0) if gap > 0.0 else values


EFFECT = Effect(
    counterparts=(Counterpart("transmission", ("backlash",), lambda t: term("spring", gap=t.backlash)),),
    tolerances=(
        Default(("backlash",), "wear; a joint has no play above 2 % of its deflection", share=0.5, share_of_scale=0.02),
    ),
    causes=(
        OneNumber(
            name="transmission.backlash", place="transmission", key="backlash", number="gap", unit="rad",
            step=lambda s: 2e-3 * s.deflection, low=0.0, high=lambda s: 1.5 * s.deflection,
            reach=lambda s: 0.3 * s.deflection, scale=lambda s: s.deflection,
            starts=(lambda s: 0.02 * s.deflection, lambda s: 0.1 * s.deflection, lambda s: 0.3 * s.deflection),
            exact=Exactness.CORNERED,
            title="The {part} has a gap in which it transmits nothing (backlash), which the rig lacks",
            says="it transmits nothing at small deflections, and less than in the rig at all others",
            confirm="Hold the motor and move the link to and fro by hand: it moves freely between the two stops.",
            reference="Nordin and Gutman (2002), Controlling mechanical systems with backlash, Automatica 38(10)",
            signature="transmission equation: τ_e(φ) less the gap",
        ),
    ),
)  # fmt: skip
