"""When the rows of a table were: what its clocks say, made to go on where they go back, or else their numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import product

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Findings
from vsalog.core.recording import Stamps
from vsalog.readers.reach import Stamp
from vsalog.readers.tables.time_columns import ClockColumn, folds_of, nanoseconds


class RowTimes:
    """Tells the times of a table's rows, block by block.

    Parameters
    ----------
    clocks : mapping of str to ClockColumn
        By kind.
    parts : collection of str
        Those whose rows go on each by themselves, as of the joints that a long table holds.
    """

    def __init__(self, clocks: Mapping[str, ClockColumn], parts: Collection[str]) -> None:
        self._clocks = clocks
        self._folds = {one: folds_of(clocks[one[0]].form) for one in product(clocks, parts)}

    def of(
        self,
        cells: Callable[[Sequence[int]], Sequence[pa.Array]],
        parts: Mapping[str, NDArray[np.bool_]],
    ) -> tuple[dict[str, Stamps], NDArray[np.bool_]]:
        """Return a block's stamps by kind of clock, and which rows have one.

        Parameters
        ----------
        cells : callable
            Gives columns of the block by their numbers.
        parts : mapping of str to bool array, shape (n,)
            Whose rows they are.
        """
        good = np.ones(len(next(iter(parts.values()), ())), dtype=bool)
        stamps: dict[str, Stamps] = {}
        for kind, clock in self._clocks.items():
            times, valid = nanoseconds(cells(clock.columns), clock.form)
            for part, own in parts.items():
                times = self._folds[kind, part].unfold(times, valid & own)
            if kind == "header":  # without it there is still the log's time, for all rows then
                times = np.where(valid, times, 0)
            else:
                good &= valid
            stamps[kind] = times
        return stamps, good

    def findings(self) -> Findings:
        """Return what to tell."""
        found = Findings()
        found.add(*(one for folds in self._folds.values() for one in folds.findings()))
        return found


def row_clock(first: int, count: int, rate: float | None) -> dict[str, Stamps]:
    """Return the stamps of `count` rows from row `first` on.

    Parameters
    ----------
    first, count : int
        Row numbers.
    rate : float or None
        Samples per second [Hz]; without it the stamps are the bare row numbers, of the kind ``none``.

    Returns
    -------
    dict of str to int64 array, shape (count,)
        Nanoseconds since the first row under ``rate``, or row numbers under ``none``.

    Raises
    ------
    ReadError
        At that rate the rows' times cannot be told apart, or are farther apart than 64 bits reach.
    """
    rows = np.arange(first, first + count, dtype=np.int64)
    if rate is None:
        return {"none": rows}
    if rate > 1e9:
        raise ReadError(f"--rate {rate:g}: rows cannot be less than a nanosecond apart; give the sample rate in Hz")
    if (first + count) * (1e9 / rate) > Stamp.FARTHEST:
        raise ReadError(
            f"--rate {rate:g}: {first + count} rows would last longer than a century; give the sample rate in Hz"
        )
    return {"rate": np.rint(rows * (1e9 / rate)).astype(np.int64)}
