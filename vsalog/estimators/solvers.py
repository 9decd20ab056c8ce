"""How the unknowns are found: enhanced RLS (Flacco 2012) and QR-RLS (Flacco 2014)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.estimators.noise import noise_variance
from vsalog.estimators.qr import QrState, qr_block
from vsalog.estimators.regression import EquationRows
from vsalog.estimators.rls import RlsState, rls_block

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class RlsSolver:
    """Enhanced RLS (Flacco 2012 eq. 39–41) from α(0) = 0 and P(0) = p0 I; c = 1 is plain RLS (eq. 23)."""

    p0: float
    c: float
    memory: float

    def start(self, size: int) -> RlsState:
        """Return the state before the first sample."""
        return RlsState.start(size, self.p0)

    def block(
        self, state: RlsState, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[RlsState, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        state, values, variances, unknowns, _, factor = rls_block(
            state, rows.F, rows.y, use, E, spread, self.c, self.p0, self.memory
        )
        return state, values, variances, unknowns, {"stability_factor": factor}

    def solution(self, state: RlsState) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance σ² c P, and σ."""
        variance, inflation = noise_variance(state.noise, state.alpha.shape[0])
        return state.alpha.copy(), variance * inflation * self.c * state.P, float(np.sqrt(variance))


@dataclass(frozen=True, slots=True)
class QrSolver:
    """QR-RLS (Flacco 2014 eq. 21–23) with forgetting factor λ and a weak prior on all but the leading unknowns."""

    forgetting: float
    memory: float
    leading: int = 0
    p0: float = np.inf

    def start(self, size: int) -> QrState:
        """Return the state before the first sample."""
        return QrState.start(size, self.leading, self.p0)

    def block(
        self, state: QrState, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[QrState, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        state, values, variances, unknowns, _ = qr_block(
            state, rows.F, rows.y, use, rows.fresh, E, spread, self.forgetting, self.memory, self.leading, self.p0
        )
        return state, values, variances, unknowns, {}

    def solution(self, state: QrState) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance σ² (RᵀR)⁻¹, and σ; NaN where the data do not determine them."""
        xi = state.solve()
        variance, inflation = noise_variance(state.noise, xi.shape[0])
        if np.isnan(xi).any():
            return xi, np.full((xi.shape[0], xi.shape[0]), np.nan), float("nan")
        half = np.linalg.inv(state.Rp[:, :-1])
        return xi, variance * inflation * (half @ half.T), float(np.sqrt(variance))
