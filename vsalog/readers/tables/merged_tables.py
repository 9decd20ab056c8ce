"""Tables that several logs were merged into, or put below one another: each fills its own rows and leaves the others' blank."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.significance import REPEATS
from vsalog.readers.columns_together import LEAST_TOGETHER
from vsalog.readers.limits import SAMPLE_ROWS

Whole = Callable[[Sequence[int]], Iterable[Sequence[pa.Array]]]
"""Gives some columns from their first row to the last, part by part."""
Stretch = Sequence[pa.Array]
"""Rows of a table that follow one another, of all columns."""


def stretches(sample: Stretch, columns: Sequence[int], whole: Whole) -> list[Stretch]:
    """Return the first rows, and those where columns begin that were blank, if they leave others blank that were not.

    Parameters
    ----------
    sample : sequence of pyarrow arrays
        First rows of all columns.
    columns : sequence of int
        Those of channels.
    whole : callable
        Is asked for columns that are blank in the first rows, and for all channels only where these begin.
    """
    late = [i for i in columns if len(sample[i]) and blank(sample[i]).all()]
    begins = sorted(set(_begins(late, whole)))[:REPEATS] if 0 < len(late) < len(columns) else []
    found = [sample]
    for rows in _rows_from(begins, columns, whole):
        stretch = [rows.get(i, pa.nulls(len(rows[columns[0]]), cells.type)) for i, cells in enumerate(sample)]
        if any(blank(stretch[i]).all() and not blank(sample[i]).all() for i in columns):
            found.append(stretch)
    return found


def group_by_blanks(stretches: Sequence[Stretch], columns: Sequence[int]) -> list[list[int]]:
    """Group columns that fill the same rows.

    Parameters
    ----------
    stretches : sequence of sequences of pyarrow arrays
        Rows of all columns from here and there.
    columns : sequence of int
        The columns to group.

    Returns
    -------
    list of list of int
        First the columns that are (nearly) full, even if there are none; then the groups of those with many blanks.
    """
    full: list[int] = []
    sparse: dict[bytes, list[int]] = {}
    for i in columns:
        blanks = [blank(rows[i]) for rows in stretches]
        if max(one.mean() for one in blanks) < 1 - LEAST_TOGETHER or all(one.all() for one in blanks):
            full.append(i)
        else:
            sparse.setdefault(np.concatenate(blanks).tobytes(), []).append(i)
    return [full, *sparse.values()]


class Layers:
    """Tables that were put below one another, by the columns that rows of each fill.

    Parameters
    ----------
    stretches, groups : as for, and from, `group_by_blanks`

    Attributes
    ----------
    columns : list of int
        Those that tell which table a row is of; none where there is but one.
    apart : bool
        There are several, which may take turns, too.
    """

    def __init__(self, stretches: Sequence[Stretch], groups: Sequence[list[int]]) -> None:
        self._tables: list[tuple[list[int], NDArray[np.bool_]]] = []
        for group in groups[1:]:
            filled = ~np.concatenate([blank(rows[group[0]]) for rows in stretches])
            together = [table for table in self._tables if (table[1] & filled).any()]
            self._tables = [table for table in self._tables if not (table[1] & filled).any()]
            for columns, theirs in together:
                group, filled = [*columns, *group], filled | theirs
            self._tables.append((group, filled))
        self.apart = len(self._tables) > 1
        if not self.apart or len(stretches) < 2:
            self._tables = []
        self.columns = [i for columns, _ in self._tables for i in columns]
        self._last = 0

    @property
    def count(self) -> int:
        """How many tables there are."""
        return max(len(self._tables), 1)

    def rows(self, cells: Callable[[Sequence[int]], Sequence[pa.Array]], count: int) -> list[NDArray[np.bool_]]:
        """Return which of a block's rows are of which table; blocks are given in their order.

        Parameters
        ----------
        cells : callable
            Gives columns of the block by their numbers.
        count : int
            How many rows it has.
        """
        if not self._tables or not count:
            return [np.ones(count, bool)] * self.count
        which = np.full(count, -1)
        for k, (columns, _) in reversed([*enumerate(self._tables)]):
            which[~np.logical_and.reduce([blank(one) for one in cells(columns)])] = k
        # A row that tells nothing is of the same table as the one before.
        at = np.maximum.accumulate(np.where(which >= 0, np.arange(count), -1))
        which = np.where(at >= 0, which[at], self._last)
        self._last = int(which[-1])
        return [which == k for k in range(self.count)]


def columns_apart(sparse: int, layers: Layers) -> list[Finding]:
    """Return what to tell of columns with many blanks, in so many groups."""
    if not sparse:
        return []
    apart = Finding(code="table.columns_apart", value=sparse)
    return [apart, Finding(code="table.stacked", value=layers.count)] if layers.count > 1 else [apart]


def blank(cells: pa.Array) -> NDArray[np.bool_]:
    """Return which cells are empty or no number."""
    return np.asarray(pc.is_null(cells, nan_is_null=True).to_numpy(zero_copy_only=False), dtype=bool)


def _begins(late: Sequence[int], whole: Whole) -> Iterable[int]:
    """Yield at which row each column begins, of those that do."""
    row, left = 0, {*range(len(late))}
    for part in whole(late):
        for k in [*left]:
            filled = np.flatnonzero(~blank(part[k]))
            if filled.size:
                left.discard(k)
                yield row + int(filled[0])
        if not left:
            return
        row += len(part[0])


def _rows_from(begins: Sequence[int], columns: Sequence[int], whole: Whole) -> Iterable[dict[int, pa.Array]]:
    """Yield some rows of columns from each of some rows on."""
    row, left = 0, [*begins]
    if not left:
        return
    for part in whole(columns):
        while left and left[0] < row + len(part[0]):
            at = left.pop(0) - row
            yield {i: cells.slice(at, SAMPLE_ROWS) for i, cells in zip(columns, part, strict=True)}
        if not left:
            return
        row += len(part[0])
