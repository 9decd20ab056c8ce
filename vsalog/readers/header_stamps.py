"""Compares header stamps with the log's times: which of them are invalid, and whether the others can be measurement times.

The criterion is the *delay* of a sample, its log time minus its header stamp. A few stamps with another delay than their
neighbours are invalid: they were not filled in, or have a flipped bit. Where the delay changes permanently, since stamps step
back or ahead, the header's clock was set, as by NTP or a restarted controller. Late samples step as well; but after
them the delay returns to its former value, or the log's times come in a burst.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import parts
from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps
from vsalog.core.resolution import LONGEST_OUTLIER
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import MOST_EXCEPTIONS, MOST_PARTS
from vsalog.readers.reach import Nanoseconds, Stamp

LARGEST_LEAP = 60_000_000_000
"""A stamp that is farther [ns] from those around it is invalid; less may be a late message."""

DELAY_VARIATION = 1_000_000_000
"""The usual variation of the delays of samples [ns]."""

DELAY_SAMPLES = round(REPEATS / MOST_EXCEPTIONS)
"""Samples for the difference of stamps and the log's times: on either side as many are exceptions as show a pattern."""

MOST_BAD_STAMPS = 0.05
"""Part of the stamps that may be invalid; with more, the clock is rejected."""

MANY_BAD = Finding(code="clock.many_stamps_far", limit=round(1 / MOST_BAD_STAMPS))


def are_few(bad: int, count: int) -> bool:
    """Return whether so few of the stamps are invalid that the others are accepted."""
    return 0 < bad <= MOST_BAD_STAMPS * count


@dataclass(slots=True)
class HeaderStamps:
    """Statistics of a stream's header stamps.

    Attributes
    ----------
    count, zero, distant, off : int
        Stamps; those that are zero, over a day from the log's times, and invalid for any reason.
    latest, earliest_log : int
        The latest stamp and the earliest log time [ns].
    standing : bool
        Stamps never change, while log times do.
    back, ahead : int
        The largest steps of the clock [ns]; 0 for none.
    """

    count: int = 0
    zero: int = 0
    distant: int = 0
    off: int = 0
    latest: int = -Stamp.FARTHEST
    earliest_log: int = Stamp.FARTHEST
    standing: bool = False
    back: int = 0
    ahead: int = 0
    _rows: list[Stamps] = field(default_factory=list)

    @classmethod
    def of(cls, header: Stamps, log: Stamps) -> HeaderStamps:
        """Add header stamps and log times [ns], shape (n,), in the order of the log."""
        found = cls(len(header), standing=stand_still(header) and not stand_still(log))
        lowest = float("inf")
        for first, last in parts(header, log):
            # With the next rows, for the comparison at the ends.
            begin, end = max(0, first - DELAY_SAMPLES), min(len(header), last + DELAY_SAMPLES)
            stamps, times = header[begin:end], log[begin:end]
            off = far_from_others(times - stamps)
            found._count(stamps[first - begin : last - begin], times[first - begin : last - begin])
            found._take_off(np.flatnonzero(off[first - begin : last - begin]) + first)
            own = slice(*np.searchsorted(np.flatnonzero(~off) + begin, (first, last)))
            lowest = found._look_for_steps(stamps[~off], times[~off], own, lowest)
        return found

    @property
    def rows_off(self) -> Stamps:
        """The rows whose stamp is none, in order; none where these are not few."""
        few = are_few(self.off, self.count)
        return np.concatenate(self._rows) if few else np.empty(0, np.int64)

    def doubt(self) -> Finding | None:
        """Return why the stamps cannot be the times of their samples, None where they can, except for a few."""
        evidence = {"stamps": self.count}
        many = self.off > 0 and not are_few(self.off, self.count)
        if many and self.distant:
            if self.zero:
                return Finding(code="clock.stamps_zero", value=self.zero, evidence=evidence)
            if self.distant == self.count and self.latest < Stamp.YEAR_2000 <= self.earliest_log:
                return Finding(code="clock.stamps_before_2000")
            return Finding(code="clock.stamps_far", value=self.distant, evidence=evidence)
        if self.standing:
            return Finding(code="clock.stamps_all_same")
        for way, size in ("back", self.back), ("ahead", self.ahead):
            if size:
                return Finding(code="clock.stamps_step", value=size * 1e-9, unit="s", evidence={"way": way})
        return MANY_BAD if many else None

    def _count(self, header: Stamps, log: Stamps) -> None:
        self.zero += int(np.count_nonzero(header == 0))
        self.distant += int(np.count_nonzero(np.abs(header - log) > Nanoseconds.DAY))
        self.latest, self.earliest_log = max(self.latest, int(header.max())), min(self.earliest_log, int(log.min()))

    def _take_off(self, rows: Stamps) -> None:
        """Record rows whose stamp is none; of no more than are needed to see that they are not few."""
        if self.off <= MOST_BAD_STAMPS * self.count:
            self._rows.append(rows)
        self.off += rows.size

    def _look_for_steps(self, header: Stamps, log: Stamps, own: slice, lowest: float) -> float:
        """Find steps after a slice of samples; takes and returns the lowest earlier level of the delay."""
        if header.size <= 2 * LONGEST_OUTLIER:
            return lowest
        delay, steps = log - header, np.diff(header)
        leads = steps - np.diff(log)
        # A clock that was set back needs some samples to catch up, and late samples may be early again.
        later = np.concatenate((header[1 + LONGEST_OUTLIER :], header[-1:].repeat(LONGEST_OUTLIER)))
        back = (steps < 0) & (later < header[:-1])
        ahead = (steps > DELAY_VARIATION) & (leads > DELAY_VARIATION)
        places = np.flatnonzero((back | ahead)[own.start : own.stop]) + own.start
        for k in places[np.argsort(-np.abs(leads[places]), kind="stable")[:MOST_PARTS]].tolist():
            before, after = slice(max(0, k + 1 - DELAY_SAMPLES), k + 1), slice(k + 1, k + 1 + DELAY_SAMPLES)
            size = _moved(delay[before], delay[after])
            if 2 * size * np.sign(-leads[k]) <= abs(leads[k]) or _is_burst(header, log, before, after):
                continue
            if size > 0:
                self.back = max(self.back, size)
            # Not where the delay is again what it was before samples had to wait.
            elif 2 * min(lowest, _lowest(delay[: k + 1])) > np.median(delay[before]) + np.median(delay[after]):
                self.ahead = max(self.ahead, -size)
        return min(lowest, _lowest(delay[own]))


def stand_still(stamps: Stamps) -> bool:
    """Return whether all stamps of a stream are the same."""
    return len(stamps) > 2 and all(bool((stamps[a:b] == stamps[0]).all()) for a, b in parts(stamps))


def far_from_others(delay: Stamps) -> NDArray[np.bool_]:
    """Return which header stamps cannot be the time of their samples by the delays [ns], shape (n,), of all."""
    off: NDArray[np.bool_] = np.abs(delay) > Nanoseconds.DAY
    if delay.size > 2 * LONGEST_OUTLIER and delay.max() - delay.min() > LARGEST_LEAP:
        # At either end the neighbours of the last sample count twice, so that it does not confirm itself.
        padded = np.pad(delay, LONGEST_OUTLIER, mode="reflect")
        around = np.lib.stride_tricks.sliding_window_view(padded, 2 * LONGEST_OUTLIER + 1)
        off |= np.abs(delay - np.median(around, axis=1)) > LARGEST_LEAP
    return off


def _lowest(delay: Stamps) -> float:
    """Return the lowest level [ns] that the delay had for a while; infinity without samples."""
    if not delay.size:
        return float("inf")
    whole = delay[: delay.size // DELAY_SAMPLES * DELAY_SAMPLES].reshape(-1, DELAY_SAMPLES)
    return float(np.median(whole if whole.size else delay[None], axis=1).min())


def _moved(before: Stamps, after: Stamps) -> int:
    """Return the increase of the delay [ns] at a step, 0 where that may be jitter."""
    if min(before.size, after.size) <= LONGEST_OUTLIER:
        return 0
    low, level, high = np.quantile(before, (MOST_EXCEPTIONS, 0.5, 1 - MOST_EXCEPTIONS))
    new_low, new_level, new_high = np.quantile(after, (MOST_EXCEPTIONS, 0.5, 1 - MOST_EXCEPTIONS))
    return int(new_level - level) if new_low > high or new_high < low else 0


def _is_burst(header: Stamps, log: Stamps, *sides: slice) -> bool:
    """Return whether samples on either side of a step were recorded in less than half of the time in which they were taken."""
    return any(2 * np.ptp(log[side]) < np.ptp(header[side]) for side in sides)
