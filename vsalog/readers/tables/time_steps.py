"""Clocks of tables that are set back while the rows go on, as NTP does it: what follows would fall among what was before.

Late rows are not meant: they fill a gap, or are followed by a leap to where the clock was. Nor are rows that were written twice,
nor logs that were put together in another order, which end where the others begin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps, Values
from vsalog.core.resolution import LONGEST_OUTLIER
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import BLOCK_ROWS, MOST_PARTS
from vsalog.readers.reach import Stamp

Marks = Callable[[], Values]
"""Gives a number for each row of a block that other values would change."""


class StepsBack:
    """Lets a clock that was set back go on from where it was, block by block.

    Attributes
    ----------
    sizes : list of int
        By how much it was set back [ns], in the order of the rows.
    """

    def __init__(self) -> None:
        self.sizes: list[int] = []
        self._shift = 0
        self._first = self._last = self._latest = 0
        self._gaps = np.empty((0, 2), np.int64)
        self._before: tuple[Stamps, Marks, NDArray[np.bool_]] | None = None

    def unfold(self, stamps: Stamps, good: NDArray[np.bool_], marks: Marks) -> Stamps:
        """Return a block's stamps [ns], shape (n,); those that are not `good` stay as they are.

        Parameters
        ----------
        stamps : int64 array, shape (n,)
            In the order of the rows.
        good : bool array, shape (n,)
            Which rows have one.
        marks : callable
            Called only where rows may be copies of others.
        """
        good = good & (stamps > -Stamp.FARTHEST) & (stamps < Stamp.FARTHEST)
        times = stamps[good] + self._shift
        if not times.size:
            return stamps
        if self._before is None:
            self._first = self._last = self._latest = int(times[0])
        steps = np.diff(times, prepend=self._last)
        if steps.min() > 0 and steps.max() <= REPEATS // 2 * steps.min():  # no gap, and nothing set back
            return self._unfolded(stamps, good, times, marks)
        forward = steps[steps > 0]
        few = REPEATS * int(np.median(forward)) if forward.size else 0
        for k in np.flatnonzero(steps < -few)[:MOST_PARTS].tolist() if few else ():
            if self._shift - steps[k] > Stamp.YEAR_2000:
                break
            if self._is_set_back(times, steps, k, few) and not self._are_copies(times, k, good, marks):
                size = few // REPEATS - int(steps[k])
                times[k:] += size
                self._shift += size
                self.sizes.append(size)
        self._gaps = np.concatenate([self._gaps, _gaps(times, self._last, few)])[-BLOCK_ROWS:]
        return self._unfolded(stamps, good, times, marks)

    def findings(self) -> list[Finding]:
        """Return what to tell."""
        if not self.sizes:
            return []
        most, evidence = max(self.sizes) * 1e-9, {"times": len(self.sizes)}
        return [Finding(code="clock.steps_back", value=most, unit="s", evidence=evidence)]

    def _is_set_back(self, times: Stamps, steps: Stamps, k: int, few: int) -> bool:
        """Tell whether rows from the `k`-th on go evenly through times that rows before have filled."""
        latest = max(self._latest, int(times[:k].max(initial=self._latest)))
        leaps = np.flatnonzero((steps[k + 1 :] < -few) | (steps[k + 1 :] > max(few, -steps[k] // 2)))
        end = k + 1 + int(leaps[0]) if leaps.size else times.size
        if end - k <= LONGEST_OUTLIER or (end < times.size and times[end - 1] < latest):
            return False
        begin, reach = max(int(times[k]), self._first), min(int(times[end - 1]), latest)
        gaps = np.concatenate([self._gaps, _gaps(times[:k], self._last, few)])
        inside = np.minimum(gaps[:, 1], reach) - np.maximum(gaps[:, 0], begin)
        return reach - begin > max(few, 2 * int(inside[inside > 0].sum()))

    def _are_copies(self, times: Stamps, k: int, good: NDArray[np.bool_], marks: Marks) -> bool:
        """Tell whether most rows from the `k`-th on that have times of rows before have their values, too."""
        own = marks()[good]
        earlier, values = times[:k], own[:k]
        if self._before is not None:
            before, theirs, which = self._before
            earlier, values = np.concatenate([before, earlier]), np.concatenate([theirs()[which], values])
        order = np.argsort(earlier, kind="stable")
        later = k + np.flatnonzero(times[k:] <= earlier.max())
        found = order[np.minimum(np.searchsorted(earlier[order], times[later]), order.size - 1)]
        same = (earlier[found] == times[later]) & (values[found] == own[later])
        return bool(2 * np.count_nonzero(same) > later.size)

    def _unfolded(self, stamps: Stamps, good: NDArray[np.bool_], times: Stamps, marks: Marks) -> Stamps:
        """Return a block's stamps with those put in that are good, and remember these."""
        self._last, self._latest = int(times[-1]), max(self._latest, int(times.max()))
        self._before = times, marks, good
        unfolded = stamps.copy()
        unfolded[good] = times
        return unfolded


def row_marks(columns: Mapping[str, Values], rows: int) -> Values:
    """Return a number for each of a block's rows that other values would change, shape (rows,)."""
    marks = np.zeros(rows)
    for values in columns.values():
        marks += np.nan_to_num(values)
    return marks


def _gaps(times: Stamps, last: int, few: int) -> Stamps:
    """Return begin and end of stretches without rows, as long as late ones need."""
    before = np.concatenate([[last], times[:-1]])[: times.size]
    long = times - before > max(few // 2, 1)
    return np.stack([before[long], times[long]], axis=1)
