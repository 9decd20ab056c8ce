"""Moments of averaged rows, block by block of a log: what tests of a residual read (`core/dependence.py`), in bounded memory.

Rows are averages over as many samples as a filter's window has. That leaves linear equations as true as they are, and takes most
of the noise of differentiated encoders out of both sides alike.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.core.dependence import MOST_BLOCKS

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

AVERAGED_SAMPLES = 25
"""Samples that are averaged, at least: half of the usual window of a filter, within which noise is correlated."""
ROWS_OF_LONG = 4
"""Rows of a long average, of which a motion of a few windows is left and of noise a quarter of the power."""


class Count(IntEnum):
    """Places of `RowMoments.counts`: samples of the row, the block that fills, its rows, rows of a block."""

    SAMPLES, BLOCK, ROWS, PER_BLOCK = range(4)


class RowMoments(NamedTuple):
    """Sums over K columns; the last is the rate of change of one of the others where that is wanted.

    Attributes
    ----------
    row : shape (K,), sums of the row that fills
    last : shape (1,), the sample before of the column whose rate of change is wanted; NaN where there is none
    moments : shape (MOST_BLOCKS, K, K), the lower half of Σ z zᵀ of each block's rows; two become one when all are full
    counts : shape (4,), samples of the row, the block that fills, its rows, rows of a block
    """

    row: Array
    last: Array
    moments: Array
    counts: Integers

    @property
    def blocks(self) -> Array:
        """Σ z zᵀ of the blocks, shape (B, K, K)."""
        half = self.moments[
            : int(self.counts[Count.BLOCK]) + int(2 * self.counts[Count.ROWS] >= self.counts[Count.PER_BLOCK])
        ]
        return np.asarray(half + np.tril(half, -1).swapaxes(1, 2))

    @property
    def sizes(self) -> Array:
        """How many rows each block has, shape (B,)."""
        sizes = np.full(len(self.blocks), float(self.counts[Count.PER_BLOCK]))
        if sizes.size > self.counts[Count.BLOCK]:
            sizes[-1] = self.counts[Count.ROWS]
        return sizes

    @property
    def rows(self) -> int:
        """How many rows the blocks have."""
        return int(self.sizes.sum())


def row_moments_start(columns: int) -> RowMoments:
    """Return the state before the first sample, for a number of columns with the rate of change."""
    counts = np.array([0, 0, 0, 1])
    return RowMoments(np.zeros(columns), np.full(1, np.nan), np.zeros((MOST_BLOCKS, columns, columns)), counts)


def row_moments_block(
    state: RowMoments, columns: Array, use: Flags, starts: Flags, window: int, period: float = 1.0, rate_of: int = -1
) -> RowMoments:  # fmt: skip
    """Go on with the sums.

    Parameters
    ----------
    columns : shape (N, K), or (N, K − 1) where a rate of change is wanted
    use, starts : shape (N,), samples that count, and those before which one is missing
    window : samples of a row
    period : [s]
    rate_of : the column whose rate of change between the ends of a row is the last one; −1 for none
    """
    new = RowMoments(state.row.copy(), state.last.copy(), state.moments.copy(), state.counts.copy())
    finite = use & np.isfinite(columns).all(axis=1)
    _run(np.ascontiguousarray(columns), finite, starts, window, period, rate_of, *new)
    return new


@compiled
def _run(
    columns: Array, use: Flags, starts: Flags, window: int, period: float, rate_of: int,
    row: Array, last: Array, moments: Array, counts: Integers,
) -> None:  # fmt: skip
    n, m = columns.shape[1], row.size
    for k in range(columns.shape[0]):
        if starts[k] or not use[k]:
            row[:] = 0.0
            counts[Count.SAMPLES] = 0
            last[0] = np.nan
        if not use[k]:
            continue
        if rate_of >= 0:
            before = last[0]
            last[0] = columns[k, rate_of]
            if np.isnan(before):
                continue
            row[m - 1] += (last[0] - before) / period
        for i in range(n):
            row[i] += columns[k, i]
        counts[Count.SAMPLES] += 1
        if counts[Count.SAMPLES] < window:
            continue
        block, weight = counts[Count.BLOCK], 1.0 / (window * window)
        for i in range(m):
            if row[i] != 0.0:
                for j in range(i + 1):
                    if row[j] != 0.0:
                        moments[block, i, j] += weight * row[i] * row[j]
        row[:] = 0.0
        counts[Count.SAMPLES] = 0
        counts[Count.ROWS] += 1
        if counts[Count.ROWS] == counts[Count.PER_BLOCK]:
            counts[Count.ROWS] = 0
            counts[Count.BLOCK] += 1
        if counts[Count.BLOCK] == moments.shape[0]:
            half = moments.shape[0] // 2
            # Entry by entry: numba takes two seconds to compile how one array is written into another.
            for b in range(moments.shape[0]):
                for i in range(m):
                    for j in range(m):
                        both = moments[2 * b, i, j] + moments[2 * b + 1, i, j] if b < half else 0.0
                        moments[b, i, j] = both
            counts[Count.BLOCK] = half
            counts[Count.PER_BLOCK] *= 2


def lasts(long: float, short: float) -> bool:
    """Return whether the power in short averages is in long ones too: of an effect all is, of noise 1/ROWS_OF_LONG.

    The middle between both, on a logarithmic scale, decides.
    """
    return long * math.sqrt(ROWS_OF_LONG) > short
