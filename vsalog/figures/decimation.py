"""Thins millions of samples to fewer points that look the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import LONGEST_GAP
from vsalog.core.resolution import spread_over

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

HOLE = (np.array([np.nan]), np.array([np.nan]))
FIGURE_COLUMNS = 1200
"""Pixel columns of a figure over time, as many as it has on a wide screen: a line has two samples in each."""


def extent(values: Array) -> tuple[float, float, float]:
    """Return the least, the greatest and the root mean square of what is finite; inf, −inf and NaN where nothing is."""
    known = values[np.isfinite(values)]
    if known.size == 0:
        return np.inf, -np.inf, np.nan
    return float(known.min()), float(known.max()), float(np.sqrt(np.mean(known**2)))


def rms(values: Array) -> float:
    """Return the root mean square of what is finite; NaN where nothing is."""
    return extent(values)[2]


def gaps_of(time: Array) -> Indices:
    """Return the indices after which a gap of time follows.

    Parameters
    ----------
    time : shape (N,), increasing [s]
    """
    steps = np.diff(time)
    if steps.size == 0:
        return np.zeros(0, np.int64)
    usual = float(np.median(spread_over(steps)))
    return np.flatnonzero(steps > LONGEST_GAP * max(usual, 1e-12))


def one_after_the_other(time: Array) -> Array:
    """Let each run begin some time after the one before, so that time never goes back.

    Parameters
    ----------
    time : shape (N,), where each run may begin at zero again [s]
    """
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0.0)
    if back.size == 0:
        return time
    pause = pause_after(time)
    shift = np.zeros(time.size)
    shift[back + 1] = pause - steps[back]
    return np.asarray(time + np.cumsum(shift))


def pause_after(time: Array) -> float:
    """Return a pause between stretches drawn side by side that is wide enough to be seen, and a gap that no line crosses [s]."""
    return max(0.01 * float(np.ptp(time)), 2.0 * LONGEST_GAP * float(np.median(np.abs(np.diff(time)))))


def around(at: int, samples: int, columns: int) -> slice | None:
    """Return the samples around one of them that a figure shows without leaving any out; None where it shows all.

    Parameters
    ----------
    at : index of the sample in the middle
    samples, columns : of the log, of the figure
    """
    length = 2 * columns
    if samples <= length:
        return None
    first = min(max(at - columns, 0), samples - length)
    return slice(first, first + length)


def decimated(x: Array, y: Array, columns: int, gaps: Indices | None = None) -> tuple[Array, Array]:
    """Thin a line to the least and the greatest sample of each pixel column, so that nothing is aliased.

    Kept: every sample while there are no more than two per column; else each column's extremes, in their order, and the ends.
    Where a NaN (or an infinity) or a gap of time was between two samples that are kept, one NaN is between them too.

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
    finite = np.flatnonzero(np.isfinite(y))
    if finite.size == 0:
        return np.zeros(0), np.zeros(0)
    rank = _extremes(x[finite], y[finite], columns) if finite.size > 2 * columns else np.arange(finite.size)
    kept = finite[rank]
    after = np.flatnonzero(_broken(kept, rank, gaps))
    middle = 0.5 * (x[kept[after]] + x[kept[after + 1]])
    return np.insert(x[kept], after + 1, middle), np.insert(y[kept], after + 1, np.nan)


def _columns(x: Array, begin: float, end: float, columns: int) -> Indices:
    """Return where the samples of each pixel column begin; of columns from `begin` to `end` those that hold any."""
    edges = np.searchsorted(x, np.linspace(begin, end, columns + 1)[:-1])
    return np.unique(np.append(0, edges[edges < x.size]))


def _extremes(x: Array, y: Array, columns: int) -> Indices:
    """Return the indices of the least and the greatest sample of each pixel column, and of both ends."""
    first = _columns(x, x[0], x[-1], columns)
    column = np.repeat(np.arange(first.size), np.diff(np.append(first, x.size)))
    ends = [np.array([0, x.size - 1])]
    for extreme in (np.minimum, np.maximum):
        at = np.flatnonzero(y == extreme.reduceat(y, first)[column])
        ends.append(at[np.unique(column[at], return_index=True)[1]])
    return np.unique(np.concatenate(ends))


def band(x: Array, low: Array, high: Array, columns: int, gaps: Indices | None = None) -> tuple[Array, Array]:
    """Return the outline of a band as polygons with NaN between them, which encloses the band in every pixel column.

    Parameters
    ----------
    x, low, high : shape (N,)
    columns, gaps : as for `decimated`

    Returns
    -------
    x, y : shape (M,), M ≤ 8·columns + 2 or so
    """
    known = np.flatnonzero(np.isfinite(low) & np.isfinite(high))
    if known.size == 0:
        return np.zeros(0), np.zeros(0)
    t, low, high = x[known], low[known], high[known]
    after = np.flatnonzero(_broken(known, np.arange(known.size), gaps))
    if after.size >= columns:
        # More stretches than pixels: neighbours within a pixel run together.
        after = after[t[after + 1] - t[after] > (t[-1] - t[0]) / columns]
    outline: list[tuple[Array, Array]] = []
    for stretch in np.split(np.arange(t.size), after + 1):
        begin, end = stretch[0], stretch[-1] + 1
        first = begin + _columns(t[begin:end], t[0], t[-1], columns)
        at = np.append(t[first], t[end - 1])
        lower, upper = np.minimum.reduceat(low[:end], first), np.maximum.reduceat(high[:end], first)
        outline += [(at, np.append(upper, upper[-1])), (at[::-1], np.append(lower, lower[-1])[::-1]), HOLE]
    return np.concatenate([a for a, _ in outline[:-1]]), np.concatenate([b for _, b in outline[:-1]])


def _broken(kept: Indices, rank: Indices, gaps: Indices | None) -> Flags:
    """Return between which kept samples, of this rank among the known ones, there was an unknown one or a gap of time."""
    broken = np.diff(kept) > np.diff(rank)
    if gaps is not None and gaps.size:
        broken |= np.diff(np.searchsorted(gaps, kept, side="left")) > 0
    return np.asarray(broken)


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


def scattered(x: Array, y: Array, most: int = 2 * FIGURE_COLUMNS) -> Indices:
    """Choose samples that cover the same area as all: one per cell of a grid, and the extremes.

    Parameters
    ----------
    x, y : shape (N,)
    most : samples wanted, about; as many as a line of a figure has show the area they cover

    Returns
    -------
    Their indices, increasing, at most ``most + 4``
    """
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if known.size <= most:
        return known
    a, b = x[known], y[known]
    extremes = known[[a.argmin(), a.argmax(), b.argmin(), b.argmax()]]
    known = spread_over(known)
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
