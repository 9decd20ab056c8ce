"""Outliers that no motion makes: a flipped bit, a packet that was lost and read as zero.

One of them spoils a whole fit, and nothing in the fit shows it. Possible motions are kept: a step, a square wave, a push of four
samples or more, noise of whatever shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.resolution import LONGEST_OUTLIER, step_of
from vsalog.core.significance import FALSE_ALARM_OF_MANY
from vsalog.filters.unwrapping import WRAP_JUMP, WRAPPED_SPAN, wraps_around

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_OUTLIERS = 0.02
"""Largest part of the samples that may be outliers [1]. The others give the usual distance from the running median, which pulses
that come more often, and noise with heavy tails, make large. A log in which one longest outlier is a larger part is too short."""

TAIL_INDEX = 3.0
"""Power with which the tail of a sensor's noise falls off, at least [1]: Student's t of three degrees of freedom, the heaviest
that has a variance."""

LEAST_SHARE = 0.05
"""Least distance of an outlier from the running median, as a share of the signal's usual range [1]; less does not spoil a fit."""


@dataclass(frozen=True, slots=True)
class Usual:
    """The usual distance of a signal from its running median.

    Attributes
    ----------
    least : least distance of an outlier
    low, high : the least and the greatest of the running median
    """

    least: float
    low: float
    high: float


class Outliers:
    """Detects the outliers of a signal.

    Parameters
    ----------
    seen : shape (N,), the signal as recorded, or the part of it that was read, NaN where missing
    turn : after which an encoder may wrap, in the unit of the values; None for what is no angle
    whole : whether that is all of the signal
    """

    def __init__(self, seen: Array, turn: float | None = None, *, whole: bool = True) -> None:
        _, known, steps = _known(seen)
        self._turn, self._usual = turn, None
        if known.size * MOST_OUTLIERS < LONGEST_OUTLIER + 1:
            return
        self._wraps, self._jump = _wraps_in(known, steps, turn), 0.5 * LEAST_SHARE * _usual_range(known)
        # Cheap, and most logs end here: an outlier needs a jump, and no steps half as large.
        if not whole or _greatest(steps, turn, self._wraps) > self._jump:
            self._usual = _usual(known, _middle(known), turn)

    def among(self, values: Array) -> Flags | None:
        """Return the outliers of a part of the signal, shape (n,); None where there is none."""
        if self._usual is None:
            return None
        kept, known, steps = _known(values)
        if known.size <= 2 * LONGEST_OUTLIER or not _greatest(steps, self._turn, self._wraps) > self._jump:
            return None
        left = _left(known, _middle(known), self._turn, self._wraps, self._usual)
        return _everywhere(values, kept, _alone(known, left, self._usual, self._turn if self._wraps else None))


def _known(values: Array) -> tuple[Flags | None, Array, Array]:
    """Return which values are numbers (None: all), these, and the steps between them."""
    steps = np.diff(values)
    if np.isfinite(steps.sum()):
        return None, values, steps
    kept = np.isfinite(values)
    return kept, values[kept], np.diff(values[kept])


def _everywhere(values: Array, kept: Flags | None, alone: Flags) -> Flags | None:
    """Expand flags of the numbers to all values; None where there is no outlier."""
    if not alone.any():
        return None
    if kept is None:
        return alone
    out = np.zeros(values.shape, dtype=np.bool_)
    out[kept] = alone
    return out


def _wraps_in(known: Array, steps: Array, turn: float | None) -> bool:
    return (
        turn is not None
        and _greatest(steps, None, False) > WRAP_JUMP * turn
        and wraps_around(_usual_range(known), turn)
    )


def _greatest(steps: Array, turn: float | None, wraps: bool) -> float:
    """Return the greatest step, the shorter way round where the encoder wraps."""
    greatest = max(float(steps.max()), -float(steps.min()))
    if turn is not None and wraps and greatest > WRAP_JUMP * turn:
        steps = steps - turn * np.round(steps / turn)
        greatest = max(float(steps.max()), -float(steps.min()))
    return greatest


def _middle(known: Array) -> Array:
    """Return the running median."""
    from scipy.ndimage import median_filter

    # A median over this window removes the longest outlier and keeps steps. 'mirror' does not repeat the first sample: repeated,
    # an outlier there would be three samples of seven.
    return np.asarray(median_filter(known, 2 * LONGEST_OUTLIER + 1, mode="mirror"))


def _left(
    known: Array, middle: Array, turn: float | None, wraps: bool | None = None, usual: Usual | None = None
) -> Array:
    """Return how far each sample is from the running median, the shorter way round where the encoder wraps."""
    left = known - middle
    if turn is not None and bool((np.abs(left) > WRAP_JUMP * turn).any()):
        if not (wraps_around(_usual_range(known), turn) if wraps is None else wraps):
            return left
        low, high = (usual.low, usual.high) if usual is not None else (middle.min(), middle.max())
        # A value far outside the turn is no encoder count.
        within = np.maximum(known, high) - np.minimum(known, low) <= WRAPPED_SPAN * turn
        left = np.where(within, left - turn * np.round(left / turn), left)
    return left


def _usual_range(known: Array) -> float:
    low, high = np.quantile(known[:: max(1, known.size // 20_000)], (0.01, 0.99))
    return float(high - low)


def _usual(known: Array, middle: Array, turn: float | None) -> Usual:
    """Return the usual distance for numbers that have this running median.

    Of a tail that falls off as a power, P(|x| > k u) = P(|x| > u) / k^TAIL_INDEX, one sample in a million is beyond `least`.
    """
    left = _left(known, middle, turn)
    size = np.abs(left)
    few = int(MOST_OUTLIERS * known.size)
    usual = float(np.partition(size, known.size - 1 - few)[known.size - 1 - few])
    times = (MOST_OUTLIERS / FALSE_ALARM_OF_MANY) ** (1.0 / TAIL_INDEX)
    least = max(times * usual, LEAST_SHARE * _usual_range(known))
    far = size > least
    # With few samples the sensor's steps matter.
    least = max(least, times * _step(known, far)) if far.any() else least
    return Usual(least, float(middle.min()), float(middle.max()))


def _alone(known: Array, left: Array, usual: Usual, turn: float | None) -> Flags:
    size = np.abs(left)
    far = size > usual.least
    good = np.flatnonzero(~far)
    for first in np.flatnonzero(far & ~np.concatenate(([False], far[:-1]))):
        after = int(np.searchsorted(good, first))
        last = int(good[after]) if after < good.size else known.size
        if last - first > LONGEST_OUTLIER or not _calm(known, good, after, float(size[first:last].max()), turn):
            far[first:last] = False
    return far


def _step(known: Array, far: Flags) -> float:
    """Return the sensor's step, 0 where it has none: relative to a huge outlier all of its levels would be equal."""
    usual = known[~far]
    return step_of(known if usual.min() == usual.max() else usual) or 0.0


def _calm(known: Array, good: NDArray[np.intp], after: int, size: float, turn: float | None) -> bool:
    """Return whether the good samples around `good[after]`, before which there are outliers, continue smoothly.

    A motion by such steps, or twice such, is less far from its running median than those are.
    """
    around = known[good[max(0, after - 2) : after + 2]]
    steps = np.diff(around)
    if turn is not None:
        wraps = np.abs(steps) > WRAP_JUMP * turn
        steps = np.where(wraps, steps - turn * np.round(steps / turn), steps)
    return bool((2 * LONGEST_OUTLIER * np.abs(steps) <= size).all())
