"""Hysteresis of a transmission: a smooth loop, and springs that slip.

What tells it from a deflection is `mechanics.hysteresis`; what looks for it is `diagnosis.causes.transmission`.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from vsalog.core.quantities import AngleRange, Base, Stiffness, TorqueLevel
from vsalog.effects.base import Default, Effect


class BoucWen(Base, frozen=True):
    """Hysteresis with a smooth loop: τ_h = torque · z, ż = (φ̇ − shape |φ̇| |z|^(n−1) z + (shape − 1) φ̇ |z|^n) / width.

    The normalised form of Ikhouane and Rodellar (2007): |z| ≤ 1, so `torque` is half the loop's height.

    Attributes
    ----------
    torque : half the height of the loop [N·m]
    width : deflection over which the loop changes sides [rad]
    exponent : n, how sharply it does
    shape : 1 gives the same way up and down; at least 0.5
    """

    torque: TorqueLevel
    width: AngleRange
    exponent: Annotated[float, Meta(description="n of the loop", ge=1.0)] = 1.0
    shape: Annotated[float, Meta(description="shape of the loop", ge=0.5)] = 1.0


class SlipElement(Base, frozen=True):
    """A spring in series with dry friction; several in parallel make a loop of any shape (Maxwell slip).

    Attributes
    ----------
    stiffness : of the spring [N·m/rad]
    limit : torque at which it begins to slip [N·m]
    """

    stiffness: Stiffness
    limit: TorqueLevel


def loop_slope(z: float, rate: float, speed: float, exponent: float, shape: float) -> float:
    """Return ż · width of a loop [rad/s], or dz · width of a change of the deflection. `speed` is |rate|."""
    below = abs(z) ** (exponent - 1.0)
    change: float = rate - shape * speed * below * z + (shape - 1.0) * rate * below * abs(z)
    return change


def slipped(torque: float, change: float, stiffness: float, limit: float) -> float:
    """Return the torque of a slip element after a change of its deflection [N·m]."""
    return min(max(torque + stiffness * change, -limit), limit)


EFFECT = Effect(
    tolerances=(
        Default(
            ("bouc_wen.torque", "slip.limit"), "hysteresis of springs, cables and belts", share=0.5, share_of_scale=0.05
        ),
        Default(("slip.stiffness",), "fitted to a loop, not measured", share=0.5),
    ),
)
