"""By how much a second estimate differs from a first, beyond its noise.

An estimate moves most at the ends of what it was fitted to; in the middle of a swing it may not move at all. So a shift is a
function of the deflection, and of the set-point where there is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.significance import INTERVAL

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Columns = Mapping[str, NDArray[np.generic]]

# Ranges of the deflection and of the set-point, alike in width, that are looked at one by one.
RANGES = 9


@dataclass(frozen=True, slots=True)
class Spread:
    """Relative error of a stiffness, as a function of what it depends on: the deflection, and the set-point where
    there is one.

    Attributes
    ----------
    places : what it depends on
    share : the part in each range of these, shape (n,) or (n, n)
    """

    places: tuple[Ranges, ...]
    share: Array

    @property
    def most(self) -> float:
        """The largest part."""
        return float(self.share.max())

    def at(self, *values: Array, count: int = 1) -> Array:
        """Return the part at places, shape (N,) each; between the middles of ranges it is interpolated, linearly.

        Where it depends on nothing it is the same for all samples.
        """
        if not self.places:
            return np.full(count, self.most)
        from scipy.ndimage import map_coordinates

        where = [ranges.number(x) - 0.5 for ranges, x in zip(self.places, values, strict=True)]
        return np.asarray(map_coordinates(self.share, where, order=1, mode="nearest"))


class Ranges(NamedTuple):
    """Ranges of a quantity, alike in width; all of it is one where it does not change, or is not known.

    Attributes
    ----------
    low, span : where the first begins, and from there to the end of the last
    """

    low: float
    span: float

    @classmethod
    def of(cls, values: Array) -> Ranges:
        """Return the ranges of values."""
        known = values[np.isfinite(values)]
        return cls(float(known.min()), float(np.ptp(known))) if known.size else cls(0.0, 0.0)

    def number(self, values: Array) -> Array:
        """Return where among the ranges values are, from 0 to their number, shape (N,); the nearest end of what is outside."""
        if not self.span:
            return np.full(values.shape, 0.5)
        return np.clip((np.nan_to_num(values) - self.low) / self.span, 0.0, 1.0) * RANGES


def change(before: Columns, after: Columns, every: slice) -> tuple[Array, Array]:
    """Return how far a stiffness moves, as a part of it, and the variance of the second estimate, as a part of its square.

    Parameters
    ----------
    before, after : columns of the first estimate, of N samples, and of the second
    every : the samples of the first that the second has

    Returns
    -------
    shape (N,) each; NaN where the second has none, or either is not known
    """
    sigma, now, std = (
        np.asarray(values, dtype=np.float64)
        for values in (before["stiffness"], after["stiffness"], after["stiffness_std"])
    )
    found = np.full((2, sigma.size), np.nan)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found[:, every] = now / sigma[every] - 1.0, (std / sigma[every]) ** 2
    found[:, ~np.isfinite(found).all(axis=0)] = np.nan
    return found[0], found[1]


def spread_over(places: Sequence[Array], counts: Flags, squares: Array) -> Spread | None:
    """Return by which part trials move a stiffness: in each range of what it depends on the mean of their median squares.

    Parameters
    ----------
    places : shape (N,) each, what the stiffness depends on; NaN where it is not known
    counts : shape (N,), samples that count
    squares : shape (n, N), the square of the part that each trial moves the stiffness by, negative where it is less than what
        noise may do; NaN where it was not tried

    Returns
    -------
    None where nothing was tried; a range without samples has what the nearest one has
    """
    from scipy.ndimage import distance_transform_edt

    counts = counts & ~np.isnan(squares).all(axis=0)
    if not counts.any():
        return None
    if not places:
        medians = [np.median(trial[there]) for trial in squares if (there := counts & ~np.isnan(trial)).any()]
        return Spread((), np.array(max(0.0, float(np.mean(medians))) ** 0.5))
    ranges = tuple(Ranges.of(x[counts]) for x in places)
    cells = tuple(np.minimum(r.number(x), RANGES - 1).astype(np.int64) for r, x in zip(ranges, places, strict=True))
    share = np.full([RANGES if r.span else 1 for r in ranges], np.nan)
    flat = np.ravel_multi_index(cells, share.shape)
    for cell in np.unique(flat[counts]):
        here = squares[:, counts & (flat == cell)]
        medians = [np.median(trial[~np.isnan(trial)]) for trial in here if not np.isnan(trial).all()]
        share.flat[cell] = max(0.0, float(np.mean(medians))) ** 0.5
    nearest = distance_transform_edt(np.isnan(share), return_distances=False, return_indices=True)
    return Spread(ranges, share[tuple(nearest)])


def beyond_noise(moved: Array, allowed: Array) -> Array:
    """Return the covariance, shape (n, n), of the coefficients' change beyond `INTERVAL` of a covariance `allowed`.

    It is their outer product less the part of it that noise may make of a distance of n coefficients (James and Stein, 1961).
    """
    if not (np.isfinite(moved).all() and np.isfinite(allowed).all()):
        return np.zeros(allowed.shape)
    w, v = np.linalg.eigh(allowed)
    known = w > 0.0
    distance = float(((v.T @ moved)[known] ** 2 / w[known]).sum())
    noise = INTERVAL**2 * np.count_nonzero(known)
    return np.outer(moved, moved) * (1.0 - noise / distance if distance > noise else float(noise == 0.0))
