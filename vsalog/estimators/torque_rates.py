"""Rates of torque and deflection, their noise from the sensors, and how well a followed stiffness predicts them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import EstimatorError
from vsalog.estimators.device import Device
from vsalog.uncertainty.long_run import ENOUGH_BATCHES

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Rates(NamedTuple):
    """Σ̇ [N·m/s] and φ̇ [rad/s] of one transmission, shape (N,) each."""

    torque: Array
    deflection: Array

    @property
    def use(self) -> Flags:
        """Where both are known, shape (N,)."""
        return np.isfinite(self.torque) & np.isfinite(self.deflection)


class RateNoise(NamedTuple):
    """Noise of Σ̇ and φ̇ from the sensors: variances [N²·m²/s²], [rad²/s²] and their covariance [N·m·rad/s²]."""

    torque: float
    deflection: float
    shared: float

    def left(self, stiffness: Array | float) -> Array:
        """Return the variance of Σ̇ − K φ̇ [N²·m²/s²] for a stiffness K [N·m/rad]."""
        return np.maximum(self.torque - 2.0 * stiffness * self.shared + stiffness**2 * self.deflection, 0.0)

    def bias(self, stiffness: Array) -> Array:
        """Return the bias of a stiffness that is followed, times the square of the speed [N·m·rad/s²].

        Where φ̇ changes its sign, noise of φ̇ makes a spring look softer, and noise that Σ̇ shares makes it look stiffer. How large
        either is, is known as well as a variance of this number of batches.
        """
        softer = self.deflection * stiffness
        known = float((2.0 / ENOUGH_BATCHES) ** 0.5)
        return np.abs(self.shared - softer) + known * (abs(self.shared) + np.abs(softer))


def typical_speed(device: Device, rates: Iterable[Rates]) -> float:
    """Return the root mean square of φ̇ of all transmissions [rad/s].

    Raises
    ------
    EstimatorError
        The deflection never changes, or is nowhere available for as long as the filter's window.
    """
    all_of_them = np.concatenate([r.deflection for r in rates])
    if not np.isfinite(all_of_them).any():
        raise EstimatorError(
            f"joint '{device.joint}': samples are missing so often that no filter's window is whole; shorten it"
            " (--tune window=SECONDS), or repair the log"
        )
    speed = float(np.sqrt(np.nanmean(all_of_them**2)))
    if not speed > 0.0:
        raise EstimatorError(
            f"joint '{device.joint}': the deflection never changes, and so the stiffness cannot be determined"
        )
    return speed


def prediction_error(known: Rates, found: Array, ahead: int) -> float:
    """Return how far a stiffness that was known `ahead` samples before misses Σ̇, mean square, as a share of Σ̇'s variance.

    By a whole filter's window ahead, for within one the filter correlates noise.
    """
    error = known.torque[ahead:] - found[:-ahead] * known.deflection[ahead:]
    finite = error[np.isfinite(error)]
    return float(np.mean(finite**2) / np.nanvar(known.torque)) if finite.size else np.inf
