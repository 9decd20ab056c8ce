"""The error of a prediction, with honest intervals: samples of a log are not independent."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import special

from vsalog.core.correlation import CORRELATION_TIMES, effective_samples
from vsalog.core.dependence import INTERVALS, LEAST_BLOCKS, MOST_BLOCKS
from vsalog.core.resolution import ENOUGH, spread_over
from vsalog.core.significance import DRAWS
from vsalog.validation.document import Bin, Figure, Score

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A relative error has a meaning where the torque is not nearly zero.
LEAST_TORQUE = 0.05


def score(prediction: Array, reference: Array, least: float = 0.0, where: Flags | None = None) -> Score | None:
    """Judge a prediction; None where there are fewer samples than a bootstrap needs blocks.

    Parameters
    ----------
    prediction, reference : shape (N,), in the same unit; NaN is left out
    least : relative errors are taken where |reference| is at least this part of its largest
    where : shape (N,), which samples count; all when absent
    """
    use = np.ones(reference.size, np.bool_) if where is None else where
    count, low, high, worst = _seen(prediction, reference, use)
    if count < LEAST_BLOCKS:
        return None
    step = max(1, count // ENOUGH)
    span, independent = high - low, effective_samples(_errors(prediction, reference, use, count, step))
    above = least * max(abs(low), abs(high))
    sums = _sums(prediction, reference, use, _blocks(count, independent), above)
    draws = _draws(sums)
    whole = sums.sum(axis=1)

    def mse(s: Array) -> Array:
        return np.asarray(s[2] / s[0])

    def spread(s: Array) -> Array:
        return np.asarray(s[4] / s[0] - (s[3] / s[0]) ** 2)

    def figure(of: Callable[[Array], Array], positive: bool = True) -> Figure:
        return _figure(float(of(whole)), of(draws), sums.shape[1], positive)

    with np.errstate(divide="ignore", invalid="ignore"):
        return Score(
            samples=count,
            effective_samples=independent,
            span=span,
            mse=figure(mse),
            rmse=figure(lambda s: np.sqrt(mse(s))),
            nrmse=figure(lambda s: 100.0 * np.sqrt(mse(s)) / span),
            msrep=figure(lambda s: 100.0 * s[5] / s[6]),
            r2=figure(lambda s: 1.0 - mse(s) / spread(s), positive=False),
            bias=figure(lambda s: np.asarray(s[1] / s[0]), positive=False),
            largest=worst,
        )


@njit(cache=True)
def _seen(prediction: Array, reference: Array, where: Flags) -> tuple[int, float, float, float]:
    """Return how many samples count and are numbers, the least and the largest reference among them, and the largest error."""
    n, low, high, worst = 0, np.inf, -np.inf, 0.0
    for k in range(reference.size):
        e = prediction[k] - reference[k]
        if where[k] and np.isfinite(e):
            n += 1
            low, high, worst = min(low, reference[k]), max(high, reference[k]), max(worst, abs(e))
    return n, low, high, worst


@njit(cache=True)
def _errors(prediction: Array, reference: Array, where: Flags, count: int, step: int) -> Array:
    """Return the error of every step-th of the samples that count."""
    out = np.empty((count + step - 1) // step)
    n = 0
    for k in range(reference.size):
        e = prediction[k] - reference[k]
        if where[k] and np.isfinite(e):
            if n % step == 0:
                out[n // step] = e
            n += 1
    return out


@njit(cache=True)
def _sums(prediction: Array, reference: Array, where: Flags, edges: NDArray[np.int64], above: float) -> Array:
    """Sum up, block by block: 1, e, e², y, y², (e/y)² where |y| is above a limit, and how often it is; shape (7, blocks)."""
    out = np.zeros((7, edges.size))
    n, block = 0, 0
    for k in range(reference.size):
        y = reference[k]
        e = prediction[k] - y
        if not (where[k] and np.isfinite(e)):
            continue
        if block + 1 < edges.size and n >= edges[block + 1]:
            block += 1
        n += 1
        out[0, block] += 1.0
        out[1, block] += e
        out[2, block] += e**2
        out[3, block] += y
        out[4, block] += y**2
        if abs(y) > above:
            out[5, block] += (e / y) ** 2
            out[6, block] += 1.0
    return out


def _blocks(count: int, independent: float) -> NDArray[np.int64]:
    """Return the starts of blocks that are long against the correlation."""
    wanted = independent / CORRELATION_TIMES
    blocks = int(np.clip(wanted, LEAST_BLOCKS, min(MOST_BLOCKS, count)))
    return np.linspace(0, count, blocks + 1).astype(np.int64)[:-1]


def _draws(sums: Array) -> Array:
    """Draw blocks with replacement and add them up: shape (c, draws)."""
    return np.asarray(sums @ _drawn(sums.shape[1]))


@cache
def _drawn(blocks: int) -> Array:
    """Return how often each block is drawn, shape (blocks, draws)."""
    random = np.random.default_rng(0)
    return random.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=DRAWS).T.astype(np.float64)


def _figure(value: float, draws: Array, blocks: int, positive: bool) -> Figure:
    """Return the 95 % interval from the draws, widened for the small number of blocks as Student's t is."""
    draws = draws[np.isfinite(draws)]
    if not np.isfinite(value):
        return Figure(value=None)
    if draws.size < DRAWS // 2:
        return Figure(value=value)
    wider = float(special.stdtrit(blocks - 1, 0.975) / special.ndtri(0.975) * np.sqrt(blocks / (blocks - 1.0)))
    if positive and value > 0.0 and bool(np.all(draws > 0.0)):
        # Errors are positive and skewed: on a logarithmic scale the interval is nearly symmetric.
        low, high = np.quantile(np.log(draws / value), [0.025, 0.975]) * wider
        return Figure(value=value, low=value * float(np.exp(low)), high=value * float(np.exp(high)))
    low, high = (np.quantile(draws, [0.025, 0.975]) - value) * wider
    return Figure(value=value, low=value + float(low), high=value + float(high))


def bins_of(e: Array, x: Array) -> tuple[Bin, ...]:
    """Return the error over intervals of `x` that hold equally many samples.

    Parameters
    ----------
    e, x : shape (N,), in the order of time
    """
    edges, index = binned(x)
    count = max(len(edges) - 1, 1)
    first = _blocks(e.size, effective_samples(e))
    block = np.searchsorted(first, np.arange(e.size), side="right") - 1
    # Per interval and block: how many samples, and their sums.
    cell, shape = index * first.size + block, (count, first.size)
    n, total, square = (np.bincount(cell, weights, count * first.size).reshape(shape) for weights in (None, e, e**2))
    drawn = _drawn(first.size)
    out = []
    for i in np.flatnonzero(n.sum(axis=1)):
        with np.errstate(divide="ignore", invalid="ignore"):
            samples, mean, power = n[i] @ drawn, total[i] @ drawn, square[i] @ drawn
            rmse, bias = np.sqrt(power / samples), mean / samples
        of = float(n[i].sum())
        out.append(
            Bin(
                low=float(edges[i]),
                high=float(edges[i + 1]),
                samples=int(of),
                rmse=_figure(float(np.sqrt(square[i].sum() / of)), rmse, first.size, positive=True),
                bias=_figure(float(total[i].sum() / of), bias, first.size, positive=False),
            )
        )
    return tuple(out)


def binned(x: Array, count: int = INTERVALS) -> tuple[Array, NDArray[np.int64]]:
    """Return the edges of up to `count` intervals that hold equally many samples, and each sample's interval."""
    few = spread_over(x)
    edges = np.quantile(few, np.linspace(0.0, 1.0, count + 1))
    edges[0], edges[-1] = x.min(), x.max()
    edges = np.unique(edges)
    if edges.size < 2:
        return np.array([x[0], x[0]]), np.zeros(x.size, dtype=np.int64)
    return edges, np.clip(np.searchsorted(edges, x, side="right") - 1, 0, edges.size - 2).astype(np.int64)
