"""Whether a sample is inside the region that a model was fitted in; outside, a prediction is extrapolation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A smaller share of a torque, a range or the time does not matter [1].
NEGLIGIBLE_SHARE = 0.01


def inside_region(vertices: Sequence[Sequence[float]], phi: Array, setpoint: Array | None) -> Flags:
    """Return which samples are inside, or so near that noise may have put them outside.

    Parameters
    ----------
    vertices : (φ, set-point) of a convex hull in order, or the ends (φ,) of an interval
    phi, setpoint : shape (N,)
    """
    region = np.array(vertices, dtype=np.float64)
    if region.size == 0:
        return np.zeros(phi.shape, dtype=np.bool_)
    if region.shape[1] == 1 or setpoint is None:
        return _between(phi, region[:, 0])
    if len(region) < 3 or bool((np.ptp(region, axis=0) == 0.0).any()):
        return _between(phi, region[:, 0]) & _between(setpoint, region[:, 1])
    low, span = region.min(axis=0), np.ptp(region, axis=0)
    corners = (region - low) / span
    x, y = (phi - low[0]) / span[0], (setpoint - low[1]) / span[1]
    following = np.roll(corners, -1, axis=0)
    area = 0.5 * float(np.sum(corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1]))
    inside = np.isfinite(x) & np.isfinite(y)
    for (ax, ay), (bx, by) in zip(corners, following, strict=True):
        length = np.hypot(bx - ax, by - ay)
        if length > 0.0:
            distance = np.sign(area) * ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length
            inside &= distance >= -NEGLIGIBLE_SHARE
    return np.asarray(inside)


def _between(x: Array, ends: Array) -> Flags:
    low, high = float(ends.min()), float(ends.max())
    # A constant set-point has no span of its own.
    margin = NEGLIGIBLE_SHARE * (high - low) if high > low else 1e-6 * max(abs(low), 1e-12)
    return np.asarray((x >= low - margin) & (x <= high + margin))
