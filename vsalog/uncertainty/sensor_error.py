"""The error that an encoder adds to a position, behind a filter.

White noise is described by its size. Quantisation is not white: where a motion passes few steps in a filter's window, the error
changes as slowly as the motion, passes the filter, and is largest in the rates where the position jumps. So the steps are
tested on the log's own motion, which is smoothed, given the noise that goes with the steps, and rounded to them once more,
between the levels. Noise as large as a step leaves the error white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import PART
from vsalog.core.precision import ROUNDING
from vsalog.core.resolution import noise_of, step_of
from vsalog.filters.savitzky_golay import savgol_filter, savgol_weights

Array = NDArray[np.float64]

# So many samples of a log determine its sensors' errors.
ENOUGH = PART
# So much of a step the motion is shifted by before it is rounded again.
ROUNDING_SHIFTS = (0.25, 0.75)
# Length of the filter for the motion, as a multiple of the other's, and its degree: one as long still has the steps in it.
MOTION_WINDOWS, MOTION_DEGREE = 4, 5
# The error of a sensor without noise and steps: this part of its largest value.
LEAST_NOISE = ROUNDING


@dataclass(frozen=True, slots=True)
class SensorError:
    """The error that a sensor adds to a signal.

    Attributes
    ----------
    white : standard deviation of white noise; 0 where steps are part of the error
    rounding : samples of the rounding error, and the noise before it, one series per shift; none where all of it is white
    before : standard deviation of that noise
    """

    white: float
    rounding: tuple[Array, ...] = ()
    before: float = 0.0

    def product(self, a: Array, b: Array) -> float:
        """Return the mean product of the errors behind two filters; weights of one length, as `savgol_filter` takes them."""
        return float(self.products(np.stack((a, b)))[0, 1])

    def products(self, weights: Array) -> Array:
        """Return the mean products of the errors behind filters, shape (m, m), of weights of shape (m, window)."""
        if not self.rounding:
            return np.asarray(self.white**2 * (weights @ weights.T))
        behind = [savgol_filter(series, weights) for series in self.rounding]
        return np.asarray(np.mean([own @ own.T / max(own.shape[1], 1) for own in behind], axis=0))

    def rms(self, weights: Array) -> float:
        """Return the RMS error behind a filter."""
        return float(np.sqrt(self.product(weights, weights)))

    def whole(self, count: int) -> list[Array]:
        """Return the rounding error of each of the signal's `count` samples: mirrored at its ends, where it is not known."""
        before = [(count - series.size) // 2 for series in self.rounding]
        return [
            np.pad(series, (n, count - series.size - n), mode="reflect") if series.size > 1 else np.zeros(count)
            for n, series in zip(before, self.rounding, strict=True)
        ]


def sensor_error(values: Array, window: int) -> SensorError:
    """Estimate the error that a sensor adds to a signal.

    Parameters
    ----------
    values : shape (N,), NaN where there is none
    window : samples in the window of the filters that come after
    """
    finite = np.isfinite(values)
    if not finite.any():
        return SensorError(0.0)
    step = step_of(values)
    noise = noise_of(values, step or 0.0) or 0.0
    if step is None or noise > step:
        return SensorError(max(noise, LEAST_NOISE * float(np.abs(values[finite]).max()), LEAST_NOISE))
    whole = without_missing(values)
    longer = min(MOTION_WINDOWS * (window - 1) + 1, whole.size)
    motion = _smoothed(whole, savgol_weights(longer, min(MOTION_DEGREE, longer - 1))[0])
    shifted = [motion / step + shift for shift in ROUNDING_SHIFTS]
    # Rounding alone looks like noise, too; the excess is there before it.
    alone = noise_of(np.round(shifted[0]), 1.0) or 0.0
    before = max((noise / step) ** 2 - alone**2, 0.0) ** 0.5
    noises = before * np.random.default_rng(0).standard_normal(motion.size)
    series = []
    for moved in shifted:
        added = step * (np.round(moved + noises) - moved)
        series.append(added - added.mean() if added.size else added)
    return SensorError(0.0, tuple(series), step * before)


def without_missing(values: Array) -> Array:
    """Return values with the missing ones on the lines between their neighbours, for what needs a course; all missing stay so."""
    finite = np.isfinite(values)
    if finite.all() or not finite.any():
        return values
    return np.asarray(np.interp(np.arange(values.size), np.flatnonzero(finite), values[finite]))


def _smoothed(x: Array, weights: Array) -> Array:
    """Return what `savgol_filter` does, but for rounding, in a time that hardly depends on the window."""
    size = 1 << (x.size + weights.size - 2).bit_length()
    spectrum = np.fft.rfft(x, size) * np.fft.rfft(weights[::-1], size)
    return np.fft.irfft(spectrum, size)[weights.size - 1 : x.size]
