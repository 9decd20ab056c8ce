"""How the unknowns are found: enhanced RLS (Flacco 2012) and QR-RLS (Flacco 2014)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.estimators.bend import MOST, BentState, bent_block, bent_start
from vsalog.estimators.equation import EquationRows
from vsalog.estimators.jumps import jumped_block
from vsalog.estimators.noise import BOX, SAMPLES, NoiseState, noise_block, noise_now, noise_start
from vsalog.estimators.qr import QrState, qr_block
from vsalog.estimators.resting import RestState, rest_block, rest_covariance
from vsalog.estimators.rls import RlsState, rls_block
from vsalog.estimators.uneven import SURELY
from vsalog.estimators.walk import WalkState, walk_block, walk_start
from vsalog.filters.conditioning import Conditioner

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# What encoders' steps hide is in the left-overs already where it is no more than this part of what these make.
SEEN = 0.25
# What happens within so many of a filter's windows does not tell how large slow noise is.
WINDOWS = 5


class RlsSolverState(NamedTuple):
    """Where it stands: the fit, its noise, what bends it, what is not known of jumps, and what its encoders' steps hide."""

    rls: RlsState
    noise: NoiseState
    bent: BentState
    jumped: Array
    rest: RestState | None = None


@dataclass(frozen=True, slots=True)
class RlsSolver:
    """Enhanced RLS (Flacco 2012 eq. 39–41) from α(0) = 0 and P(0) = p0 I; c = 1 is plain RLS (eq. 23).

    Attributes
    ----------
    p0, c : of the method
    least : samples without which nothing is said of the uncertainty
    box : samples that filters before it make one, of which left-overs are summed first
    """

    p0: float
    c: float
    least: int = SAMPLES
    box: int = BOX

    def start(self, size: int) -> RlsSolverState:
        """Return the state before the first sample."""
        jumped = np.zeros((size, size))
        return RlsSolverState(RlsState.start(size, self.p0), noise_start(size, self.box), bent_start(size), jumped)

    def block(
        self, state: RlsSolverState, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[RlsSolverState, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        rls, values, directions, pulled, unknowns, left, factor = rls_block(
            state.rls, rows.F, rows.y, use, E, spread, self.c, self.p0
        )
        noise, made = noise_block(
            state.noise, rows.F, rows.y, left, use, rows.fresh, directions, False, 1.0, self.least
        )
        rest, hidden = _rested(state.rest, rows, np.isfinite(left), E[:, spread], unknowns, directions, 1.0)
        made = made + np.maximum(hidden - SEEN * made, 0.0)
        bent, jumped = state.bent, state.jumped
        if rows.bends:
            bent, moved = bent_block(
                bent, rows.bends, E[:, spread], directions, unknowns, values[:, spread], np.isfinite(left), rows.fresh,
                False, 1.0,
            )  # fmt: skip
            made += moved**2
        if rows.jumps is not None:
            jumped, beside = jumped_block(jumped, rows.F, np.isfinite(left), rows.jumps, directions)
            made += beside
        values[_untold(unknowns)] = np.nan
        new = RlsSolverState(rls, noise, bent, jumped, rest)
        return new, values, _spread(made, pulled, spread), unknowns, {"stability_factor": factor}

    def solution(self, state: RlsSolverState) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance, and the standard deviation of a left-over."""
        M, uneven, variance = noise_now(state.noise, False, self.least)
        P, bent = self.c * state.rls.P, state.bent.covariance(state.rls.alpha)
        told = _more(_sandwich(P, M), _sandwich(P, uneven), SURELY)
        beside = bent + state.jumped + rest_covariance(state.rest)
        return state.rls.alpha.copy(), told + _sandwich(P, beside), variance**0.5


class QrSolverState(NamedTuple):
    """Where it stands: the fit, its noise, what bends it, the walk, what encoders' steps hide."""

    qr: QrState
    noise: NoiseState
    bent: BentState
    walk: WalkState
    rest: RestState | None = None


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
    least: int = SAMPLES

    def start(self, size: int) -> QrSolverState:
        """Return the state before the first sample."""
        return QrSolverState(
            QrState.start(size, self.leading, self.p0), noise_start(size), bent_start(size), walk_start(size)
        )

    def block(
        self, state: QrSolverState, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[QrSolverState, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        qr, values, directions, pulled, unknowns, left = qr_block(
            state.qr, rows.F, rows.y, use, rows.fresh, E, spread, self.forgetting, self.leading, self.p0
        )
        noise, made = noise_block(
            state.noise, rows.F, rows.y, left, use, rows.fresh, directions, self.integral, self.forgetting, self.least
        )
        walk, discount = state.walk, self.forgetting**2
        if rows.walk is not None:
            # A fit to an integral takes most of a walk for its own: left-overs may show too little of it.
            walk, least = walk_block(walk, rows.F, use, rows.fresh, directions, rows.walk, discount)
            made = np.maximum(made, least)
        rest, hidden = _rested(state.rest, rows, np.isfinite(left), E[:, spread], unknowns, directions, discount)
        made = made + np.maximum(hidden - SEEN * made, 0.0)
        if rows.noisy is not None:
            learnt = state.noise.samples + np.cumsum(np.isfinite(left))
            made += self._bent(directions, unknowns, learnt, rows.noisy, values[:, spread]) ** 2
        bent = state.bent
        if rows.bends:
            bent, moved = bent_block(
                bent, rows.bends, E[:, spread], directions, unknowns, values[:, spread], np.isfinite(left), rows.fresh,
                self.integral, discount,
            )  # fmt: skip
            made += moved**2
        values[_untold(unknowns[:, self.leading :])] = np.nan
        new = QrSolverState(qr, noise, bent, walk, rest)
        return new, values, _spread(made, pulled, spread), unknowns, {}

    def _bent(self, directions: Array, unknowns: Array, learnt: Array, noisy: Array, values: Array) -> Array:
        """Return what noise in regressors that count as exact bends functionals of these values by, shape (N, m).

        To first order, P N ξ̂ with the noise's energy N; but what noise has made of an unknown is not what it would be without,
        which is larger by 1 − r, the part r of its regressor's information that is noise. A functional that this leaves as it
        is by chance is bent by the next order, r of itself. Where noise is most of the information nothing is known.
        """
        discount = self.forgetting**2
        remembered = learnt if discount == 1.0 else (1.0 - discount**learnt) / (1.0 - discount)
        bent = np.einsum("kmi,ki->km", directions, noisy * unknowns) * remembered[:, None]
        # The last functionals are the leading unknowns behind the constant, and their directions the columns of P.
        own = directions[:, 1 - self.leading :, 1 : self.leading]
        part = (np.diagonal(own, axis1=1, axis2=2) * noisy[1 : self.leading]).max(axis=1) * remembered
        bent = np.hypot(bent / np.maximum(1.0 - part, 1.0 - MOST)[:, None], part[:, None] * values)
        return np.asarray(np.where(part[:, None] < MOST, bent, np.inf))

    def solution(self, state: QrSolverState) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance, and the standard deviation of a left-over; NaN where the data do not determine them."""
        xi = state.qr.solve()
        if np.isnan(xi).any():
            return xi, np.full((xi.size, xi.size), np.nan), float("nan")
        M, uneven, variance = noise_now(state.noise, self.integral, self.least)
        half = np.linalg.inv(state.qr.Rp[:, :-1])
        P, beside = half @ half.T, state.bent.covariance(xi) + rest_covariance(state.rest)
        told, walk = _sandwich(P, M), state.walk.Q + state.walk.done
        told = _more(_more(told, _sandwich(P, uneven), SURELY), _sandwich(P, walk))
        return xi, told + _sandwich(P, beside), variance**0.5


def least_samples(filters: Conditioner) -> int:
    """Return how many samples have to be learnt from before anything is said; within a filter's window noise is alike."""
    return max(SAMPLES, 0 if filters.kind == "kinematic" else WINDOWS * filters.window)


def _rested(
    state: RestState | None, rows: EquationRows, use: Flags, slopes: Array, unknowns: Array, directions: Array,
    discount: float,
) -> tuple[RestState | None, Array]:  # fmt: skip
    """Return what the encoders' steps hide of functionals, a variance each, shape (N, m); nothing where there are no steps."""
    if rows.resting is None:
        return state, np.zeros(directions.shape[:2])
    slopes = slopes[:, : rows.resting.moves.shape[1]]
    return rest_block(state, rows.F, use, rows.fresh, slopes, unknowns, directions, rows.resting, rows.period, discount)


def _sandwich(P: Array, M: Array) -> Array:
    """Return P M P as a covariance: symmetric, and with no negative eigenvalue, however ill-conditioned; NaN where unknown."""
    if not (np.isfinite(P).all() and np.isfinite(M).all()):
        return np.full(M.shape, np.nan)
    w, v = np.linalg.eigh(0.5 * (M + M.T))
    root = P @ (v * np.sqrt(np.maximum(w, 0.0)))
    return np.asarray(root @ root.T)


def _more(told: Array, other: Array, times: float = 1.0) -> Array:
    """Return a covariance with another's variances where they are so many times as large, and its own correlations."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.diagonal(other) / np.diagonal(told)
    more = np.sqrt(np.where(ratio > times, ratio, 1.0))
    return np.asarray(told * np.outer(more, more))


def _untold(coefficients: Array) -> Flags:
    """Tell the samples, shape (N,), at which the coefficients are still the zeros that a recursion begins with: no estimate."""
    return ~np.asarray(coefficients.any(axis=1))


def _spread(made: Array, pulled: Array, spread: Flags) -> Array:
    """Return the variances of all functionals: what noise makes, and what the prior may have pulled them by."""
    out = np.full((made.shape[0], spread.size), np.nan)
    out[:, spread] = made + pulled**2
    return out
