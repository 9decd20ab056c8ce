"""Coloured noise as an autoregression: fitted to residuals, and removed from rows so that the remaining noise is white.

Generalised least squares with an estimated covariance (Prais and Winsten, 1954): the predictors of every order come from
Levinson's recursion on the residuals' autocovariance, so that the first rows after a gap are predicted by fewer, and all rows
have noise of the variance one. The order is that of the least Bayesian information criterion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Autoregression(NamedTuple):
    """Predictors of a stationary noise from the values before.

    Attributes
    ----------
    weights : shape (p + 1, p), row m predicts from the last m values, the latest first
    deviation : shape (p + 1,), standard deviation of the prediction error of row m
    """

    weights: Array
    deviation: Array

    @property
    def order(self) -> int:
        """Values before that predict."""
        return int(self.weights.shape[1])

    def whitened(self, rows: Array, first: Flags) -> Array:
        """Return the prediction errors of rows from the rows before, over their standard deviation.

        Parameters
        ----------
        rows : shape (M, c)
        first : shape (M,), where the row before is missing
        """
        out = np.empty_like(rows)
        _whiten(rows, first, self.weights, self.deviation, out)
        return out


def autoregression(residual: Array, first: Flags, least: float, most: int) -> Autoregression:
    """Fit an autoregression to residuals.

    Parameters
    ----------
    residual : shape (M,)
    first : shape (M,), where the one before is missing
    least : standard deviation of white noise that is there in any case, above zero
    most : values before that may predict
    """
    count = residual.size
    # An autocovariance is averaged over ten rows of each lag at least.
    most = min(most, count // 10)
    covariance = np.zeros(most + 1)
    _autocovariance(residual, first, covariance)
    covariance[0] += least**2
    weights, variance = np.zeros((most + 1, most)), np.empty(most + 1)
    variance[0] = covariance[0]
    for m in range(1, most + 1):
        before = weights[m - 1, : m - 1]
        reflection = (covariance[m] - before @ covariance[m - 1 : 0 : -1]) / variance[m - 1]
        weights[m, : m - 1] = before - reflection * before[::-1]
        weights[m, m - 1] = reflection
        variance[m] = variance[m - 1] * (1.0 - reflection**2)
    order = int(np.argmin(count * np.log(variance) + np.arange(most + 1) * np.log(max(count, 1))))
    return Autoregression(np.ascontiguousarray(weights[: order + 1, :order]), np.sqrt(variance[: order + 1]))


@compiled
def _autocovariance(residual: Array, first: Flags, covariance: Array) -> None:
    count, since = residual.size, 0
    for k in range(count):
        since = 0 if first[k] else since + 1
        for lag in range(min(since, covariance.size - 1) + 1):
            covariance[lag] += residual[k] * residual[k - lag] / count


@compiled
def _whiten(rows: Array, first: Flags, weights: Array, deviation: Array, out: Array) -> None:
    since = 0
    for k in range(rows.shape[0]):
        since = 0 if first[k] else since + 1
        order = min(since, weights.shape[1])
        for j in range(rows.shape[1]):
            value = rows[k, j]
            for lag in range(order):
                value -= weights[order, lag] * rows[k - 1 - lag, j]
            out[k, j] = value / deviation[order]
