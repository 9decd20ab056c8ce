"""Numbers about a recording's clocks and channels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import LONGEST_GAP

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Clock:
    """How regularly a stream was sampled.

    Attributes
    ----------
    rate : [Hz], one over the median step; NaN below two samples
    jitter : half the 5–95 % range of the steps [s]
    gaps : steps longer than `LONGEST_GAP` medians
    longest_gap : [s], 0 where there is none
    duration : [s], last stamp minus first
    """

    rate: float
    jitter: float
    gaps: int
    longest_gap: float
    duration: float


def clock_of(stamps: Stamps, seams: int = 0) -> Clock:
    """Return how regularly the stamps follow each other.

    Parameters
    ----------
    stamps : int64 array, shape (n,), increasing [ns]
    seams : so many of the steps, the longest, are where stretches of a sample meet, and are left out
    """
    if stamps.size < 2:
        return Clock(float("nan"), float("nan"), 0, 0.0, 0.0)
    steps = np.diff(stamps)
    if seams:
        steps = np.sort(steps)[: max(steps.size - seams, 1)]
    median = float(np.median(steps))
    low, high = np.percentile(steps, (5.0, 95.0))
    is_gap = steps > LONGEST_GAP * median
    longest = float(steps.max()) if is_gap.any() else 0.0
    duration = float(stamps[-1] - stamps[0]) * 1e-9
    rate = 1e9 / median if median > 0.0 else float("nan")
    return Clock(rate, 0.5e-9 * float(high - low), int(np.count_nonzero(is_gap)), longest * 1e-9, duration)
