"""Cogging: a torque that repeats over the rotor's turn. What looks for its order is `diagnosis.causes.cogging`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.core.quantities import Angle, Base, Order, Torque
from vsalog.effects.base import Default, Effect

Array = NDArray[np.float64]


class Cogging(Base, frozen=True):
    """A torque that repeats over the rotor's turn: torque · sin(order · θ_rotor + phase), acting along with the motor's torque.

    Attributes
    ----------
    torque : amplitude [N·m]
    order : periods per turn of the rotor
    phase : at θ = 0 [rad]
    """

    torque: Torque
    order: Order
    phase: Angle = 0.0

    def geared(self, ratio: float) -> Cogging:
        """Return it as the joint feels it through a gear of that ratio; `order` still counts turns of the rotor."""
        return replace(self, torque=self.torque * ratio)

    def ungeared(self, ratio: float) -> Cogging:
        """Return it as the rotor feels it, before a gear of that ratio."""
        return replace(self, torque=self.torque / ratio)

    def row(self, ratio: float) -> tuple[float, float, float]:
        """Return amplitude [N·m], periods per turn of the joint and phase [rad], as `wave` takes them."""
        return self.torque, self.order * ratio, self.phase


def wave(torque: float, order: float, phase: float, theta: Array) -> Array:
    """Return torque · sin(order · θ + phase) [N·m]; `theta` [rad] may be a number."""
    return torque * np.sin(order * theta + phase)


def cogging_torque(waves: Sequence[Cogging], ratio: float, theta: Array) -> Array:
    """Return what all waves add to the motor's torque [N·m], shape of `theta`.

    Parameters
    ----------
    waves : as the joint feels them
    ratio : of the gear
    theta : position on the joint's side [rad]
    """
    total = np.zeros_like(theta)
    for c in waves:
        total += wave(*c.row(ratio), theta)
    return total


def steepness(waves: Sequence[Cogging], ratio: float) -> float:
    """Return the largest slope of the torque over the joint's position [N·m/rad]."""
    return sum(c.torque * c.order * ratio for c in waves)


EFFECT = Effect(
    tolerances=(
        Default(("cogging.torque",), "varies from motor to motor", share=0.5, share_of_scale=0.02),
        Default(("cogging.phase",), "nothing is known before it is measured", least="180 deg"),
    ),
)
