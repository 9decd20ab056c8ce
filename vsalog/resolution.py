"""The least step of a sensor, told from what it recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Stretches of a long signal that its resolution is told from, and their length.
STRETCHES, STRETCH = 8, 32_768


def resolution_of(values: Array) -> float:
    """Least step of a quantised signal, 0 for one that never moves.

    A signal without steps has noise instead: it is given the step whose rounding error would be as large. Of a long signal
    some stretches tell as much as the whole.
    """
    if values.size > STRETCHES * STRETCH:
        starts = np.linspace(0, values.size - STRETCH, STRETCHES, dtype=np.int64)
        found = _least_step(np.concatenate([values[k : k + STRETCH] for k in starts]))
        if found > 0.0:
            return found
    return _least_step(values)


def _least_step(values: Array) -> float:
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    span = float(levels[-1] - levels[0]) if levels.size else 0.0
    if span == 0.0:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * span]  # levels closer than float rounding are one level
    least = float(steps.min())
    multiples = steps[steps < 100.0 * least] / least
    if np.mean(np.abs(multiples - np.round(multiples)) < 0.02) > 0.95 and least > 1e-7 * span:
        return least
    # Third differences leave little of a smooth motion; of white noise their variance is 20 times its own.
    third = np.abs(np.diff(finite, 3))
    deviation = 1.4826 * float(np.median(third)) / 20.0**0.5 if third.size else 0.0
    return float(max(deviation * 12.0**0.5, 1e-12 * span))
