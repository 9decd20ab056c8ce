"""Samples that stand alone, as no motion makes them: a bit that flipped, a packet that was lost and read as zero.

One of them spoils a whole fit, and nothing in the fit shows it. What could have happened is left alone: a step, a square wave,
a push of four samples or more, noise of whatever shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from vsalog.resolution import step_of

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Roles that no command makes jump; a push or a blow seen by an accelerometer may be as short as it likes.
ROLES = ("motor_position", "link_position", "deflection", "torque_sensor", "pressure")
# So many samples in a row may stand alone: a running median of this width passes over them, and keeps steps as they are.
LONGEST, WIDTH = 3, 7
# How far they are from that median: in robust standard deviations of what it leaves, in steps of the sensor, in parts of the
# range that the signal is usually in.
DEVIATIONS, STEPS, SHARE = 100.0, 20.0, 0.05
# And as a multiple of what all but this part of the samples (or these few, where that is less) keep to: a signal of short
# pulses, or noise with heavy tails, is far from its median often.
FEW, FEWEST, BEYOND = 0.02, 4, 20.0
# The samples on either side go on where they were, but for this part of how far the ones between are away.
CALM = 0.2
# A shorter log does not show what is usual.
SHORTEST = 100
# What is usual in a long log, some stretches of it show as well: their number and length.
STRETCHES, STRETCH = 8, 4_096
# A turn that is counted anew is a jump of more than this part of it.
WRAPS, WITHIN = 0.9, 1.01


def stand_alone(values: Array, turn: float | None = None) -> Flags | None:
    """Return where samples stand alone, None where none does.

    Parameters
    ----------
    values : shape (N,), as recorded, NaN where missing
    turn : after which an encoder may begin anew, in the unit of the values; None for what is no angle

    Returns
    -------
    shape (N,)
    """
    known = values
    steps = np.diff(known)
    if not np.isfinite(steps.sum()):
        kept = np.isfinite(values)
        known = values[kept]
        steps = np.diff(known)
    if known.size < SHORTEST:
        return None
    greatest = max(float(steps.max()), -float(steps.min()))
    if turn is not None and greatest > WRAPS * turn:
        steps -= turn * np.round(steps / turn) if _begins_anew(known, turn) else 0.0
        greatest = max(float(steps.max()), -float(steps.min()))
    # Cheap, and most logs end here: whoever stands alone was jumped to.
    if not greatest > (1.0 - CALM) * max(SHARE * _usual_range(known), 0.5 * DEVIATIONS * _usual_deviation(known, turn)):
        return None
    alone = _alone(known, turn)
    if not alone.any():
        return None
    if known is values:
        return alone
    out = np.zeros(values.shape, dtype=np.bool_)
    out[kept] = alone
    return out


def _begins_anew(known: Array, turn: float) -> bool:
    """Tell whether an encoder counts anew after a turn: it stays within one, but for the few samples that may be wrong."""
    return _usual_range(known) <= WITHIN * turn


def _left(known: Array, turn: float | None) -> Array:
    """Return how far each sample is from the running median, the shorter way round where the encoder counts anew."""
    # The mirror does not repeat the first sample: alone, it would be three of seven.
    middle = np.asarray(median_filter(known, WIDTH, mode="mirror"))
    left = known - middle
    if turn is not None and bool((np.abs(left) > WRAPS * turn).any()) and _begins_anew(known, turn):
        # What is out of the turn altogether was counted by nobody.
        within = np.maximum(known, middle.max()) - np.minimum(known, middle.min()) <= WITHIN * turn
        left = np.where(within, left - turn * np.round(left / turn), left)
    return left


def _usual_range(known: Array) -> float:
    low, high = np.quantile(known[:: max(1, known.size // 20_000)], (0.01, 0.99))
    return float(high - low)


def _usual_deviation(known: Array, turn: float | None) -> float:
    if known.size <= STRETCHES * STRETCH:
        return _deviation(_left(known, turn))
    starts = np.linspace(0, known.size - STRETCH, STRETCHES).astype(int)
    return float(np.median([_deviation(_left(known[i : i + STRETCH], turn)) for i in starts]))


def _deviation(left: Array) -> float:
    return 1.4826 * float(np.median(np.abs(left)))


def _alone(known: Array, turn: float | None) -> Flags:
    left = _left(known, turn)
    size = np.abs(left)
    few = min(known.size - 1, max(FEWEST, int(FEW * known.size)))
    usual = float(np.partition(size, known.size - 1 - few)[known.size - 1 - few])
    least = max(
        DEVIATIONS * _deviation(left),
        BEYOND * usual,
        SHARE * _usual_range(known),
    )
    far = size > least
    if not far.any():
        return far
    far &= size > STEPS * _step(known, far)
    good = np.flatnonzero(~far)
    for first in np.flatnonzero(far & ~np.concatenate(([False], far[:-1]))):
        after = int(np.searchsorted(good, first))
        last = int(good[after]) if after < good.size else known.size
        if last - first > LONGEST or not _calm(known, good, after, float(size[first:last].max()), turn):
            far[first:last] = False
    return far


def _step(known: Array, far: Flags) -> float:
    """Return the sensor's step, 0 where it has none: beside a number as large as a wild one all of its levels would be one."""
    usual = known[~far]
    return step_of(known if usual.min() == usual.max() else usual) or 0.0


def _calm(known: Array, good: NDArray[np.intp], after: int, size: float, turn: float | None) -> bool:
    """Tell whether the good samples around `good[after]`, before which others stand alone, go on as if nothing were between."""
    around = known[good[max(0, after - 2) : after + 2]]
    steps = np.diff(around)
    if turn is not None:
        anew = np.abs(steps) > WRAPS * turn
        steps = np.where(anew, steps - turn * np.round(steps / turn), steps)
    return bool((np.abs(steps) <= CALM * size).all())
