"""What a sensor saw, of what it says: the rig's gain, offset, drift and eccentricity taken out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.resolution import resolution_of
from vsalog.rig.roles import Signal

Array = NDArray[np.float64]

# Rounds of taking an eccentricity out, each of which leaves amplitude / gain of the error, and what may be left [rad].
ROUNDS, LEFT = 500, 1e-14


def seen_by(m: Array, signal: Signal, time: Array | None) -> tuple[Array, float | None]:
    """Return x of what a sensor says, m = gain · x + offset + drift · time + eccentricity, and its least step if it is known.

    Parameters
    ----------
    m : shape (N,), SI
    signal : of the rig
    time : shape (N,), seconds from the log's start; None where the sensor does not drift
    """
    disc, resolution = signal.eccentricity, signal.resolution
    if resolution is None and (time is not None or disc is not None):
        # What is taken out here hides the steps.
        resolution = resolution_of(m)
    if signal.offset:
        m = m - signal.offset
    if time is not None:
        m = m - signal.drift * time
    x = m / signal.gain if signal.gain != 1.0 else m
    if disc is not None:
        for _ in range(ROUNDS):
            last, x = x, (m - disc.amplitude * np.sin(x + disc.phase)) / signal.gain
            if not np.fmax.reduce(np.abs(x - last)) > LEFT * max(1.0, float(np.fmax.reduce(np.abs(x)))):
                break
    return x, None if resolution is None else resolution / signal.gain
