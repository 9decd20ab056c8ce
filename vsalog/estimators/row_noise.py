"""Noise of an equation's averaged rows: its colour, and the part that several equations have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from vsalog.core.precision import ROUNDING
from vsalog.estimators.box_rows import BOXES, BoxRows
from vsalog.uncertainty.autoregression import Autoregression, autoregression

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


class SteepNoise(NamedTuple):
    """Coloured noise of which a part is multiplied by the stiffness.

    Attributes
    ----------
    share : of the variance [1], which is multiplied by the steepness, the stiffness squared over its average
    rest : the autoregression of what is left when rows are divided by that growth
    """

    share: float
    rest: Autoregression

    @classmethod
    def fitted(cls, residual: Array, first: Flags, steepness: Array, least: float) -> SteepNoise:
        """Fit it to residuals, shape (M,); the share from logarithms, for which outliers are few more rows (Harvey 1976)."""
        size, logarithm = residual.size, np.log(np.hypot(residual, least))

        def lost(share: float) -> float:
            return 0.5 * size * float(np.log(np.var(logarithm - np.log(_growth(share, steepness)))))

        share = 0.0
        if size and np.ptp(logarithm) > 0.0:
            found = minimize_scalar(lost, bounds=(0.0, 1.0), method="bounded")
            # The Bayesian information criterion of one parameter more.
            share = float(found.x) if lost(0.0) - found.fun > 0.5 * np.log(size) else 0.0
        # Filters make sensors' white noise dependent within a window; a higher order takes motion not explained yet for noise.
        return cls(share, autoregression(residual / _growth(share, steepness), first, least, BOXES.per_window))

    def whitened(self, rows: Array, first: Flags, steepness: Array) -> Array:
        """Return rows, shape (M, c), with independent noise of variance one."""
        return self.rest.whitened(rows / _growth(self.share, steepness)[:, None], first)

    def logarithm(self, steepness: Array) -> float:
        """Return the sum of the logarithms of what rows are divided by."""
        return float(len(steepness) * np.log(self.rest.deviation[-1]) + np.log(_growth(self.share, steepness)).sum())


class RowNoise(NamedTuple):
    """Coloured noise of an equation's rows, correlated with that of the equations before it.

    The equations of a joint have the deflection's noise in common. A regression on the residuals of the equations before, at the
    same time and up to `reach` boxes earlier and later, predicts that part; the rest is an autoregression, whose deviation grows
    with the stiffness, for the deflection's noise is multiplied by it.

    Attributes
    ----------
    shared : shape (equations before, 2 · reach + 1), coefficients of that regression
    left : the rest
    alone : the noise of rows for which not all of these residuals are there
    deviation : standard deviation of a row
    """

    shared: Array
    left: SteepNoise
    alone: SteepNoise
    deviation: float

    @classmethod
    def white(cls, part: BoxRows, torques: Array | None, where: Integers) -> RowNoise:
        """Return white noise with the residual variance of least squares.

        Where rows are no more than unknowns it has that of the torque.

        Parameters
        ----------
        part : M rows
        torques : shape (M, transmissions), of each transmission, of which each interval has another part (Frisch and Waugh
            1933); None for a spring that does not change
        where : shape (M,), the interval of each row
        """
        rows, freedom = part.rows, len(part.rows)
        if torques is not None:
            rows = rows.copy()
            for interval in np.unique(where):
                own = where == interval
                parts, _, rank, _ = np.linalg.lstsq(torques[own], rows[own], rcond=None)
                rows[own] -= torques[own] @ parts
                freedom -= int(rank)
        x, _, rank, _ = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)
        freedom -= int(rank)
        left = rows[:, -1] - rows[:, :-1] @ x if freedom > 0 else part.rows[:, -1]
        square = np.sum(left**2) / max(freedom if freedom > 0 else len(left), 1)
        deviation = float(np.hypot(np.sqrt(square), _rounding(part))) if len(left) else 1.0
        own = SteepNoise(0.0, Autoregression(np.zeros((1, 0)), np.array([deviation])))
        return cls(np.zeros((0, 1)), own, own, deviation)

    @classmethod
    def fitted(
        cls, residual: Array, part: BoxRows, steepness: Array, before: Sequence[tuple[Array, BoxRows]]
    ) -> RowNoise:
        """Fit it to residuals, those of the equations before given with their boxes; steepness as of `SteepNoise`."""
        least = _rounding(part)
        alone = SteepNoise.fitted(residual, part.first, steepness, least)
        deviation = float(np.sqrt(np.mean(residual**2))) if len(residual) else float("nan")
        shared, left, best = np.zeros((0, 1)), alone, np.inf
        for reach in range(BOXES.per_window + 1) if before else ():
            others, there = _neighbours(part, before, reach)
            if np.count_nonzero(there) <= 2 * others.shape[1]:
                break
            weights: Array = np.asarray(np.linalg.lstsq(others[there], residual[there], rcond=None)[0])
            own = residual - others @ weights
            first = part.first | ~there | np.r_[True, ~there[:-1]]
            fit = SteepNoise.fitted(own[there], first[there], steepness[there], least)
            size = int(np.count_nonzero(there))
            criterion = 2.0 * fit.logarithm(steepness[there]) + (fit.rest.order + weights.size) * np.log(size)
            if criterion < best:
                best, left, shared = criterion, fit, weights.reshape(len(before), -1)
        return cls(shared, left, alone, deviation)

    def whitened(self, rows: Array, part: BoxRows, steepness: Array, before: Sequence[tuple[Array, BoxRows]]) -> Array:
        """Return rows, shape (M, c), with independent noise of variance one.

        Parameters
        ----------
        rows : shape (M, c)
        part : their boxes
        steepness : shape (M,), as of `SteepNoise`
        before : rows of the equations before, of as many columns, and their boxes
        """
        if not len(self.shared):
            return self.alone.whitened(rows, part.first, steepness)
        own, there = rows.copy(), np.ones(len(rows), dtype=np.bool_)
        reach = self.shared.shape[1] // 2
        for (other, boxes), weights in zip(before, self.shared, strict=True):
            for lag, weight in zip(range(-reach, reach + 1), weights, strict=True):
                at, found = _beside(part, boxes, lag)
                there &= found
                own[found] -= weight * other[at[found]]
        changed = part.first | np.r_[True, there[1:] != there[:-1]]
        out = np.empty_like(rows)
        out[there] = self.left.whitened(own[there], changed[there], steepness[there])
        out[~there] = self.alone.whitened(rows[~there], changed[~there], steepness[~there])
        return out


def _growth(share: float, steepness: Array) -> Array:
    """Return the deviation of rows over that which they have on average."""
    return np.sqrt(1.0 - share + share * steepness)


def _rounding(part: BoxRows) -> float:
    """Return the size of rounding errors in an equation's rows."""
    largest = float(np.abs(part.rows[:, -1]).max(initial=0.0))
    return ROUNDING * largest or 1.0


def _beside(part: BoxRows, other: BoxRows, lag: int) -> tuple[Integers, Flags]:
    """Return the index of another equation's box that is `lag` boxes later, shape (M,), and whether there is one."""
    if not len(other.place):
        return np.zeros(len(part.place), dtype=np.int64), np.zeros(len(part.place), dtype=np.bool_)
    wanted = part.place + lag * part.size
    at = np.minimum(np.searchsorted(other.place, wanted), len(other.place) - 1)
    return at, other.place[at] == wanted


def _neighbours(part: BoxRows, before: Sequence[tuple[Array, BoxRows]], reach: int) -> tuple[Array, Flags]:
    """Return the residuals of equations before, `reach` boxes to either side, shape (M, m), and where all of them are there."""
    columns, there = [], np.ones(len(part.place), dtype=np.bool_)
    for residual, boxes in before:
        for lag in range(-reach, reach + 1):
            at, found = _beside(part, boxes, lag)
            column = np.zeros(len(found))
            column[found] = residual[at[found]]
            columns.append(column)
            there &= found
    return np.column_stack(columns), there
