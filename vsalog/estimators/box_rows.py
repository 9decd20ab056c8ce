"""Averages of an equation's rows over boxes of samples, which keep a linear equation true and shorten it.

A box is a part of a filter's window, so that averages lose no motion that the filter has left. Boxes lie on a grid that begins
where a run does, the same for all equations of a joint.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


class Boxes(NamedTuple):
    """How long boxes are.

    Attributes
    ----------
    per_window : of a filter's window, within which noise is correlated [1]
    """

    per_window: int = 6


BOXES = Boxes()


class BoxRows(NamedTuple):
    """Averaged rows of an equation.

    Attributes
    ----------
    rows : shape (M, c), averages of c columns
    place : shape (M,), sample in the middle of each box
    first : shape (M,), where the box before is missing
    size : samples of a box
    """

    rows: Array
    place: Integers
    first: Flags
    size: int

    def only(self, keep: Flags) -> BoxRows:
        """Return some of the boxes, shape (M,) of flags."""
        first = self.first | ~np.r_[True, keep[:-1]]
        return BoxRows(self.rows[keep], self.place[keep], first[keep], self.size)


class BoxState(NamedTuple):
    """The state of boxes between blocks.

    Attributes
    ----------
    sums : of the box that fills, shape (c,)
    counts : its samples, samples seen, whether the box before is missing, and whether all samples of this one are there
    done : boxes that are full
    """

    sums: Array
    counts: Integers
    done: tuple[BoxRows, ...] = ()

    @property
    def whole(self) -> BoxRows:
        """All boxes that are full."""
        if not self.done:
            return BoxRows(np.empty((0, self.sums.size)), np.empty(0, np.int64), np.empty(0, np.bool_), 1)
        rows, place, first = (np.concatenate([part[i] for part in self.done]) for i in range(3))
        return BoxRows(rows, place, first, self.done[0].size)


def box_start(columns: int) -> BoxState:
    """Return the state before the first sample, for a number of columns."""
    return BoxState(np.zeros(columns), np.array([0, 0, 1, 1]))


def box_block(state: BoxState, columns: Array, use: Flags, starts: Flags, size: int) -> BoxState:
    """Go on with a block.

    Parameters
    ----------
    columns : shape (N, c)
    use, starts : shape (N,), samples that count, all of a box have to, and those before which one is missing
    size : samples of a box
    """
    sums, counts = state.sums.copy(), state.counts.copy()
    most = columns.shape[0] // size + 1
    rows, place, first = np.empty((most, sums.size)), np.empty(most, np.int64), np.empty(most, np.bool_)
    found = _average(np.ascontiguousarray(columns), use, starts, size, sums, counts, rows, place, first)
    return BoxState(sums, counts, (*state.done, BoxRows(rows[:found], place[:found], first[:found], size)))


@compiled
def _average(
    columns: Array, use: Flags, starts: Flags, size: int, sums: Array, counts: Integers, rows: Array, place: Integers,
    first: Flags,
) -> int:  # fmt: skip
    filled, seen, missing, whole = counts[0], counts[1], counts[2], counts[3]
    found = 0
    for k in range(columns.shape[0]):
        if starts[k]:
            filled, missing = 0, 1
        if filled == 0:
            whole = 1
        seen += 1
        filled += 1
        if use[k] and whole:
            for j in range(sums.size):
                sums[j] = columns[k, j] + (sums[j] if filled > 1 else 0.0)
        else:
            whole = 0
        if filled == size:
            filled = 0
            if not whole:
                missing = 1
                continue
            for j in range(sums.size):
                rows[found, j] = sums[j] / size
            place[found], first[found] = seen - 1 - size // 2, missing == 1
            missing = 0
            found += 1
    counts[0], counts[1], counts[2], counts[3] = filled, seen, missing, whole
    return found
