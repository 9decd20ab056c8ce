"""The true value from a sensor's reading: the rig's gain, offset, drift and reading errors removed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING
from vsalog.core.resolution import resolution_of
from vsalog.effects.calibration import zeroed
from vsalog.effects.reading_error import measured
from vsalog.rig.roles import Signal

Array = NDArray[np.float64]


def seen_by(m: Array, signal: Signal, time: Array | None) -> tuple[Array, float | None]:
    """Return x from a sensor's reading m = gain · x + offset + drift · time + errors(x), and its least step if it is known.

    Parameters
    ----------
    m : shape (N,), SI
    signal : of the rig
    time : shape (N,), seconds from the log's start; None where the sensor does not drift
    """
    errors, resolution = signal.errors, signal.resolution
    if resolution is None and (time is not None or errors):
        # The correction hides the steps.
        resolution = resolution_of(m)
    m = zeroed(m, time, signal.offset, signal.drift)
    if errors:
        m = measured(errors, m, signal.gain, np.finfo(np.float64).nmant, ROUNDING)  # halving alone is done by then
    elif signal.gain != 1.0:
        m = m / signal.gain
    return m, None if resolution is None else resolution / signal.gain
