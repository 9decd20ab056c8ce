"""The least step of a sensor and its noise, from its recording."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.significance import REPEATS, SIGNIFICANCE

Array = NDArray[np.float64]
Number = TypeVar("Number", np.float64, np.int64)

# Rounding moves what a sensor reads by this part of its step, root mean square.
ROUNDED = 12.0**-0.5
LONGEST_OUTLIER = 3
"""Samples in a row that may be wrong among good ones [1]: two packets, and the one between them; more are real."""

ENOUGH = 2**18
"""Samples that suffice for a distribution: its quantiles are those of the whole to 0.1 %."""
STRETCHES = 8
"""Number of stretches for these samples where neighbouring ones are needed: noise may differ over a log."""


def resolution_of(values: Array) -> float:
    """Return the least step of a signal, 0 for one that never moves.

    A signal without steps has noise instead: it gets the step whose rounding error would be as large.
    """
    finite = values[np.isfinite(values)]
    span = float(np.ptp(finite)) if finite.size else 0.0
    if span == 0.0:
        return 0.0
    return step_of(values) or max((noise_of(values) or 0.0) / ROUNDED, 1e-12 * span)


def coarser(stated: float, values: Array) -> float:
    """Return the rig's step, or that of the values where they are rounded more coarsely than that.

    A few levels show nothing: held values are steps, too.
    """
    finite = values[np.isfinite(values)]
    shown = step_of(finite) or 0.0
    return shown if shown > stated and float(np.ptp(finite)) >= REPEATS * shown else stated


def step_of(values: Array) -> float | None:
    """Return the least significant step of a quantised signal; None where it has none, or never changes."""
    sample = _sample(values)
    levels = np.unique(sample)
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
    repeats = levels.size < 0.8 * sample.size
    return least if repeats and float(np.mean(fitting)) >= 1.0 - SIGNIFICANCE else None


def sensor_noise(values: Array, step: float, least: float) -> float:
    """Return a sensor's error, one standard deviation, above 0: white noise, or quantisation where this is larger.

    Parameters
    ----------
    values : shape (N,), NaN is left out
    step : of the sensor, 0 where it has none
    least : part of the largest value that is the error of a sensor without either
    """
    finite = values[np.isfinite(values)]
    return float(max(noise_of(finite) or 0.0, step * ROUNDED, least * float(np.abs(finite).max(initial=0.0)) or least))


def noise_of(values: Array, step: float = 0.0, time: Array | None = None) -> float | None:
    """Return the standard deviation of a signal's white noise; None where too little is known.

    Third differences of a smooth motion are small, and their standard deviation is √20 times that of white noise. A few samples
    with events do not change their median.

    Parameters
    ----------
    values : NaN is left out
    step : of the sensor where noise between multiples of it is wanted: noise of which rounding is a part
    time : of each sample, increasing [any unit], if not evenly spaced
    """
    sample = _sample(values)
    third = np.diff(sample, 3) if time is None else _divided(sample, _sample(np.where(np.isnan(values), np.nan, time)))
    if third.size < 20:
        return None
    deviation = 1.4826 * _median(np.abs(third - np.median(third)), step) / 20.0**0.5
    # The residual of a noiseless signal is the rounding of its numbers.
    return deviation if deviation > 1e-13 * float(np.max(np.abs(sample))) else None


def _divided(values: Array, time: Array) -> Array:
    """Return third divided differences, with weights whose squares add up to the 20 of even third differences."""
    t = np.lib.stride_tricks.sliding_window_view(time, 4)
    apart = t[:, :, None] - t[:, None, :] + np.eye(4)
    weights = 1.0 / np.prod(apart, axis=2)
    weights *= 20.0**0.5 / np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray(np.sum(weights * np.lib.stride_tricks.sliding_window_view(values, 4), axis=1))


def _median(sizes: Array, step: float) -> float:
    """Return the median; of multiples of a step as if each were spread evenly over the values that round to it."""
    middle = float(np.median(sizes))
    if step == 0.0:
        return middle
    counts = np.round(sizes / step)
    cell = np.round(middle / step)
    low, high = max(cell - 0.5, 0.0), cell + 0.5
    share, below = float(np.mean(counts == cell)), float(np.mean(counts < cell))
    return step * (low + (high - low) * float(np.clip((0.5 - below) / share, 0.0, 1.0))) if share else middle


def _sample(values: Array) -> Array:
    """Return the finite values, or stretches of them where there are many."""
    if values.size > ENOUGH:
        length = ENOUGH // STRETCHES
        starts = np.linspace(0, values.size - length, STRETCHES, dtype=np.int64)
        values = np.concatenate([values[k : k + length] for k in starts])
    return values[np.isfinite(values)]


def spread_over(values: NDArray[Number], most: int = ENOUGH) -> NDArray[Number]:
    """Return every n-th value: about `most` of them, spread over the whole."""
    return values[:: max(1, values.size // most)]
