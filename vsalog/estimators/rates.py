"""Rates of torque and deflection, what sensors' noise makes of them, and what a followed stiffness leaves of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.correlation import effective_samples
from vsalog.errors import EstimatorError
from vsalog.estimators.device import Device

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# What noise is, is known to this share.
ROUGHLY = 0.25
# A spread that is not so many times its standard deviation is none.
SURE = 2.0


class Rates(NamedTuple):
    """Σ̇ [N·m/s] and φ̇ [rad/s] of one transmission, shape (N,) each."""

    torque: Array
    deflection: Array

    @property
    def use(self) -> Flags:
        """Where both are known, shape (N,)."""
        return np.isfinite(self.torque) & np.isfinite(self.deflection)


class RateNoise(NamedTuple):
    """What sensors' noise makes of Σ̇ and φ̇: variances [N²·m²/s²], [rad²/s²] and their covariance [N·m·rad/s²]."""

    torque: float
    deflection: float
    shared: float

    def left(self, stiffness: Array | float) -> Array:
        """Return the variance of Σ̇ − K φ̇ [N²·m²/s²] for a stiffness K [N·m/rad]."""
        return np.maximum(self.torque - 2.0 * stiffness * self.shared + stiffness**2 * self.deflection, 0.0)

    def bent(self, stiffness: Array) -> Array:
        """Return what it bends a stiffness by that is followed, times the square of the speed [N·m·rad/s²].

        Where φ̇ changes its sign, noise of φ̇ makes a spring look softer, and noise that Σ̇ shares makes it look stiffer. How large
        either is, is known roughly.
        """
        softer = self.deflection * stiffness
        return np.abs(self.shared - softer) + ROUGHLY * (abs(self.shared) + np.abs(softer))


def typical_speed(device: Device, rates: Iterable[Rates]) -> float:
    """Return the root mean square of φ̇ of all transmissions [rad/s].

    Raises
    ------
    EstimatorError
        The deflection never changes, or is nowhere there for as long as the filter's window.
    """
    all_of_them = np.concatenate([r.deflection for r in rates])
    if not np.isfinite(all_of_them).any():
        raise EstimatorError(
            f"joint '{device.joint}': samples are missing so often that no filter's window is whole; shorten it"
            " (--tune window=SECONDS), or mend the log"
        )
    speed = float(np.sqrt(np.nanmean(all_of_them**2)))
    if not speed > 0.0:
        raise EstimatorError(
            f"joint '{device.joint}': the deflection never changes, and so nothing tells the stiffness"
        )
    return speed


def prediction_error(known: Rates, found: Array, ahead: int) -> float:
    """Return how far a stiffness that was known `ahead` samples before misses Σ̇, mean square, as a share of Σ̇'s variance.

    By a whole filter's window ahead, for within one the filter makes noise alike.
    """
    error = known.torque[ahead:] - found[:-ahead] * known.deflection[ahead:]
    told = error[np.isfinite(error)]
    return float(np.mean(told**2) / np.nanvar(known.torque)) if told.size else np.inf


def left_over(known: Rates, found: Array, noise: float) -> tuple[float, float]:
    """Look at what an observer's predictions leave of the torque's rate.

    Parameters
    ----------
    known : rates that are all finite
    found : shape (N,), the stiffness observed [N·m/rad]
    noise : what the sensors' noise makes of Σ̇ − K φ̇, one standard deviation [N·m/s]

    Returns
    -------
    alike : for how many samples what moves the observer stays alike, at least 1
    within : how much the stiffness differs from the observer's average of it [N·m/rad], root mean square: what is left over but
        for noise, over the deflection's rate; or, where that is more, how what is left over grows with the rate, which needs
        no noise to be known
    """
    if not known.torque.size:
        return 1.0, 0.0
    left = np.nan_to_num(known.torque - found * known.deflection)
    alike = max(1.0, left.size / effective_samples(left * np.sign(known.deflection)))
    power = known.deflection**2
    more = (float(np.mean(left**2)) - float(noise) ** 2) / float(np.mean(power))
    return alike, float(np.sqrt(max(0.0, more, _growth(left**2, power))))


def _growth(left: Array, power: Array) -> float:
    """Return how much what is left over grows with the rate's power, less its uncertainty."""
    spread = float(np.var(power))
    if spread == 0.0:
        return 0.0
    off = power - power.mean()
    slope = float(np.mean((left - left.mean()) * off)) / spread
    rest = (left - left.mean() - slope * off) * off
    return slope - SURE * float(np.std(rest) / spread / np.sqrt(effective_samples(rest)))
