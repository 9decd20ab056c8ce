"""Header stamps that are none, among others that are: zero, absurd, or far from those around them.

A node that starts before its clock is set, a field that nobody filled in, a flipped bit: a few such stamps say nothing against
the others. Their samples have no place in time and are left out; were they put on the log's time, a stream would have two clocks.

What is seconds off may also be a sample that came late. Then its stamp is right, and none is missing where it came.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import PART, parts
from vsalog.core.recording import Stamps
from vsalog.core.resolution import LONGEST_OUTLIER as REACH
from vsalog.readers.clock_steps import DELAY_VARIATION, LARGEST_LEAP
from vsalog.readers.limits import TIMES_LARGER
from vsalog.readers.reach import Nanoseconds, Stamp

MOST_BAD_STAMPS = 0.05
"""Part of the stamps that may be none; of more, it is the clock that is not believed. Frames may be as seldom another's slip."""


def looked_at(kinds: Collection[str], time: str) -> bool:
    """Tell whether a stream may be on header stamps that can be held against the log's times."""
    return time in ("auto", "header") and "header" in kinds and "log" in kinds


def are_few(bad: int, count: int) -> bool:
    """Tell whether so few of the stamps are none that the others are believed."""
    return 0 < bad <= MOST_BAD_STAMPS * count


def bad_rows(header: Stamps, log: Stamps) -> Stamps:
    """Return the rows whose header stamp is none, no more than are needed to see that they are not few; see `bad_stamps`."""
    found, count = [np.empty(0, np.int64)], 0
    for first, last in parts(header, log):
        if count > MOST_BAD_STAMPS * len(header):
            break
        # With the rows next to them that those at the ends are held against.
        begin, end = max(0, first - REACH), min(len(header), last + REACH)
        bad = bad_stamps(header[begin:end], log[begin:end])[first - begin : last - begin]
        found.append(np.flatnonzero(bad) + first)
        count += found[-1].size
    return np.concatenate(found)


def bad_stamps(header: Stamps, log: Stamps) -> NDArray[np.bool_]:
    """Tell which header stamps cannot be the time of their samples.

    Parameters
    ----------
    header, log : int64 array, shape (n,)
        Header stamps and log times [ns].
    """
    delay = log - header
    if not delay.size:
        return np.zeros(0, np.bool_)
    if delay.max() - delay.min() <= DELAY_VARIATION and abs(int(delay[0])) <= Nanoseconds.DAY - DELAY_VARIATION:
        return np.zeros(delay.size, np.bool_)
    bad: NDArray[np.bool_] = np.abs(delay) > Nanoseconds.DAY
    if delay.size > 2 * REACH and delay.max() - delay.min() > LARGEST_LEAP:
        # At either end those beside the last are looked at twice, lest it vouch for itself.
        around = np.lib.stride_tricks.sliding_window_view(np.pad(delay, REACH, mode="reflect"), 2 * REACH + 1)
        bad |= np.abs(delay - np.median(around, axis=1)) > LARGEST_LEAP
    rows = _near_jumps(delay)
    for first in range(0, rows.size, PART):
        some = rows[first : first + PART]
        bad[some] |= _are_off(header, delay, some)
    return bad


def _near_jumps(delay: Stamps) -> Stamps:
    """Return rows with as many on either side as are looked at, close to where delays jump."""
    jumps = np.flatnonzero(np.abs(np.diff(delay)) > DELAY_VARIATION)
    rows = np.unique(jumps[:, None] + np.arange(1 - REACH, REACH + 1))
    return rows[(rows >= REACH) & (rows < delay.size - REACH)]


def _are_off(header: Stamps, delay: Stamps, rows: Stamps) -> NDArray[np.bool_]:
    """Tell which stamps are far from those around them on both sides, which leave the place empty where they came."""
    around = rows[:, None] + np.arange(-REACH, REACH + 1)
    stamps, delays = header[around], delay[around]
    off = np.abs(delays - np.median(delays, axis=1)[:, None])
    good = off <= off[:, REACH : REACH + 1] / TIMES_LARGER
    usual = np.where(good[:, 1:] & good[:, :-1], np.diff(stamps), np.nan)
    known = ~np.isnan(usual).all(axis=1)
    usual[~known] = 0
    # From good stamp to good stamp: all have to increase, and that across the one in the middle is as long as its places.
    last, place = np.full(rows.size, Stamp.NEVER), np.zeros(rows.size, np.int64)
    increasing, gap, places = np.ones(rows.size, np.bool_), np.zeros(rows.size, np.int64), np.zeros(rows.size, np.int64)
    for k in range(2 * REACH + 1):
        here = good[:, k]
        increasing &= ~here | (stamps[:, k] > last)
        crossing = here & (last > Stamp.NEVER) & (place < REACH) & (k > REACH)
        gap, places = np.where(crossing, stamps[:, k] - last, gap), np.where(crossing, k - place, places)
        last, place = np.where(here, stamps[:, k], last), np.where(here, k, place)
    long = 2 * gap > (places + 1) * np.nanmedian(usual, axis=1)
    found: NDArray[np.bool_] = (
        known & increasing & (places > 0) & long & ~good[:, REACH] & (off[:, REACH] > DELAY_VARIATION)
    )
    return found
