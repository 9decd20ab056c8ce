"""By which part a change of the signals moves a stiffness, as a function of the deflection.

What bends a fit bends it most at the ends of what it was fitted to: in the middle of a swing an estimate may stay where it is,
and at its ends turn the other way. One number for all would be too much for the one and too little for the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Ranges of the deflection, alike in width, that are looked at one by one.
RANGES = 9


@dataclass(frozen=True, slots=True)
class ByDeflection:
    """A part of the stiffness.

    Attributes
    ----------
    phi : deflections, ascending, shape (n,) [rad]
    share : the part there, shape (n,)
    """

    phi: Array
    share: Array

    @property
    def most(self) -> float:
        """The largest part."""
        return float(self.share.max())

    def at(self, phi: Array) -> Array:
        """Return the part at deflections, or at none where these are NaN; beyond the known ones that at the nearest."""
        return np.interp(np.nan_to_num(phi), self.phi, self.share)


def part_moved(phi: Array, sure: Flags, squares: Array) -> ByDeflection | None:
    """Return by which part trials move a stiffness: in each range of the deflection the mean of their median squares.

    Parameters
    ----------
    phi : shape (N,), deflections [rad]; NaN for what has none, which is looked at as a whole
    sure : shape (N,), samples that count
    squares : shape (n, N), the square of the part that each trial moves the stiffness by, negative where it is less than what
        noise may do; NaN where it was not tried

    Returns
    -------
    None where nothing was tried
    """
    place = np.nan_to_num(phi)
    counts = sure & ~np.isnan(squares).all(axis=0)
    if not counts.any():
        return None
    low, span = float(place[counts].min()), float(np.ptp(place[counts]))
    part = (place - low) / span if span > 0.0 else np.zeros(phi.size)
    ranges = np.clip(RANGES * part, 0, RANGES - 1).astype(np.int64)
    known, shares = [], []
    for number in np.unique(ranges[counts]):
        here = squares[:, counts & (ranges == number)]
        medians = [np.median(trial[~np.isnan(trial)]) for trial in here if not np.isnan(trial).all()]
        known.append(low + span * (number + 0.5) / RANGES)
        shares.append(max(0.0, float(np.mean(medians))) ** 0.5)
    return ByDeflection(np.array(known), np.array(shares))
