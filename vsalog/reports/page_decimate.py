"""Fewer points that look the same: what a figure draws of millions of samples."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# A step of time this many times the usual one is a gap that no line crosses.
GAP_PERIODS = 5.0
# Points are chosen among so many samples or a few more, spread over the log.
LOOKED_AT = 400_000


def gaps_of(time: Array) -> Indices:
    """Return the indices after which a gap of time follows.

    Parameters
    ----------
    time : shape (N,), increasing [s]
    """
    steps = np.diff(time)
    if steps.size == 0:
        return np.zeros(0, np.int64)
    return np.flatnonzero(steps > GAP_PERIODS * max(float(np.median(steps)), 1e-12))


def one_after_the_other(time: Array) -> Array:
    """Let each run begin some time after the one before, so that time never goes back.

    Parameters
    ----------
    time : shape (N,), where each run may begin anew [s]
    """
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0.0)
    if back.size == 0:
        return time
    # Wide enough to be seen, and to be a gap that no line crosses.
    pause = max(0.01 * float(time.max() - time.min()), 2.0 * GAP_PERIODS * float(np.median(np.abs(steps))))
    shift = np.zeros(time.size)
    shift[back + 1] = pause - steps[back]
    return np.asarray(time + np.cumsum(shift))


def decimated(x: Array, y: Array, columns: int, gaps: Indices | None = None) -> tuple[Array, Array]:
    """Thin a line to the least and the greatest sample of each pixel column, so that nothing is aliased.

    Kept: every sample while there are no more than two per column; else each column's extremes, in their order, and the ends.
    Where a NaN (or an infinity) or a gap of time stood between two samples that are kept, one NaN stands between them too.

    Parameters
    ----------
    x : shape (N,), not decreasing
    y : shape (N,)
    columns : of pixels, at least 1
    gaps : indices after which `x` makes a jump that no line shall cross

    Returns
    -------
    x, y : shape (M,) with M ≤ 4·columns + 4
    """
    known = np.flatnonzero(np.isfinite(y))
    if known.size == 0:
        return np.zeros(0), np.zeros(0)
    kept = known
    if known.size > 2 * columns:
        xs, ys = x[known], y[known]
        inner = np.linspace(xs[0], xs[-1], columns + 1)[1:-1]
        edges = np.concatenate([[0], np.searchsorted(xs, inner, side="left"), [xs.size]])
        chosen = [0, xs.size - 1]
        for a, b in pairwise(edges):
            if b > a:
                part = ys[a:b]
                chosen += [a + int(part.argmin()), a + int(part.argmax())]
        kept = known[np.unique(chosen)]
    broken = np.diff(kept) > np.diff(np.searchsorted(known, kept))
    if gaps is not None and gaps.size:
        broken |= np.diff(np.searchsorted(gaps, kept, side="left")) > 0
    after = np.flatnonzero(broken)
    middle = 0.5 * (x[kept[after]] + x[kept[after + 1]])
    return np.insert(x[kept], after + 1, middle), np.insert(y[kept], after + 1, np.nan)


def band(x: Array, low: Array, high: Array, columns: int, gaps: Indices | None = None) -> tuple[Array, Array]:
    """Return the outline of a band as polygons with NaN between them, which encloses the band in every pixel column.

    Parameters
    ----------
    x, low, high : shape (N,)
    columns, gaps : as for `decimated`

    Returns
    -------
    x, y : shape (M,), M ≤ 6·columns + 2 or so
    """
    known = np.flatnonzero(np.isfinite(low) & np.isfinite(high))
    if known.size == 0:
        return np.zeros(0), np.zeros(0)
    # Neighbours belong to different stretches where a sample is missing between them, or time makes a jump.
    breaks = np.flatnonzero(np.diff(known) > 1)
    if gaps is not None and gaps.size:
        breaks = np.union1d(breaks, np.flatnonzero(np.diff(np.searchsorted(gaps, known, side="left")) > 0))
    if breaks.size > columns:
        # More stretches than pixels: neighbours within a pixel run together.
        width = (x[known[-1]] - x[known[0]]) / columns
        breaks = breaks[x[known[breaks + 1]] - x[known[breaks]] > width]
    out_x: list[Array] = []
    out_y: list[Array] = []
    hole = np.array([np.nan])
    span = max(float(x[known[-1]] - x[known[0]]), 1e-300)
    for stretch in np.split(known, breaks + 1):
        t = x[stretch]
        count = int(np.clip(np.ceil(columns * (t[-1] - t[0]) / span), 1, stretch.size))
        edges = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], count + 1)[:-1], side="left"))
        lower, upper = np.minimum.reduceat(low[stretch], edges), np.maximum.reduceat(high[stretch], edges)
        at = np.append(t[edges], t[-1])
        lower, upper = np.append(lower, lower[-1]), np.append(upper, upper[-1])
        out_x += [at, at[::-1], hole]
        out_y += [upper, lower[::-1], hole]
    return np.concatenate(out_x)[:-1], np.concatenate(out_y)[:-1]


def spans(time: Array, flags: Flags, columns: int) -> list[tuple[float, float]]:
    """Return the stretches of time at which a flag is set; those closer than a pixel column run together.

    Parameters
    ----------
    time : shape (N,), increasing [s]
    flags : shape (N,)
    columns : of pixels

    Returns
    -------
    Beginnings and ends [s], at most `columns`
    """
    if not flags.any():
        return []
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    begin, end = time[first], time[last]
    width = (time[-1] - time[0]) / max(columns - 1, 1)
    apart = np.append(True, begin[1:] - end[:-1] > width)
    ends = np.append(np.flatnonzero(apart)[1:] - 1, end.size - 1)
    return [(float(a), float(b)) for a, b in zip(begin[apart], end[ends], strict=True)]


def scattered(x: Array, y: Array, most: int) -> Indices:
    """Choose samples that cover the same area as all: one per cell of a grid, and the extremes.

    Parameters
    ----------
    x, y : shape (N,)
    most : samples wanted, about

    Returns
    -------
    Their indices, increasing, at most ``most + 4``
    """
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if known.size <= most:
        return known
    a, b = x[known], y[known]
    extremes = known[[a.argmin(), a.argmax(), b.argmin(), b.argmax()]]
    known = known[:: max(1, known.size // LOOKED_AT)]
    a, b = x[known], y[known]
    side = int(np.sqrt(most))
    while True:
        cell = _cell(a, side) * side + _cell(b, side)
        # Of several values for one place the last is kept: backwards, the first sample of each cell.
        filled = np.full(side * side, -1, dtype=np.int64)
        filled[cell[::-1]] = np.arange(cell.size - 1, -1, -1)
        first = filled[filled >= 0]
        # A thin curve fills few cells of a coarse grid: finer ones, until there are as many points as wanted.
        if first.size > most:
            break
        chosen, side = first, 2 * side
        if side > 64 * int(np.sqrt(most)):
            break
    return np.asarray(np.union1d(known[chosen], extremes), dtype=np.int64)


def _cell(values: Array, side: int) -> Indices:
    low, span = float(values.min()), float(np.ptp(values)) or 1.0
    return np.asarray(np.minimum((values - low) / span * side, side - 1), dtype=np.int64)
