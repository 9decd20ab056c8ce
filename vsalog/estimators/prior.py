"""What the prior does to an estimate, detected by a weaker one beside it.

A recursion begins with coefficients of zero and some trust in them, which decides what the log does not show: usually well, for
springs are not far from what the prior expects. But where coefficients have to be large, as those of a set-point whose sign is
not the rig's, the prior holds them back though the data would tell better, and left-overs hardly show it. So every sample is
learnt from twice, the second time with a weaker prior. How far the stiffness moves then, beyond what noise makes of the second
estimate, is what the prior has decided against the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.estimators.device import Device
from vsalog.estimators.equation import SUPPORTED_SHARE, Equation, EquationRows, Solver
from vsalog.estimators.solvers import QrSolver, RlsSolver

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Times by which the prior covariance of the second estimate is larger, and at least; and what of a usual sample's weight a prior
# has to have, so that a recursion does not lose its digits.
WEAKER, LEAST, WEAKEST = 1e4, 100.0, 1e-8
# Deviations of the second estimate by which it may differ: of few samples they are too small.
SURELY = 2.0
# What moves a stiffness by so much of it, for so much of the log, is worth a word.
WORTH_A_WORD, OFTEN = 0.03, 0.1


def with_weaker_prior(solver: Solver, usual: float) -> Solver:
    """Return a solver that counts in what its prior decides; the same where it has none, or one that is weak already.

    Parameters
    ----------
    solver : of an equation
    usual : what its regressors usually reach (`usual_regressor`)
    """
    if not isinstance(solver, RlsSolver | QrSolver) or (isinstance(solver, QrSolver) and solver.integral):
        return solver
    c = solver.c if isinstance(solver, RlsSolver) else 1.0
    weaker = min(WEAKER * solver.p0, 1.0 / (WEAKEST * c * usual**2))
    return WithWeakerPrior(solver, replace(solver, p0=weaker)) if weaker >= LEAST * solver.p0 else solver


def alone(solver: Solver) -> Solver:
    """Return a solver without the one beside it."""
    return solver.own if isinstance(solver, WithWeakerPrior) else solver


class Both(NamedTuple):
    """States of the solver and of the one beside it; the rows so far of which the former is sure, those of them that the prior
    moves, and the sum of the squared parts by which it does.
    """

    own: Any
    weaker: Any
    seen: int = 0
    moved: int = 0
    squares: float = 0.0


@dataclass(frozen=True, slots=True)
class WithWeakerPrior:
    """A solver, and the same with a weaker prior; its estimates are those of the first.

    Attributes
    ----------
    own, weaker : the solvers
    """

    own: Solver
    weaker: Solver

    @property
    def p0(self) -> float:
        """Prior covariance of the coefficients."""
        return self.own.p0

    def start(self, size: int) -> Both:
        """Return the state before the first sample."""
        return Both(self.own.start(size), self.weaker.start(size))

    def block(
        self, state: Both, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[Both, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block and evaluate E ξ̂ after each sample."""
        own, values, variances, unknowns, extra = self.own.block(state.own, rows, use, E, spread)
        weaker, others, allowed, _, _ = self.weaker.block(state.weaker, rows, use, E, spread)
        more = beyond((others - values)[:, spread], allowed[:, spread])
        first = int(np.argmax(spread))
        with np.errstate(divide="ignore", invalid="ignore"):
            sure = variances[:, first] < (SUPPORTED_SHARE * values[:, first]) ** 2
            part = (more[:, 0] / values[:, first] ** 2)[sure]
        moved = part[part > WORTH_A_WORD**2]
        variances[:, spread] += more
        squares = state.squares + float(np.minimum(moved, 1.0).sum())
        new = Both(own, weaker, state.seen + part.size, state.moved + moved.size, squares)
        return new, values, variances, unknowns, extra

    def solution(self, state: Both) -> tuple[Array, Array, float]:
        """Return ξ̂, its covariance, and the standard deviation of a left-over."""
        xi, covariance, noise = self.own.solution(state.own)
        other, allowed, _ = self.weaker.solution(state.weaker)
        return xi, covariance + beyond_together(other - xi, allowed), noise


def beyond(moved: Array, allowed: Array) -> Array:
    """Return the square of what moves beyond SURELY deviations, of variances `allowed`; zero where these are not known."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.maximum(np.nan_to_num(moved**2 - SURELY**2 * allowed, nan=0.0), 0.0))


def beyond_together(moved: Array, allowed: Array) -> Array:
    """Return the covariance, shape (n, n), of what coefficients move by beyond SURELY deviations of a covariance `allowed`.

    It is their outer product less the part of it that noise may make of a distance of n coefficients (James and Stein, 1961).
    """
    if not (np.isfinite(moved).all() and np.isfinite(allowed).all()):
        return np.zeros(allowed.shape)
    w, v = np.linalg.eigh(allowed)
    known = w > 0.0
    distance = float(((v.T @ moved)[known] ** 2 / w[known]).sum())
    noise = SURELY**2 * moved.size
    return np.outer(moved, moved) * (1.0 - noise / distance if distance > noise else 0.0)


def held_back(
    device: Device, equations: Sequence[Equation], solver: Solver, states: Sequence[Any], tuned: float
) -> list[Finding]:
    """Find the transmissions of which the prior often decides much of the stiffness.

    Parameters
    ----------
    device : of the joint
    equations : of its transmissions
    solver, states : by which they are solved, and where it stands with each
    tuned : what of the tuning makes the solver's prior
    """
    if not isinstance(solver, WithWeakerPrior):
        return []
    advised = float(tuned * solver.weaker.p0 / solver.own.p0)
    found = []
    for equation, state in zip(equations, states, strict=True):
        if state.moved <= OFTEN * state.seen:
            continue
        found.append(
            Finding(
                code="prior.holds_back",
                joint=device.joint,
                part=" and ".join(view.name for view in equation.transmissions),
                value=state.moved / state.seen,
                limit=OFTEN,
                evidence={"stiffness_change": (state.squares / state.moved) ** 0.5, "p0": advised},
            )
        )
    return found
