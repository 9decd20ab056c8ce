"""The times of a table's rows: by its clocks, continued where they step back, or else by the row numbers.

Clocks step back at midnight, where a counter overflows, and where a log was appended.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import product

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.reach import Nanoseconds, Stamp
from vsalog.readers.tables.time_columns import ClockColumn, nanoseconds

_FULL = tuple(2**32 * unit for unit in (1, 10**3, 10**6))
"""The range of counters of nanoseconds, microseconds and milliseconds with 32 bits [ns]."""


class Unfolding:
    """Continues the stamps of a clock where the clock steps back, block by block.

    Times of day restart at midnight, and minutes after an hour. For any other clock, an appended log is put after the
    first one, with a gap, and stamps after an overflow continue.

    Parameters
    ----------
    form : str
        As in `ClockColumn`.
    """

    def __init__(self, form: str) -> None:
        kind = form.partition(" ")[0]
        self._dated = kind in ("date", "date+day")
        self._period = Nanoseconds.HOUR if kind == "minutes" else Nanoseconds.DAY if self._dated or kind == "day" else 0
        self._begun = False
        self._first = self._last = self._step = self._shift = 0
        self._turns = self._restarts = self._appended = self._overflows = 0

    def unfold(self, stamps: Stamps, good: NDArray[np.bool_]) -> Stamps:
        """Return a block's stamps [ns], shape (n,); those that are not `good` stay as they are."""
        times = stamps[good]
        if not times.size:
            return stamps
        if not self._begun:
            self._begun, self._first, self._last = True, int(times[0]), int(times[0])
        before = np.concatenate([[self._last], times[:-1]])
        self._last = int(times[-1])
        steps = np.clip(times - before, -Stamp.YEAR_2000, Stamp.YEAR_2000)
        sizes = self._turn(times, before, steps) if self._period else self._append(times, before, steps)
        shifts = self._shift + np.cumsum(sizes)
        if not shifts.any():
            return stamps
        self._shift = int(shifts[-1])
        unfolded = stamps.copy()
        unfolded[good] = times + shifts
        return unfolded

    def _turn(self, times: Stamps, before: Stamps, steps: Stamps) -> Stamps:
        """Return the additional shift of each sample and those after it [ns]: a period where the clock restarts."""
        late = self._period // 24
        wraps = steps < -self._period // 8  # no sample comes so late
        if self._dated:  # only where the date stays the same, because that is the date of the log's begin
            wraps &= (steps < late - self._period) & (times // Nanoseconds.DAY == before // Nanoseconds.DAY)
        # A sample from before midnight may come after it, or a date follow late: that undoes a turn, where there was one.
        walk = self._turns + np.cumsum(wraps.astype(np.int64) - (np.abs(steps - self._period) < late))
        turns = walk - np.minimum(np.minimum.accumulate(walk), 0)
        sizes: Stamps = np.diff(turns, prepend=self._turns) * self._period
        self._turns, self._restarts = int(turns[-1]), max(self._restarts, int(turns.max()))
        return sizes

    def _append(self, times: Stamps, before: Stamps, steps: Stamps) -> Stamps:
        """Return the additional shift of each sample and those after it [ns]: after the earlier samples."""
        ahead, self._step = self._step, int(steps[-1])
        falls = steps < 0
        sizes = np.zeros(len(steps), np.int64)
        if not falls.any():
            return sizes
        earlier, later = np.append(ahead, steps[:-1]), np.append(steps[1:], 0)
        few = min(REPEATS * int(np.median(steps[steps > 0])), Stamp.YEAR_2000) if (steps > 0).any() else 0
        # The clock continues from the first stamps; a single wrong stamp, before or here, is left unchanged.
        restarts = falls & (-steps > few) & (times <= self._first + few) & (np.maximum(earlier, later) < -steps // 2)
        restarts &= (self._first < Stamp.YEAR_2000) & (-steps < Stamp.YEAR_2000)
        restarts &= 2 * np.count_nonzero(falls) <= len(steps)  # else the newest rows are first
        sizes[restarts] = few - steps[restarts]
        for size in _FULL:
            if few < size // 4:
                sizes[falls & (before >= size - few) & (before < size) & (times <= few)] = size
        overflows = np.isin(sizes, _FULL)
        self._appended += int(np.count_nonzero(restarts & ~overflows))
        self._overflows += int(np.count_nonzero(overflows))
        return sizes

    def findings(self) -> list[Finding]:
        """Return the findings."""
        what = {"what": "at midnight" if self._period == Nanoseconds.DAY else "after an hour"}
        found = (
            Finding(code="clock.restarts", value=self._restarts, evidence=what),
            Finding(code="clock.log_appended", value=self._appended),
            Finding(code="clock.overflows", value=self._overflows),
        )
        return [one for one in found if one.value]


class RowTimes:
    """Returns the times of a table's rows, block by block.

    Parameters
    ----------
    clocks : mapping of str to ClockColumn
        By kind.
    parts : collection of str
        Those whose rows each continue by themselves, as of the joints in a long table.
    """

    def __init__(self, clocks: Mapping[str, ClockColumn], parts: Collection[str]) -> None:
        self._clocks = clocks
        self._folds = {one: Unfolding(clocks[one[0]].form) for one in product(clocks, parts)}

    def of(
        self,
        cells: Callable[[Sequence[int]], Sequence[pa.Array]],
        parts: Mapping[str, NDArray[np.bool_]],
    ) -> tuple[dict[str, Stamps], NDArray[np.bool_]]:
        """Return a block's stamps by kind of clock, and which rows have one.

        Parameters
        ----------
        cells : callable
            Returns columns of the block by their numbers.
        parts : mapping of str to bool array, shape (n,)
            The rows of each owner.
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
        """Return the findings."""
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
        At that rate the rows' times are equal, or exceed the range of 64 bits.
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
