"""Eccentricity: an encoder disc off its axis. What looks for it is `diagnosis.causes.sensor`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.quantities import Angle, AngleWidth, Base
from vsalog.effects.base import Default, Effect

Array = NDArray[np.float64]


class Eccentricity(Base, frozen=True):
    """An encoder disc off its axis: amplitude · sin(x + phase) is added to the true angle x.

    Attributes
    ----------
    amplitude : [rad]
    phase : [rad]
    """

    amplitude: AngleWidth
    phase: Angle = 0.0

    def error(self, x: Array) -> Array:
        """Return what is added to the reading [rad], shape of `x` [rad]."""
        return self.amplitude * np.sin(x + self.phase)

    def centred(self, m: Array, gain: float, rounds: int, left: float) -> Array:
        """Return x of m = gain · x + amplitude · sin(x + phase), shape of `m`.

        A Newton iteration in brackets (Kepler's equation): halves them where a step would leave them.

        Parameters
        ----------
        m : [rad]
        gain : of the encoder
        rounds : at most
        left : ends once a round changes no angle by more than this part of the largest, or of 1 rad; what is left is its square
        """
        x = m / gain
        far = abs(self.amplitude / gain)
        low, high = x - far, x + far
        for _ in range(rounds):
            beyond = x - (m - self.error(x)) / gain
            low, high = np.where(beyond > 0.0, low, x), np.where(beyond > 0.0, x, high)
            last, x = x, x - beyond * gain / self.slope(x, gain)
            x = np.where((x >= low) & (x <= high) | np.isnan(x), x, 0.5 * (low + high))
            if not np.fmax.reduce(np.abs(x - last)) > left * max(1.0, float(np.fmax.reduce(np.abs(x)))):
                break
        return x

    def slope(self, x: Array, gain: float) -> Array:
        """Return ∂m/∂x [1], shape of `x`."""
        return gain + self.amplitude * np.cos(x + self.phase)


EFFECT = Effect(
    tolerances=(
        Default(
            ("eccentricity.amplitude",), "a disc that is 0.1 mm off its axis at a radius of 30 mm", least="0.2 deg"
        ),
        Default(("eccentricity.phase",), "nothing is known before it is measured", least="180 deg"),
    ),
)
