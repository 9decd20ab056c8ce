"""Readings that stood still amid a motion and then jumped to catch up: an encoder that hung, packets that said the same again.

Nothing in a fit tells such a stretch from a spring that gives way. What a motion can do is left alone: it begins and ends over
many samples, a coarse encoder goes on by single steps, a slow sensor held between its samples jumps again and again.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# So many samples repeat the one before, at least; more than so many are no hitch.
FEWEST, MOST = 8, 1000
# So many samples on either side tell whether a reading was held.
MARGIN = 3 * MOST + 2
# The jump is so many times the greatest step around it, over twice the time that the reading was held for on either side; the
# same time before and behind moves it by so much of the jump each, and by so much the more lively one of them.
TIMES, MOVES, LIVELY = 5.0, 0.25, 0.5
# Behind so many periods without a sample a jump is no wonder.
APART = 1.5


def held(stamps: NDArray[np.int64], values: Array, period: int, turn: float | None = None) -> Flags | None:
    """Return where samples repeat one that was held, None where none does.

    Parameters
    ----------
    stamps : shape (N,) [ns]
    values : shape (N,), as recorded, NaN where missing
    period : of the samples [ns]
    turn : after which an encoder may begin anew, in the unit of the values; None for what is no angle

    Returns
    -------
    shape (N,)
    """
    kept = np.isfinite(values)
    known, when = (values, stamps) if kept.all() else (values[kept], stamps[kept])
    found = np.zeros(known.size, dtype=np.bool_)
    if not _mark(when, known, APART * period, turn or 0.0, found):
        return None
    out = np.zeros(values.size, dtype=np.bool_)
    out[kept] = found
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _mark(stamps: NDArray[np.int64], x: Array, apart: float, turn: float, out: Flags) -> int:
    """Mark the samples; returns how many."""
    count, last = 0, 0
    for k in range(1, x.size):
        if x[k] == x[k - 1] or np.isnan(x[k] - x[k - 1]):
            continue
        # From `last` on the reading was the same, up to the sample before this one.
        length = k - 1 - last
        if FEWEST <= length <= MOST and stamps[k] - stamps[k - 1] <= apart and _caught_up(x, last, k, turn):
            out[last + 1 : k] = True
            count += length
        last = k
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def _caught_up(x: Array, first: int, after: int, turn: float) -> bool:
    """Tell whether a reading, held from one sample on, goes on in another one where the motion around it would have led it."""
    length = after - 1 - first
    jump = _step(x, after, turn)
    if first < length or after + length >= x.size:
        return False
    before, behind = 0.0, 0.0
    for i in range(2 * length):
        for k in (first - i, after + 1 + i):
            if not 0 < k < x.size:
                continue
            step = _step(x, k, turn)
            if TIMES * abs(step) > abs(jump):
                return False
            if i < length and k <= first:
                before += step
            elif i < length:
                behind += step
    lively = max(before / jump, behind / jump)
    return min(abs(before), abs(behind)) >= MOVES * abs(jump) and lively >= LIVELY


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _step(x: Array, k: int, turn: float) -> float:
    """Return the step to a sample, the shorter way round where there is a turn."""
    step = float(x[k] - x[k - 1])
    return step - turn * np.round(step / turn) if turn > 0.0 else step
