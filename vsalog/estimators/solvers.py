"""How the unknowns are found: enhanced RLS (Flacco 2012) and QR-RLS (Flacco 2014)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.estimators.noise import noise_block, noise_now, noise_start
from vsalog.estimators.qr import QrState, qr_block
from vsalog.estimators.regression import EquationRows
from vsalog.estimators.rls import RlsState, rls_block

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class RlsSolver:
    """Enhanced RLS (Flacco 2012 eq. 39–41) from α(0) = 0 and P(0) = p0 I; c = 1 is plain RLS (eq. 23).

    Attributes
    ----------
    p0, c : of the method
    memory : samples over which the noise is observed
    """

    p0: float
    c: float
    memory: float

    def start(self, size: int) -> tuple[RlsState, Array]:
        """Return the state before the first sample."""
        return RlsState.start(size, self.p0), noise_start()

    def block(
        self, state: tuple[RlsState, Array], rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[tuple[RlsState, Array], Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        rls, values, forms, pulled, unknowns, left, factor = rls_block(
            state[0], rows.F, rows.y, use, E, spread, self.c, self.p0
        )
        noise, variance = noise_block(state[1], left, E.shape[2], self.memory)
        variances = variance[:, None] * forms + pulled**2
        return (rls, noise), values, variances, unknowns, {"stability_factor": factor}

    def solution(self, state: tuple[RlsState, Array]) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance σ² c P, and σ."""
        variance, inflation = noise_now(state[1], state[0].alpha.shape[0])
        return state[0].alpha.copy(), variance * inflation * self.c * state[0].P, variance**0.5


@dataclass(frozen=True, slots=True)
class QrSolver:
    """QR-RLS (Flacco 2014 eq. 21–23) with forgetting factor λ and a weak prior on all but the leading unknowns.

    Attributes
    ----------
    forgetting : λ
    memory : samples over which the noise is observed
    leading : unknowns without a prior
    p0 : prior covariance of the others, infinite for none
    """

    forgetting: float
    memory: float
    leading: int = 0
    p0: float = np.inf

    def start(self, size: int) -> tuple[QrState, Array]:
        """Return the state before the first sample."""
        return QrState.start(size, self.leading, self.p0), noise_start()

    def block(
        self, state: tuple[QrState, Array], rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[tuple[QrState, Array], Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        qr, values, forms, pulled, unknowns, left = qr_block(
            state[0], rows.F, rows.y, use, rows.fresh, E, spread, self.forgetting, self.leading, self.p0
        )
        noise, variance = noise_block(state[1], left, E.shape[2], self.memory)
        return (qr, noise), values, variance[:, None] * forms + pulled**2, unknowns, {}

    def solution(self, state: tuple[QrState, Array]) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance σ² (RᵀR)⁻¹, and σ; NaN where the data do not determine them."""
        xi = state[0].solve()
        variance, inflation = noise_now(state[1], xi.shape[0])
        if np.isnan(xi).any():
            return xi, np.full((xi.shape[0], xi.shape[0]), np.nan), float("nan")
        half = np.linalg.inv(state[0].Rp[:, :-1])
        return xi, variance * inflation * (half @ half.T), variance**0.5
