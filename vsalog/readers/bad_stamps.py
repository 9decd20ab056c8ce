"""Header stamps that are none, among others that are: zero, absurd, or far from those around them.

A node that starts before its clock is set, a field that nobody filled in, a flipped bit: a few such stamps say nothing against
the others. Their samples have no place in time and are left out; were they put on the log's time, a stream would have two clocks.

What is seconds off may also be a sample that came late. Then its stamp is right, and none is missing where it came.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from vsalog.readers.clock_steps import AHEAD, NEAR
from vsalog.recording import Stamps

_FAR = 4  # times farther from where it belongs than those around it

ONE_DAY = 86_400_000_000_000

FEW = 20
"""One in so many stamps may be none; of more, it is the clock that is not believed."""

REACH = 3
"""So many samples on each side tell where the stamp of the one between them belongs. More that are
off may be a clock that was set."""


def looked_at(kinds: Collection[str], time: str) -> bool:
    """Tell whether a stream may be on header stamps that can be held against the log's times."""
    return time in ("auto", "header") and "header" in kinds and "log" in kinds


def are_few(bad: int, count: int) -> bool:
    """Tell whether so few of the stamps are none that the others are believed."""
    return 0 < FEW * bad <= count


def bad_stamps(header: Stamps, log: Stamps) -> NDArray[np.bool_]:
    """Tell which header stamps cannot be the time of their samples.

    Parameters
    ----------
    header, log : int64 array, shape (n,)
        Header stamps and log times [ns].
    """
    delay = log - header
    if not delay.size or (delay.max() - delay.min() <= NEAR and abs(int(delay[0])) <= ONE_DAY - NEAR):
        return np.zeros(delay.size, np.bool_)
    bad: NDArray[np.bool_] = np.abs(delay) > ONE_DAY
    if delay.size > 2 * REACH and delay.max() - delay.min() > AHEAD:
        # At either end those beside the last are looked at twice, lest it vouch for itself.
        around = np.lib.stride_tricks.sliding_window_view(np.pad(delay, REACH, mode="reflect"), 2 * REACH + 1)
        bad |= np.abs(delay - np.median(around, axis=1)) > AHEAD
    for row in _near_jumps(delay):
        bad[row] |= _is_off(header, delay, row)
    return bad


def _near_jumps(delay: Stamps) -> list[int]:
    """Return rows with as many on either side as are looked at, close to where delays jump."""
    jumps = np.flatnonzero(np.abs(np.diff(delay)) > NEAR)
    rows = np.unique(jumps[:, None] + np.arange(1 - REACH, REACH + 1))
    return [int(row) for row in rows if REACH <= row < delay.size - REACH]


def _is_off(header: Stamps, delay: Stamps, row: int) -> bool:
    """Tell whether a stamp is far from those around it on both sides, which leave the place empty where it came."""
    around = slice(row - REACH, row + REACH + 1)
    stamps, off = header[around], np.abs(delay[around] - np.median(delay[around]))
    good = np.flatnonzero(off <= off[REACH] / _FAR)
    right = int(np.searchsorted(good, REACH))
    if off[REACH] <= NEAR or not 0 < right < good.size:
        return False
    steps, counts = np.diff(stamps[good]), np.diff(good)
    usual = steps[counts == 1]
    if not usual.size or steps.min() <= 0:
        return False
    return bool(2 * steps[right - 1] > (counts[right - 1] + 1) * np.median(usual))
