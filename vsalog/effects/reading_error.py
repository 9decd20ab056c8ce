"""An error of a sensor's reading: what an effect states of it in one place, for the simulation and for what undoes it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from vsalog.core.quantities import Base

Array = NDArray[np.float64]


class ReadingError(Base, frozen=True):
    """What a sensor adds to its reading, over what it measures: a table of a signal in the rig.

    With x the truth, a sensor reads gain · x + offset + drift · t + the errors of its tables.

    Attributes
    ----------
    UNIT : SI unit of what it is an error of
    """

    UNIT: ClassVar[str]

    def error(self, x: Array) -> Array:
        """Return what is added to the reading, shape of `x`; both in `UNIT`."""
        raise NotImplementedError

    def slope(self, x: Array) -> Array:
        """Return its first derivative over `x` [1]."""
        raise NotImplementedError

    def curvature(self, x: Array) -> Array:
        """Return its second derivative over `x`."""
        raise NotImplementedError

    @property
    def largest(self) -> tuple[float, float]:
        """Bounds of the error and of its slope, in size."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Self:
        """Return that of a sensor whose reading is multiplied."""
        raise NotImplementedError


def errors_of(errors: Sequence[ReadingError], x: Array) -> Array:
    """Return what all errors add to a reading, shape of `x`."""
    return sum((e.error(x) for e in errors), np.zeros_like(x))


def measured(errors: Sequence[ReadingError], m: Array, gain: float, rounds: int, left: float) -> Array:
    """Return x of m = gain · x + errors(x), shape of `m`.

    A Newton iteration in brackets (as for Kepler's equation): halves them where a step would leave them.

    Parameters
    ----------
    errors : of a sensor, together less steep than its gain
    m : its readings, less offset and drift
    gain : of the sensor
    rounds : at most
    left : relative change at which the iteration ends; it converges quadratically
    """
    x = m / gain
    far = abs(sum(e.largest[0] for e in errors) / gain)
    low, high = x - far, x + far
    for _ in range(rounds):
        beyond = x - (m - errors_of(errors, x)) / gain
        low, high = np.where(beyond > 0.0, low, x), np.where(beyond > 0.0, x, high)
        last, x = x, x - beyond * gain / (gain + sum(e.slope(x) for e in errors))
        x = np.where((x >= low) & (x <= high) | np.isnan(x), x, 0.5 * (low + high))
        if not np.fmax.reduce(np.abs(x - last)) > left * max(1.0, float(np.fmax.reduce(np.abs(x)))):
            break
    return x
