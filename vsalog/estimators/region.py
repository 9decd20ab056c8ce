"""The region of deflection and set-point that data have covered."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Region:
    """The data used so far: the box for the trace's `excited`, the convex hull for the model.

    Attributes
    ----------
    phi, c : least and greatest deflection [rad] and set-point [SI] of the data that count for the box
    hull : vertices of the convex hull of (φ, c), shape (v, 2); empty where there is no set-point
    samples : number of samples used
    waiting : the deflections and set-points of the latest samples, which do not count for the box yet, shape (2, delay); NaN
        where none was used. Noise of a filtered sample lasts as long as the filter's window: a stretch that has just been
        reached is known by that one noise, whatever the standard deviation.
    """

    phi: tuple[float, float] = (np.inf, -np.inf)
    c: tuple[float, float] = (np.inf, -np.inf)
    hull: Array = field(default_factory=lambda: np.empty((0, 2)))
    samples: int = 0
    waiting: Array = field(default_factory=lambda: np.empty((2, 0)))

    @classmethod
    def behind(cls, delay: int) -> Region:
        """Return the region before the first sample, with data counting for the box `delay` samples later."""
        return cls(waiting=np.full((2, delay), np.nan))

    def block(
        self, phi_fit: Array, c_fit: Array | None, use: Flags, phi: Array, c: Array | None
    ) -> tuple[Region, Flags]:
        """Add the samples used; return which of the evaluated samples are inside the region known by then.

        Parameters
        ----------
        phi_fit, c_fit : shape (N,), used where `use` holds
        phi, c : shape (N,), evaluated at
        """
        new = np.where(use, (phi_fit, np.zeros_like(phi_fit) if c_fit is None else c_fit), np.nan)
        joined = np.concatenate((self.waiting, new), axis=1)
        known, waiting = joined[:, : phi.size], joined[:, phi.size :]
        span, inside = _grow(self.phi, known[0], phi)
        c_span = self.c
        if c is not None:
            c_span, inside_c = _grow(self.c, known[1], c)
            inside &= inside_c
        points = np.column_stack((phi_fit[use], c_fit[use])) if c_fit is not None else np.empty((0, 2))
        hull = _hull(np.concatenate((self.hull, points))) if points.size else self.hull
        return Region(span, c_span, hull, self.samples + int(np.count_nonzero(use)), waiting), inside

    def whole(self) -> Region:
        """Return the region with all data counting for the box, as when it is known before the first sample."""
        spans = [
            (float(np.fmin.reduce(last, initial=low)), float(np.fmax.reduce(last, initial=high)))
            for last, (low, high) in zip(self.waiting, (self.phi, self.c), strict=True)
        ]
        return replace(self, phi=spans[0], c=spans[1], waiting=np.full_like(self.waiting, np.nan))

    def vertices(self) -> tuple[tuple[float, ...], ...]:
        """Return the vertices (φ, c) of all data, or the ends of the interval (φ,) where there is no set-point."""
        if self.samples == 0:
            return ()
        if self.hull.size:
            return tuple((float(p), float(c)) for p, c in self.hull)
        low, high = self.whole().phi
        return ((low,), (high,))


def _grow(span: tuple[float, float], new: Array, at: Array) -> tuple[tuple[float, float], Flags]:
    low = np.fmin.accumulate(np.append(span[0], new))
    high = np.fmax.accumulate(np.append(span[1], new))
    # A twentieth of the span is granted on both sides, or every new extreme would count as never seen; a set-point that
    # is constant has no span, but a filter leaves its rounding on it.
    with np.errstate(invalid="ignore"):
        margin = 0.05 * (high[1:] - low[1:]) + ROUNDING * np.maximum(np.abs(low[1:]), np.abs(high[1:]))
        inside = (at >= low[1:] - margin) & (at <= high[1:] + margin)
    return (float(low[-1]), float(high[-1])), inside


def _hull(points: Array) -> Array:
    """Vertices of the convex hull; of points on one line, its two ends."""
    from scipy.spatial import ConvexHull, QhullError

    span = np.ptp(points, axis=0)
    ends = points[[np.lexsort((points[:, 1], points[:, 0]))[i] for i in (0, -1)]]
    if len(points) < 3 or bool((span <= ROUNDING * np.abs(points).max(axis=0)).any()):
        return np.unique(ends, axis=0)
    try:
        # Both axes are brought to one scale, or qhull would take a thin region for a line.
        return np.asarray(points[ConvexHull((points - points.min(axis=0)) / span).vertices])
    except QhullError:
        return np.unique(ends, axis=0)


def lengths(flags: Flags, before: int) -> NDArray[np.int64]:
    """Return for how many samples each of the flags has been set without a break, `before` at the sample before the first."""
    index = np.arange(1, flags.size + 1)
    return np.where(flags, index - np.maximum.accumulate(np.where(flags, -before, index)), 0)
