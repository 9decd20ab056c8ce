"""Savitzky–Golay filter: a polynomial fitted to a moving window, its value and derivatives at the window's centre.

Flacco 2014 §VI uses degree 20 on windows of 1000 samples, where the usual normal equations in powers of the sample
number lose every digit. Here the fit is done once per setting in Legendre polynomials with a QR decomposition, which
is well conditioned there.

Where samples are missing the same polynomial is fitted to those that are there. A sample that one channel lacks is left out of
all channels: their values are the same linear functional of their samples, and an equation between them stays true.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.core.errors import FilterError
from vsalog.core.look import LONGEST_RUN

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]
TILE = 512
"""Outputs that are worked on side by side: a window passes over them while they are in the processor's cache."""


class Lacking(NamedTuple):
    """Which windows are used although they lack samples.

    Attributes
    ----------
    noise_gain : power of white noise over that behind a whole window, at most [1]. Equations weigh rows alike: at twice the
        deviation a row adds to what is known, while one that extrapolates has many times as much
    """

    noise_gain: float = 4.0


LACKING = Lacking()


class Polynomials(NamedTuple):
    """What a filter fits to a window.

    Attributes
    ----------
    values : shape (window, degree + 1), polynomials times `root`, orthonormal
    root : shape (window,), root of each sample's weight in the fit
    """

    values: Array
    root: Array


def savgol_lag(window: int) -> int:
    """Return how many samples after its centre a window of that length ends: the look-ahead of the filter."""
    return window - 1 - window // 2


def samples_of(window: float, period: float, degree: int) -> int:
    """Return the length of a filter's window in samples, odd.

    Parameters
    ----------
    window : [s], an estimator's ``window``
    period : T [s]
    degree : of the polynomial

    Raises
    ------
    FilterError
        The window is too long, or too short for the degree.
    """
    why = f"a window of {window:.3g} s"
    if window > LONGEST_RUN * period:
        raise FilterError(
            f"{why} has more than {LONGEST_RUN} samples at {1.0 / period:.4g} Hz; shorten it with --tune window=SECONDS"
        )
    samples = 2 * round(0.5 * window / period) + 1
    if samples <= degree:
        least = 2 * (degree // 2 + 1) * period
        raise FilterError(
            f"{why} is too short for a polynomial of degree {degree} at {1.0 / period:.4g} Hz; lengthen it with --tune"
            f" window=SECONDS to {least:.3g} s or more"
        )
    return samples


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
    half, x = _places(window)
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


def savgol_polynomials(window: int, degree: int) -> Polynomials:
    """Return the polynomials that `savgol_weights` fits to a window; parameters as there."""
    _, x = _places(window)
    return Polynomials(np.linalg.qr(legendre.legvander(x, degree))[0], np.ones(window))


def _places(window: int) -> tuple[float, Array]:
    """Return half a window, in samples, and the places of its samples, −1 to 1."""
    half = max((window - 1) / 2.0, 1.0)
    return half, np.asarray((np.arange(window) - (window - 1) / 2.0) / half)


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


def filter_together(
    channels: Mapping[str, Array], orders: Mapping[str, int], weights: Array, polynomials: Polynomials
) -> dict[str, Array]:
    """Filter channels of the same rows, by a fit to the samples that are there where some are missing.

    Of the weights that give the same derivatives of all polynomials of the degree from these samples alone, those nearest to the
    whole window's are taken: of the Savitzky–Golay filter they are the least-squares fit's.

    Parameters
    ----------
    channels : shape (n,) each; a row counts as missing where any of them is NaN
    orders : highest derivative wanted of each
    weights : shape (d, window), of value and derivatives
    polynomials : that the weights fit

    Returns
    -------
    shape (order + 1, n − window + 1) each; NaN where noise would have more than `Lacking.noise_gain` times a whole window's power
    """
    out = {name: savgol_filter(x, weights[: orders[name] + 1]) for name, x in channels.items()}
    missing = np.logical_or.reduce([np.isnan(x) for x in channels.values()])
    if not missing.any():
        return out
    window = weights.shape[1]
    before = np.concatenate(([0], np.cumsum(missing)))
    lacking = np.flatnonzero(before[window:] > before[:-window])
    counts = np.array([orders[name] + 1 for name in channels])
    fitted = np.full((len(channels), counts.max(), lacking.size), np.nan)
    rows = np.ascontiguousarray(weights[: counts.max()])
    _fit(np.stack([*channels.values()]), counts, missing, lacking, rows, *polynomials, LACKING.noise_gain, fitted)
    for name, found in zip(channels, fitted, strict=True):
        out[name][:, lacking] = found[: orders[name] + 1]
    return out


@compiled
def _fit(
    x: Array, counts: Integers, missing: Flags, lacking: Integers, weights: Array, q: Array, root: Array, most: float, out: Array
) -> None:  # fmt: skip
    # With q of the samples that are missing: G = I − qᵀq of all that is left, v = w + root q G⁻¹ Σ q w / root.
    count, window = weights.shape
    size = q.shape[1]
    G, c, v = np.empty((size, size)), np.empty(size), np.empty((count, window))
    for place in range(lacking.size):
        first = lacking[place]
        for a in range(size):
            for b in range(a + 1):
                G[a, b] = 1.0 if a == b else 0.0
        for j in range(window):
            if missing[first + j]:
                for a in range(size):
                    for b in range(a + 1):
                        G[a, b] -= q[j, a] * q[j, b]
        determined = True
        for a in range(size):
            for b in range(a + 1):
                for i in range(b):
                    G[a, b] -= G[a, i] * G[b, i]
                if a == b:
                    determined = determined and G[a, a] > 0.0
                    G[a, a] = np.sqrt(G[a, a])
                else:
                    G[a, b] /= G[b, b]
        if not determined:
            continue
        for s in range(count):
            c[:] = 0.0
            whole, gain = 0.0, 0.0
            for j in range(window):
                whole += weights[s, j] * weights[s, j]
                if missing[first + j]:
                    for a in range(size):
                        c[a] += q[j, a] * weights[s, j] / root[j]
            for a in range(size):
                for i in range(a):
                    c[a] -= G[a, i] * c[i]
                c[a] /= G[a, a]
            for a in range(size - 1, -1, -1):
                for i in range(a + 1, size):
                    c[a] -= G[i, a] * c[i]
                c[a] /= G[a, a]
            for j in range(window):
                more = 0.0
                for a in range(size):
                    more += q[j, a] * c[a]
                v[s, j] = 0.0 if missing[first + j] else weights[s, j] + root[j] * more
                gain += v[s, j] * v[s, j]
            determined = determined and gain <= most * whole
        if not determined:
            continue
        for k in range(x.shape[0]):
            for s in range(counts[k]):
                total = 0.0
                for j in range(window):
                    if not missing[first + j]:
                        total += v[s, j] * x[k, first + j]
                out[k, s, place] = total


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
