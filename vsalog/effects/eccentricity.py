"""Eccentricity: an encoder disc off its axis. What looks for it is `diagnosis.causes.sensor`."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.core.quantities import Angle, AngleWidth
from vsalog.effects.base import Default, Effect, Key
from vsalog.effects.reading_error import ReadingError

Array = NDArray[np.float64]


class Eccentricity(ReadingError, frozen=True):
    """An encoder disc off its axis: amplitude · sin(x + phase) is added to the true angle x.

    Attributes
    ----------
    amplitude : [rad]
    phase : [rad]
    """

    UNIT: ClassVar[str] = "rad"

    amplitude: AngleWidth
    phase: Angle = 0.0

    def error(self, x: Array) -> Array:
        """Return what is added to the reading [rad], shape of `x` [rad]."""
        return self.amplitude * np.sin(x + self.phase)

    def slope(self, x: Array) -> Array:
        """Return its derivative [1]."""
        return self.amplitude * np.cos(x + self.phase)

    def curvature(self, x: Array) -> Array:
        """Return its second derivative [1/rad]."""
        return -self.error(x)

    @property
    def largest(self) -> tuple[float, float]:
        """Bounds of the error [rad] and of its slope [1]."""
        return self.amplitude, self.amplitude

    def scaled(self, factor: float) -> Eccentricity:
        """Return that of a sensor whose reading is multiplied."""
        return replace(self, amplitude=self.amplitude * factor)


EFFECT = Effect(
    tolerances=(
        Default(
            ("eccentricity.amplitude",), "a disc that is 0.1 mm off its axis at a radius of 30 mm", least="0.2 deg"
        ),
        Default(("eccentricity.phase",), "nothing is known before it is measured", least="180 deg"),
    ),
    keys=(Key("signal", "eccentricity", Eccentricity, "of an encoder's disc"),),
)
