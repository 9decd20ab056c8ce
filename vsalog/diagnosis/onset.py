"""Since which of several logs a number differs from the rig's, and how fast it grows from there on.

Up to some log it is the rig's; from there on it is anything in each log, or on a line over time. All these models are compared by
their marginal likelihoods, which are Gaussian; which log it is, and the rate, are averages over them (Raftery, Madigan, Hoeting
1997, Journal of the American Statistical Association 92(437)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import chdtrc, softmax
from scipy.stats import t as student

from vsalog.core.significance import INTERVAL, SIGNIFICANCE

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Onset:
    """Since when a number differs, and how fast it grows.

    Attributes
    ----------
    since : index of the log from which on it differs, by as much probability before as after; n where it does not
    earliest, latest : of the logs that are that one with 95 % probability
    rate : per unit of time, with its 95 % interval; none where there are no times, or it differs in one log at most
    """

    since: int
    earliest: int
    latest: int
    rate: tuple[float, float, float] | None


def onset_of(away: Array, covariance: Array, deviation: float, times: Array | None) -> Onset:
    """Estimate since when a number differs from the rig's.

    Parameters
    ----------
    away : shape (n,), from the rig's value, in the logs' order
    covariance : shape (n, n), of these
    deviation : how far the number may be from the rig's before a log is seen
    times : shape (n,), of the logs; none where they are not known: then nothing is on a line
    """
    n, wide = away.size, max(deviation, float(np.max(np.abs(away))), float(np.finfo(np.float64).tiny))
    evidence = np.full((2, n + 1), -np.inf)
    rates = np.full((n + 1, 2), np.nan)
    for k in range(n + 1):
        any_value = np.eye(n)[:, k:]
        evidence[0, k] = _evidence(away, covariance, any_value * wide)
        if times is None:
            continue
        line = _line(times, k)
        evidence[1, k] = _evidence(away, covariance, line * wide)
        if line.shape[1] == 2:
            rates[k] = _rate(away, covariance, line, any_value, float(np.ptp(times[k:])))
    weight = softmax(evidence).sum(axis=0)
    tails = 0.5 * SIGNIFICANCE, 0.5, 1.0 - 0.5 * SIGNIFICANCE
    earliest, since, latest = np.searchsorted(np.cumsum(weight), tails).clip(max=n).tolist()
    known = np.isfinite(rates[:, 0])
    rate, share = None, float(weight[known].sum())
    if share > 0.5:
        own, (mean, spread) = weight[known] / share, rates[known].T
        middle = float(own @ mean)
        half = INTERVAL * float(np.sqrt(own @ (spread**2 + (mean - middle) ** 2)))
        rate = middle, middle - half, middle + half
    return Onset(since, earliest, latest, rate)


def _line(times: Array, first: int) -> Array:
    """Return the columns of a line that begins with a log: its height there, and how far it rises to the last one."""
    n, there = times.size, np.arange(times.size) >= first
    span = float(np.ptp(times[first:])) if first < n else 0.0
    columns = [there.astype(np.float64)] if first < n else []
    if span > 0.0:
        columns.append(np.where(there, (times - times[first]) / span, 0.0))
    return np.stack(columns, axis=1) if columns else np.zeros((n, 0))


def _evidence(away: Array, covariance: Array, columns: Array) -> float:
    """Return log N(away; 0, C + X Xᵀ), but for what all models have in common."""
    L = cho_factor(covariance + columns @ columns.T, lower=True)
    return -0.5 * float(away @ cho_solve(L, away)) - float(np.sum(np.log(np.diag(L[0]))))


def _rate(away: Array, covariance: Array, line: Array, any_value: Array, span: float) -> tuple[float, float]:
    """Return the slope of the line, and its standard deviation.

    Where values scatter about the line more than they are uncertain, by a test at 5 %, their scatter counts.
    """
    values, information, misfit = _fitted(away, covariance, line)
    degrees = any_value.shape[1] - 2
    spread = float(np.sqrt(np.linalg.inv(information)[1, 1]))
    more = misfit - _fitted(away, covariance, any_value)[2]
    if degrees and chdtrc(degrees, more) < SIGNIFICANCE:
        spread *= float(np.sqrt(more / degrees)) * float(student.isf(0.5 * SIGNIFICANCE, degrees)) / INTERVAL
    return float(values[1]) / span, spread / span


def _fitted(away: Array, covariance: Array, columns: Array) -> tuple[Array, Array, float]:
    """Return the generalised least-squares fit of columns, its information, and χ² of the residual."""
    L = cho_factor(covariance, lower=True)
    weighed = cho_solve(L, columns)
    information = columns.T @ weighed
    values = np.linalg.solve(information, weighed.T @ away)
    left = away - columns @ values
    return np.asarray(values), np.asarray(information), float(left @ cho_solve(L, left))
