"""Hysteresis of a transmission: a smooth loop, and springs that slip.

What computes it from a deflection is `mechanics.hysteresis`; what looks for it is `diagnosis.causes.transmission`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from msgspec import Meta

from vsalog.core.quantities import AngleRange, Base, Stiffness, TorqueLevel
from vsalog.effects.base import Default, Effect
from vsalog.effects.counterpart import Counterpart, Lack, Term


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


def _loop(transmission: Any) -> Iterator[Term | Lack]:
    """Yield the loop with n = 1 and a shape of 1 as what it then is, Dahl's friction between motor and link."""
    loop: BoucWen = transmission.bouc_wen
    if transmission.backlash > 0.0:
        yield Lack("bouc_wen", "the friction of a tendon acts within the gap of a backlash too")
    elif loop.exponent != 1.0 or loop.shape != 1.0:
        yield Lack("bouc_wen", "LuGre friction is such a loop with exponent = 1 and shape = 1 only")
    else:
        yield Term("dcmotor", {"lugre": (loop.torque / loop.width, 0.0, loop.torque, loop.torque, 1.0)})


def _slipping(transmission: Any) -> Iterator[Term | Lack]:
    """Yield each element as a tendon that yields: ideal plasticity is a spring in series with dry friction."""
    if transmission.backlash > 0.0:
        yield Lack("slip", "a tendon that yields does so within the gap of a backlash too")
        return
    for element in transmission.slip:
        if element.limit > 0.0:
            yield Term(
                "fixed",
                {
                    "stiffness": element.stiffness,
                    "springlength": (0.0, 0.0),
                    "springyield": element.limit / element.stiffness,
                },
            )


EFFECT = Effect(
    counterparts=(
        Counterpart("transmission", ("bouc_wen",), _loop),
        Counterpart("transmission", ("slip",), _slipping),
    ),
    tolerances=(
        Default(
            ("bouc_wen.torque", "slip.limit"), "hysteresis of springs, cables and belts", share=0.5, share_of_scale=0.05
        ),
        Default(("slip.stiffness",), "fitted to a loop, not measured", share=0.5),
    ),
)
