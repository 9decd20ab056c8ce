"""Gravity: the weight of a link and of what it carries."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.quantities import Base, Length, Mass
from vsalog.effects.base import Default, Effect, OneNumber
from vsalog.effects.counterpart import Counterpart, Term, term

Array = NDArray[np.float64]

GRAVITY = 9.81
"""Standard gravity, to the three digits that rigs state [m/s²]."""


class Payload(Base, frozen=True):
    """A point mass on the link, in line with its centre of mass: inertia m d², gravity torque m g d.

    Attributes
    ----------
    mass : m [kg]
    distance : d from the joint's axis [m]
    """

    mass: Mass
    distance: Length

    @property
    def inertia(self) -> float:
        """About the joint's axis, m d² [kg·m²]."""
        return self.mass * self.distance**2

    @property
    def weight(self) -> float:
        """Torque that holds it horizontal, m g d [N·m]."""
        return self.mass * GRAVITY * self.distance

    @classmethod
    def of(cls, inertia: float, weight: float) -> Payload:
        """Return the mass that has an inertia [kg·m²] and a weight [N·m]."""
        distance = inertia * GRAVITY / weight
        return cls(mass=weight / (GRAVITY * distance), distance=distance)


def holding_torque(weight: float, angle: float, q: Array) -> Array:
    """Return the torque that holds a link, shape of `q` [N·m].

    Parameters
    ----------
    weight : torque that holds it horizontal [N·m]
    angle : where it hangs [rad]
    q : its position [rad]; it may be a number
    """
    return weight * np.sin(q - angle)


def _hanging(link: Any) -> tuple[Term]:
    return term("inertial", weight=link.gravity_torque, angle=link.gravity_angle)


def _carried(link: Any) -> tuple[Term]:
    return term("payload", mass=link.payload.mass, distance=link.payload.distance)


EFFECT = Effect(
    counterparts=(
        Counterpart("link", ("gravity_torque", "gravity_angle"), _hanging, _hanging),
        Counterpart("link", ("payload",), _carried, _carried),
    ),
    tolerances=(
        Default(("mass", "distance"), "a load is seldom weighed, its centre of mass guessed", share=0.2),
        Default(
            ("gravity_torque",),
            "from CAD; a plane that is level to a degree lets 2 % of the weight act",
            share=0.1,
            share_of_scale=0.02,
        ),
        Default(("gravity_angle",), "how the base is mounted, and where the centre of mass is", least="2 deg"),
    ),
    causes=(
        OneNumber(
            name="link.gravity", place="link", key="gravity_torque", number="torque", unit="N*m",
            step=lambda s: 0.01 * (abs(s.value) or s.torque), scale=lambda s: s.torque,
            title="The gravity torque of the link differs from the rig",
            says="the link's equation is off in proportion to the sine of its position",
            confirm="Hold the link still in several positions and compare the torque that holds it.",
            reference="Flacco 2012 eq. 3, g(q)",
            signature="link equation: sin(q − q₀)",
        ),
    ),
)  # fmt: skip
