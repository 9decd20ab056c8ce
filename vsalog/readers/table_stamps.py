"""Invalid stamps of a table's only clock: dates before the clock was set, and stamps far from those around them.

There is no other clock to compare them with: stamps before a pause, or in order, are accepted.
"""

from __future__ import annotations

import numpy as np

from vsalog.core.column import parts
from vsalog.core.recording import Stamps
from vsalog.core.resolution import LONGEST_OUTLIER as REACH
from vsalog.readers.header_stamps import LARGEST_LEAP, are_few
from vsalog.readers.reach import Stamp


def stamps_that_are_none(stamps: Stamps) -> Stamps:
    """Return the rows whose stamps [ns] cannot be the time of their samples, in order.

    Parameters
    ----------
    stamps : int64 array, shape (n,)
        In the order of the log.
    """
    unset = _of_other_times(stamps)
    lone = np.concatenate([np.empty(0, np.int64), *(_lone(stamps, first, last) for first, last in parts(stamps))])
    return np.union1d(unset, lone) if are_few(lone.size, len(stamps)) else unset


def _of_other_times(stamps: Stamps) -> Stamps:
    """Return the rows of dates where most stamps are counted from some start, or the other way round."""
    dated = [np.flatnonzero(stamps[first:last] >= Stamp.YEAR_2000) + first for first, last in parts(stamps)]
    count = sum(rows.size for rows in dated)
    if not 0 < count < len(stamps):
        return np.empty(0, np.int64)
    rows = np.concatenate(dated)
    return rows if 2 * count < len(stamps) else np.delete(np.arange(len(stamps)), rows)


def _lone(stamps: Stamps, first: int, last: int) -> Stamps:
    """Return rows from the `first` to the `last` whose stamps are far from the middle of those around them."""
    begin, end = max(0, first - REACH), min(len(stamps), last + REACH)
    some = stamps[begin:end]
    if some.size <= 2 * REACH or (some.size > 1 and np.diff(some).min() >= 0):
        return np.empty(0, np.int64)
    around = np.lib.stride_tricks.sliding_window_view(some, 2 * REACH + 1)
    rows = np.flatnonzero(np.abs(some[REACH:-REACH] - np.median(around, axis=1)) > LARGEST_LEAP) + begin + REACH
    return rows[(rows >= first) & (rows < last)]
