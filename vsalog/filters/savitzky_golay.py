"""Savitzky–Golay filter: a polynomial fitted to a moving window, its value and derivatives at the window's centre.

Flacco 2014 §VI uses degree 20 on windows of 1000 samples, where the usual normal equations in powers of the sample
number lose every digit. Here the fit is done once per setting in Legendre polynomials with a QR decomposition, which
is well conditioned there.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.core.errors import FilterError

Array = NDArray[np.float64]
TILE = 512
"""Outputs that are worked on side by side: a window passes over them while they are in the processor's cache."""


def savgol_lag(window: int) -> int:
    """Return how many samples after its centre a window of that length ends: the look-ahead of the filter."""
    return window - 1 - window // 2


def savgol_weights(window: int, degree: int, derivatives: int = 0, period: float = 1.0) -> Array:
    """Weights that turn a window of samples into the fitted polynomial's value and derivatives at sample window // 2.

    Parameters
    ----------
    window : number of samples, odd or even
    degree : of the polynomial, less than `window`
    derivatives : highest derivative wanted
    period : sample time T [s]

    Returns
    -------
    shape (derivatives + 1, window); row s gives the s-th derivative [unit/s^s]

    Raises
    ------
    FilterError
        The degree does not fit the window, or the period is not positive.
    """
    if window < 1 or degree < 0 or degree >= window:
        raise FilterError(
            f"Savitzky–Golay: a polynomial of degree {degree} needs a window of at least {degree + 1} samples,"
            f" not {window}"
        )
    if not period > 0.0:
        raise FilterError(f"Savitzky–Golay: the period must be positive, not {period}")
    half = max((window - 1) / 2.0, 1.0)
    x = (np.arange(window) - (window - 1) / 2.0) / half
    q, r = np.linalg.qr(legendre.legvander(x, degree))
    centre = x[window // 2]
    weights = np.zeros((derivatives + 1, window))
    identity = np.eye(degree + 1)
    for s in range(min(derivatives, degree) + 1):
        at_centre = (
            legendre.legval(centre, legendre.legder(identity, s, axis=0)) if s else legendre.legval(centre, identity)
        )
        weights[s] = q @ np.linalg.solve(r.T, at_centre) / (half * period) ** s
    return weights


def savgol_cutoff(window: int, degree: int) -> float:
    """Return the frequency at which the filter has lost 3 dB [rad per sample]; arguments as for `savgol_weights`."""
    value = savgol_weights(window, degree)[0]
    lags = np.arange(window) - savgol_lag(window)
    # A polynomial of degree n turns n times in a window: half a turn more is certainly lost.
    omegas = np.linspace(0.0, min(np.pi * (degree + 3) / window, np.pi), 200)
    passed = np.abs(np.exp(1j * np.outer(omegas, lags)) @ value) - np.sqrt(0.5)
    after = int(np.argmax(passed < 0.0))
    if after == 0:
        return float(omegas[-1])
    part = passed[after - 1] / (passed[after - 1] - passed[after])
    return float(omegas[after - 1] + part * (omegas[after] - omegas[after - 1]))


def savgol_filter(x: Array, weights: Array) -> Array:
    """Apply Savitzky–Golay weights to every whole window in `x`.

    Parameters
    ----------
    x : shape (n,), samples; a block preceded by the window − 1 samples before it
    weights : shape (d, window), of `savgol_weights`

    Returns
    -------
    shape (d, n − window + 1), or (d, 0) where `x` is shorter than the window; NaN where the window holds a NaN
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    count = max(x.shape[0] - weights.shape[1] + 1, 0)
    out = np.empty((weights.shape[0], count))
    _run(x, np.ascontiguousarray(weights), out)
    return out


@compiled
def _run(x: Array, weights: Array, out: Array) -> None:
    # Neighbouring outputs side by side, as many as stay in the processor's fastest memory, so that the compiler can work on
    # several at once. Each sums up in the same order: the same bits however the samples are cut into blocks.
    window = weights.shape[1]
    whole = window - window % 4
    for s in range(out.shape[0]):
        for begin in range(0, out.shape[1], TILE):
            sums = out[s, begin : begin + TILE]
            for i in range(sums.size):
                sums[i] = 0.0
            for j in range(0, whole, 4):
                a, b, c, d = weights[s, j], weights[s, j + 1], weights[s, j + 2], weights[s, j + 3]
                at = x[begin + j : begin + j + sums.size + 3]
                for i in range(sums.size):
                    sums[i] += (a * at[i] + b * at[i + 1]) + (c * at[i + 2] + d * at[i + 3])
            for j in range(whole, window):
                a, at = weights[s, j], x[begin + j : begin + j + sums.size]
                for i in range(sums.size):
                    sums[i] += a * at[i]
