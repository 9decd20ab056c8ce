"""Numbers about a recording's clocks and channels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

# A longer step than this many median steps is a gap: as binding sees it.
GAP = 2.5
# Samples that noise and resolution are told from: a stretch this long says what the whole does.
MAX_SAMPLES = 200_000
# A channel has a step where this share of the differences between its levels are multiples of the smallest.
MULTIPLES = 0.95


@dataclass(frozen=True, slots=True)
class Clock:
    """How regularly a stream was sampled.

    Attributes
    ----------
    rate : [Hz], one over the median step; NaN below two samples
    jitter : half the 5–95 % range of the steps [s]
    gaps : steps longer than `GAP` medians
    longest_gap : [s], 0 where there is none
    duration : [s], last stamp minus first
    """

    rate: float
    jitter: float
    gaps: int
    longest_gap: float
    duration: float


def clock_of(stamps: Stamps) -> Clock:
    """Return how regularly the stamps follow each other."""
    if stamps.size < 2:
        return Clock(float("nan"), float("nan"), 0, 0.0, 0.0)
    steps = np.diff(stamps)
    median = float(np.median(steps))
    low, high = np.percentile(steps, (5.0, 95.0))
    is_gap = steps > GAP * median
    longest = float(steps.max()) if is_gap.any() else 0.0
    duration = float(stamps[-1] - stamps[0]) * 1e-9
    rate = 1e9 / median if median > 0.0 else float("nan")
    return Clock(rate, 0.5e-9 * float(high - low), int(np.count_nonzero(is_gap)), longest * 1e-9, duration)


def resolution_of(values: Array) -> float | None:
    """Return the least significant step of a quantised channel; None where it has none, or never changes."""
    finite = values[:MAX_SAMPLES]
    levels = np.unique(finite[np.isfinite(finite)])
    if levels.size < 3:
        return float(levels[1] - levels[0]) if levels.size == 2 else None
    steps = np.diff(levels)
    # Levels closer than the rounding of 32-bit floats are one level.
    steps = steps[steps > 4e-7 * max(abs(float(levels[0])), abs(float(levels[-1])))]
    if steps.size == 0:
        return None
    least = float(steps.min())
    multiples = steps / least
    near = multiples < 1000.0
    fitting = np.abs(multiples[near] - np.round(multiples[near])) < 0.05
    # A few levels are always multiples of the smallest step; noise needs many samples to show that it has none.
    repeats = levels.size < 0.8 * finite.size
    return least if repeats and float(np.mean(fitting)) >= MULTIPLES else None


def noise_of(values: Array) -> float | None:
    """Return the standard deviation of a channel's white noise; None where too little can be told.

    Second differences leave little of a smooth motion, and their spread is √6 times that of white noise. Their median
    is not moved by the few samples where something happens.
    """
    second = np.diff(values[:MAX_SAMPLES], 2)
    second = second[np.isfinite(second)]
    if second.size < 20:
        return None
    deviation = 1.4826 * float(np.median(np.abs(second - np.median(second)))) / 6.0**0.5
    # What is left of a noiseless signal is the rounding of its numbers.
    finite = np.abs(values[:MAX_SAMPLES])
    return deviation if deviation > 1e-13 * float(np.nanmax(finite)) else None
