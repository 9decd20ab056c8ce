"""How the unknowns are found: enhanced RLS (Flacco 2012) and QR-RLS (Flacco 2014)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.estimators.equation import EquationRows
from vsalog.estimators.qr import QrState, qr_block
from vsalog.estimators.rls import RlsState, rls_block
from vsalog.filters.conditioning import Conditioner
from vsalog.uncertainty.errors_in_variables import BiasState, bias_block, bias_start
from vsalog.uncertainty.integrated_noise import WalkState, walk_block, walk_start
from vsalog.uncertainty.long_run import (
    BOX,
    CLEARLY_NONSTATIONARY,
    FEWEST_SAMPLES,
    LongRunState,
    long_run_block,
    long_run_covariance,
    long_run_start,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Samples within this number of a filter's windows do not determine how large slow noise is.
FEWEST_WINDOWS = 5


class Uncertainty(NamedTuple):
    """The uncertainty of a fit: from its residuals, from the noise of its regressors, and from an integral's random walk."""

    long_run: LongRunState
    bias: BiasState
    walk: WalkState
    walk_step: float = 0.0

    @classmethod
    def start(cls, size: int, box: int = BOX) -> Uncertainty:
        """Return the state before the first sample."""
        return cls(long_run_start(size, box), bias_start(size), walk_start(size))

    def block(
        self, rows: EquationRows, residual: Array, E: Array, spread: Flags, T: Array, unknowns: Array, values: Array,
        integral: bool, forgetting: float, least: int,
    ) -> tuple[Uncertainty, Array]:  # fmt: skip
        """Observe a block; return the state, and variances of functionals, shape (N, m).

        Parameters
        ----------
        rows : of the equation
        residual : shape (N,), recursive residuals, NaN where no sample was used
        E, T : shapes (N, q, n) and (N, m, n), functionals E, and P E of those with a variance
        spread : shape (q,), which have one
        unknowns, values : shapes (N, n) and (N, q), ξ̂ and E ξ̂
        integral, forgetting, least : of the solver
        """
        use, discount, bias, walk = np.isfinite(residual), forgetting**2, self.bias, self.walk
        long_run, variances = long_run_block(
            self.long_run, rows.F, rows.y, residual, use, rows.fresh, T, integral, forgetting, least
        )
        if rows.walk_step is not None:
            # Residuals may show too little of a random walk, which a fit to an integral follows.
            walk, alone = walk_block(walk, rows.F, rows.use, rows.fresh, T, discount)
            variances = np.maximum(variances, rows.walk_step * alone)
        if rows.noise is not None:
            bias, off = bias_block(
                bias, rows.noise, E[:, spread], T, unknowns, values[:, spread], use, rows.fresh, integral, discount
            )
            variances = variances + off**2
        return Uncertainty(long_run, bias, walk, rows.walk_step or 0.0), variances

    def covariance(self, P: Array, unknowns: Array, integral: bool, least: int) -> tuple[Array, float]:
        """Return the covariance of the unknowns, shape (n, n), for (Σ F Fᵀ)⁻¹ = P, and the standard deviation of a residual."""
        stationary, changing, variance = long_run_covariance(self.long_run, integral, least)
        found = _more(_sandwich(P, stationary), _sandwich(P, changing), CLEARLY_NONSTATIONARY)
        if self.walk_step:
            found = _more(found, _sandwich(P, self.walk_step * (self.walk.Q + self.walk.done)))
        return found + _sandwich(P, self.bias.covariance(unknowns)), variance**0.5


class RlsSolverState(NamedTuple):
    """State: the fit, and its uncertainty."""

    rls: RlsState
    uncertainty: Uncertainty


@dataclass(frozen=True, slots=True)
class RlsSolver:
    """Enhanced RLS (Flacco 2012 eq. 39–41) from α(0) = 0 and P(0) = p0 I; c = 1 is plain RLS (eq. 23).

    Attributes
    ----------
    p0, c : of the method
    least : samples below which no uncertainty is reported
    box : samples that filters before it correlate, over which residuals are summed first
    """

    p0: float
    c: float
    least: int = FEWEST_SAMPLES
    box: int = BOX

    def start(self, size: int) -> RlsSolverState:
        """Return the state before the first sample."""
        return RlsSolverState(RlsState.start(size, self.p0), Uncertainty.start(size, self.box))

    def block(
        self, state: RlsSolverState, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[RlsSolverState, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        rls, values, directions, pulled, unknowns, residual, factor = rls_block(
            state.rls, rows.F, rows.y, use, E, spread, self.c, self.p0
        )
        uncertainty, variances = state.uncertainty.block(
            rows, residual, E, spread, directions, unknowns, values, False, 1.0, self.least
        )
        _leave_out_unlearnt(values, unknowns)
        out = _of_all(variances, pulled, spread)
        return RlsSolverState(rls, uncertainty), values, out, unknowns, {"stability_factor": factor}

    def solution(self, state: RlsSolverState) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance, and the standard deviation of a residual."""
        alpha = state.rls.alpha.copy()
        return alpha, *state.uncertainty.covariance(self.c * state.rls.P, alpha, False, self.least)


class QrSolverState(NamedTuple):
    """State: the fit, and its uncertainty."""

    qr: QrState
    uncertainty: Uncertainty


@dataclass(frozen=True, slots=True)
class QrSolver:
    """QR-RLS (Flacco 2014 eq. 21–23) with forgetting factor λ and a weak prior on all but the leading unknowns.

    Attributes
    ----------
    forgetting : λ
    leading : unknowns without a prior
    p0 : prior covariance of the others, infinite for none
    integral : whether the equation is an integral, whose first unknown is its constant
    least : as for `RlsSolver`
    """

    forgetting: float
    leading: int = 0
    p0: float = np.inf
    integral: bool = False
    least: int = FEWEST_SAMPLES

    def start(self, size: int) -> QrSolverState:
        """Return the state before the first sample."""
        return QrSolverState(QrState.start(size, self.leading, self.p0), Uncertainty.start(size))

    def block(
        self, state: QrSolverState, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[QrSolverState, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        qr, values, directions, pulled, unknowns, residual = qr_block(
            state.qr, rows.F, rows.y, use, rows.fresh, E, spread, self.forgetting, self.leading, self.p0
        )
        uncertainty, variances = state.uncertainty.block(
            rows,
            residual,
            E,
            spread,
            directions,
            unknowns,
            values,
            self.integral,
            self.forgetting,
            self.least,
        )
        _leave_out_unlearnt(values, unknowns[:, self.leading :])
        return QrSolverState(qr, uncertainty), values, _of_all(variances, pulled, spread), unknowns, {}

    def solution(self, state: QrSolverState) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance, and the standard deviation of a residual; NaN where the data do not determine them."""
        xi = state.qr.solve()
        if np.isnan(xi).any():
            return xi, np.full((xi.size, xi.size), np.nan), float("nan")
        half = np.linalg.inv(state.qr.Rp[:, :-1])
        return xi, *state.uncertainty.covariance(half @ half.T, xi, self.integral, self.least)


def least_samples(filters: Conditioner) -> int:
    """Return how many samples have to be used before anything is reported; within a filter's window noise is correlated."""
    return max(FEWEST_SAMPLES, 0 if filters.kind == "kinematic" else FEWEST_WINDOWS * filters.window)


def _sandwich(P: Array, M: Array) -> Array:
    """Return P M P as a covariance: symmetric, and with no negative eigenvalue, however ill-conditioned; NaN where unknown."""
    if not (np.isfinite(P).all() and np.isfinite(M).all()):
        return np.full(M.shape, np.nan)
    w, v = np.linalg.eigh(0.5 * (M + M.T))
    root = P @ (v * np.sqrt(np.maximum(w, 0.0)))
    return np.asarray(root @ root.T)


def _more(found: Array, other: Array, times: float = 1.0) -> Array:
    """Return a covariance with another's variances where they are larger by a factor, and its own correlations."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.diagonal(other) / np.diagonal(found)
    more = np.sqrt(np.where(ratio > times, ratio, 1.0))
    return np.asarray(found * np.outer(more, more))


def _leave_out_unlearnt(values: Array, coefficients: Array) -> None:
    """Set values to NaN as long as the coefficients, shape (N, n), are the zeros that a recursion begins with: no estimate."""
    values[~coefficients.any(axis=1)] = np.nan


def _of_all(variances: Array, pulled: Array, spread: Flags) -> Array:
    """Return the variances of all functionals, NaN where not asked for: of errors, and how far the prior may have pulled them."""
    out = np.full((variances.shape[0], spread.size), np.nan)
    out[:, spread] = variances + pulled**2
    return out
