"""Clocks that go back, made to go on: at midnight, in autumn by an hour, where a counter is full, where a log was appended."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.reach import Nanoseconds, Stamp

_FULL = tuple(2**32 * unit for unit in (1, 10**3, 10**6))
"""How far counters of nanoseconds, microseconds and milliseconds reach that have 32 bits [ns]."""


class SetBack(IntEnum):
    """Hours by which clocks go back: where summer time ends, and those without AM and PM."""

    SUMMER_TIME = 1
    HALF_A_DAY = 12


class Folds:
    """Makes the stamps of a clock go on where the clock goes back, block by block.

    Parameters
    ----------
    period : int
        After how long the clock wraps [ns].
    dated : bool
        A date column goes with it: it wraps only where the date stays the same, because that is the date of the log's begin.
    """

    def __init__(self, period: int, dated: bool) -> None:
        self._period, self._dated = period, dated
        self._last: int | None = None
        self._step = 0
        self._turns = self._lowest = self._hours = 0
        self._most = 0
        self._often = dict.fromkeys(map(int, SetBack), 0)

    def unfold(self, stamps: Stamps, good: NDArray[np.bool_]) -> Stamps:
        """Return a block's stamps [ns], shape (n,); those that are not `good` stay as they are."""
        times = stamps[good]
        if not times.size:
            return stamps
        before = np.concatenate([times[:1] if self._last is None else [self._last], times[:-1]])
        self._last = int(times[-1])
        steps = times - before
        self._step = int(np.median(steps)) or self._step
        if not (steps < 0).any() and not self._turns and not self._hours:
            return stamps
        hours = self._hours_back(steps)
        back = np.cumsum(hours) + self._hours
        self._hours = int(back[-1])
        unfolded = stamps.copy()
        unfolded[good] = times + back * Nanoseconds.HOUR + self._periods(times, before, hours > 0) * self._period
        return unfolded

    def findings(self) -> list[Finding]:
        """Return what to tell."""
        what = {"what": "at midnight" if self._period == Nanoseconds.DAY else "after an hour"}
        begun = [Finding(code="clock.restarts", value=self._most, evidence=what)] if self._most else []
        return begun + [
            Finding(code="clock.set_back", value=often, evidence={"hours": hours})
            for hours, often in self._often.items()
            if often
        ]

    def _periods(self, times: Stamps, before: Stamps, told: NDArray[np.bool_]) -> Stamps:
        """Return how often the clock has wrapped by each sample."""
        steps = times - before
        near = self._period // 24
        wraps = steps < -self._period // 8  # no sample comes so late
        if self._dated:
            wraps &= (steps < near - self._period) & (times // Nanoseconds.DAY == before // Nanoseconds.DAY)
        wraps &= ~told
        # A sample from before midnight that comes after it, or a date that follows late.
        undone = np.abs(steps - self._period) < near
        turns = self._turns + np.cumsum(wraps.astype(np.int64) - undone)
        lowest = np.minimum(np.minimum.accumulate(turns), self._lowest)
        self._turns, self._lowest = int(turns[-1]), int(lowest[-1])
        self._most = max(self._most, int((turns - lowest).max()))
        return turns - lowest

    def _hours_back(self, steps: Stamps) -> Stamps:
        """Return by how many hours the clock is set back at each sample."""
        hours = np.zeros(len(steps), np.int64)
        near = min(REPEATS * self._step, Nanoseconds.MINUTE)
        for size in map(int, SetBack) if self._period == Nanoseconds.DAY else ():
            back = (steps > -size * Nanoseconds.HOUR) & (steps <= near - size * Nanoseconds.HOUR)
            hours[back] = size
            self._often[size] += int(np.count_nonzero(back))
        return hours


class Restarts:
    """Puts what was appended to a log behind it, and what follows an overflow, block by block."""

    def __init__(self) -> None:
        self._first: int | None = None
        self._last = self._step = 0
        self._shift = self._count = self._overflows = 0

    def unfold(self, stamps: Stamps, good: NDArray[np.bool_]) -> Stamps:
        """Return a block's stamps [ns], shape (n,), those of a later log behind the earlier ones, with a gap between."""
        times = stamps[good]
        if not times.size:
            return stamps
        if self._first is None:
            self._first = self._last = int(times[0])
        before = np.concatenate([[self._last], times[:-1]])
        self._last = int(times[-1])
        falls = times < before
        if not falls.any() and not self._shift:
            self._step = int(times[-1]) - int(before[-1])
            return stamps
        unfolded = stamps.copy()
        unfolded[good] = times + self._shifts(times, before, falls)
        return unfolded

    def findings(self) -> list[Finding]:
        """Return what to tell."""
        found = (
            Finding(code="clock.log_appended", value=self._count),
            Finding(code="clock.overflows", value=self._overflows),
        )
        return [one for one in found if one.value]

    def _shifts(self, times: Stamps, before: Stamps, falls: NDArray[np.bool_]) -> Stamps:
        """Return by how much each sample is put later."""
        assert self._first is not None
        steps = np.clip(times - before, -Stamp.YEAR_2000, Stamp.YEAR_2000)
        few = REPEATS * int(np.median(steps[steps > 0])) if (steps > 0).any() else 0
        earlier, later = np.append(self._step, steps[:-1]), np.append(steps[1:], 0)
        # The clock goes on from the first stamps; a single stamp that is wrong, before or here, is left where it is.
        restarts = falls & (-steps > few) & (times <= self._first + few) & (np.maximum(earlier, later) < -steps // 2)
        restarts &= (self._first < Stamp.YEAR_2000) & (-steps < Stamp.YEAR_2000)
        restarts &= 2 * np.count_nonzero(falls) <= len(steps)  # else the newest rows are first
        full = np.zeros(len(steps), np.int64)
        for size in _FULL:
            if few < size // 4:
                full[falls & (before >= size - few) & (before < size) & (times <= few)] = size
        restarts &= full == 0
        self._count += int(np.count_nonzero(restarts))
        self._overflows += int(np.count_nonzero(full))
        shifts = self._shift + np.cumsum(np.where(restarts, few - steps, full))
        self._shift, self._step = int(shifts[-1]), int(steps[-1])
        return shifts
