"""Cogging: a torque that repeats over the rotor's turn. What looks for its order is `diagnosis.causes.cogging`."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.core.quantities import Angle, Order, Torque
from vsalog.effects.base import Default, Effect, Key
from vsalog.effects.body_torque import BodyTorque
from vsalog.effects.counterpart import Counterpart, Term

Array = NDArray[np.float64]


class Cogging(BodyTorque, frozen=True):
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

    @staticmethod
    def formula(x: Any, v: Any, t: Any, p: Array, at: int) -> Any:
        """Return the wave."""
        return p[at] * np.sin(p[at + 1] * x + p[at + 2])

    def numbers(self, ratio: float) -> tuple[float, ...]:
        """Return amplitude [N·m], periods per turn of the joint, and phase [rad]."""
        return self.torque, self.order * ratio, self.phase

    def slopes(self, ratio: float) -> tuple[float, float]:
        """Return the steepest of the wave."""
        return abs(self.torque) * self.order * ratio, 0.0

    def geared(self, ratio: float) -> Cogging:
        """Return it with its torque behind a gear; `order` still counts turns of the rotor."""
        return replace(self, torque=self.torque * ratio)


def _waves(motor: Any) -> list[Term]:
    """Return each as a motor without current."""
    return [Term("dcmotor", {"cogging": wave.numbers(motor.gear_ratio)}) for wave in motor.cogging]


EFFECT = Effect(
    counterparts=(Counterpart("motor", ("cogging",), _waves),),
    tolerances=(
        Default(("cogging.torque",), "varies from motor to motor", share=0.5, share_of_scale=0.02),
        Default(("cogging.phase",), "nothing is known before it is measured", least="180 deg"),
    ),
    keys=(
        Key("motor", "cogging", Cogging, "torques that repeat over the rotor's turn, [[…motor.cogging]]", many=True),
    ),
)
