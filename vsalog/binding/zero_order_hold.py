"""Readings that were held during a motion and then jumped to catch up: a stuck encoder, packets that repeat a value.

A fit cannot distinguish such a stretch from a spring that deflects. Possible motions are kept: they begin and end over many
samples, a coarse encoder moves by single steps, a slow sensor held between its samples jumps repeatedly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import lacks_samples
from vsalog.core.significance import REPEATS

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LONGEST_HOLD = 1000
"""Samples that repeat the one before, at most [1]; more are a rest."""

JUMP_RATIO = 4.0
"""The jump behind a hold over the greatest step around it, at least, and over the way in the same time before and behind it, at
most [1]: a continued motion makes both, over twice the time of the hold on either side."""


def held(stamps: NDArray[np.int64], values: Array, period: int, turn: float | None = None) -> Flags | None:
    """Return where samples repeat one that was held, None where none does.

    Parameters
    ----------
    stamps : shape (N,) [ns]
    values : shape (N,), as recorded, NaN where missing
    period : of the samples [ns]
    turn : after which an encoder may wrap, in the unit of the values; None for other signals

    Returns
    -------
    shape (N,)
    """
    kept = np.isfinite(values)
    known, when = (values, stamps) if kept.all() else (values[kept], stamps[kept])
    # A coarse encoder repeats a few. A reading is constant from one change up to the sample before the next.
    after = np.flatnonzero(known[1:] != known[:-1]) + 1
    first = np.append(0, after)[:-1]
    length = after - 1 - first
    likely = (length >= REPEATS) & (length <= LONGEST_HOLD) & (first >= length) & (after + length < known.size)
    first, after = first[likely], after[likely]
    jumps, ahead, behind = (_steps(known, at, turn) for at in (after, first, after + 1))
    likely = JUMP_RATIO * np.fmax(np.abs(ahead), np.abs(behind)) <= np.abs(jumps)
    # After lost samples a jump is normal.
    likely &= ~lacks_samples(when[after] - when[after - 1], period)
    pairs = zip(first[likely].tolist(), after[likely].tolist(), strict=True)
    if not (found := [pair for pair in pairs if _caught_up(known, *pair, turn)]):
        return None
    places, out = np.flatnonzero(kept), np.zeros(values.size, dtype=np.bool_)
    for begin, end in found:
        out[places[begin + 1 : end]] = True
    return out


def _caught_up(x: Array, first: int, after: int, turn: float | None) -> bool:
    """Return whether a reading, held from one sample on, continues at another one as the motion around it predicts."""
    length = after - 1 - first
    jump = float(_steps(x, np.array(after), turn))
    # Nearest first, as far as there are samples.
    before = _steps(x, np.arange(first, max(first - 2 * length, 0), -1), turn)
    behind = _steps(x, np.arange(after + 1, min(after + 1 + 2 * length, x.size)), turn)
    if JUMP_RATIO * max(np.abs(before).max(initial=0.0), np.abs(behind).max(initial=0.0)) > abs(jump):
        return False
    moved = float(before[:length].sum()), float(behind[:length].sum())
    # At least half as fast on one side, in the same direction; on the other the motion may turn.
    return JUMP_RATIO * min(map(abs, moved)) >= abs(jump) and 2.0 * max(way / jump for way in moved) >= 1.0


def _steps(x: Array, k: NDArray[np.int64], turn: float | None) -> Array:
    """Return the steps to some samples, 0 to those outside, the shorter way round where there is a turn."""
    inside = (k > 0) & (k < x.size)
    k = np.where(inside, k, 1)
    step = np.where(inside, x[k] - x[k - 1], 0.0)
    return np.asarray(step - turn * np.round(step / turn) if turn else step)
