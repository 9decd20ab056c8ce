"""The most probable values of a set of causes: corrected Gauss–Newton steps on the equations, with the causes' priors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import Setting, Site
from vsalog.diagnosis.discrepancy import Weights
from vsalog.diagnosis.linear import (
    Linear,
    Placed,
    Unknowns,
    Variant,
    candidates_of,
    carried,
    formed_of,
    linearised,
    variants_of,
    with_unknowns,
)
from vsalog.diagnosis.subsets import Candidates, precisions, within
from vsalog.residuals.system import System

Array = NDArray[np.float64]

# Steps after which an iteration is given up [1]: that of a fit, of a search, and of what makes one of their steps smaller.
ITERATIONS = 12
# Gain in deviance below which a fit ends [1]: far below the price of a cause.
NEGLIGIBLE = 0.1


@dataclass(frozen=True, slots=True)
class Problem:
    """What a fit needs in addition to its causes.

    Attributes
    ----------
    joint : of the rig, without any cause
    setting : of the joint and its log
    stated : tolerances of the rig
    """

    joint: Any
    setting: Setting
    stated: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Posterior:
    """A set of causes at its most probable values.

    Attributes
    ----------
    fit : causes with their values
    score : negative log marginal likelihood, by Laplace's method
    linear : the equations, linearised about it in the numbers of its causes
    candidates : their normal equations
    simulated : shape (p, p), information of equations and simulated trajectories together; none where nothing was simulated
    """

    fit: tuple[tuple[Site, Array], ...]
    score: float
    linear: Linear
    candidates: Candidates
    simulated: Array | None = None

    @property
    def covariance(self) -> Array:
        """Return the covariance of all parameters, shape (p, p), in their units: that of the prior and the log together."""
        deviation = np.concatenate([v.deviation for v in self.linear.variants])
        information = np.diag(precisions(self.linear.now)) + self.candidates.information
        inside = np.linalg.inv(information if self.simulated is None else self.simulated)
        return np.asarray(inside * np.outer(deviation, deviation))

    @property
    def keys(self) -> frozenset[tuple[str, str]]:
        """Return causes and parts."""
        return frozenset(site.key for site, _ in self.fit)


def most_probable(problem: Problem, weights: Weights, start: Placed, steps: int = ITERATIONS) -> Posterior:
    """Fit a set of causes from initial values, in a limited number of steps; with none it stays there.

    The score is ½ (deviance + δᵀ Λ δ) + ½ log det(I + Λ⁻¹ A) − ½ log det Λ + Σ price, δ in units of the prior deviations and Λ of
    `subsets`.
    Steps keep the columns for as long as they gain (the chord method), and end where none gains with columns of its own.
    """
    fit, system = tuple(start), weights.system
    here = formed_of(system, problem.joint, fit)
    linear = _about(problem, system, fit, here)
    candidates = candidates_of(linear, system)
    now, damping, fresh = weights.deviance(here) + _surprise(linear.now), 0.0, True
    for _ in range(steps if fit else 0):
        H = np.diag(precisions(linear.now)) + candidates.information
        before, moved = now, False
        for _ in range(ITERATIONS if fresh else 1):
            damped, pull = H + damping * np.diag(np.diag(H)), candidates.score - H @ linear.now
            target = within(damped, pull, linear.now, candidates.low, candidates.high)
            if not np.isfinite(target).all():
                break
            trial = with_unknowns(linear.variants, target, limited=True)
            there = formed_of(system, problem.joint, trial)
            after = weights.deviance(there) + _surprise(_strengths(linear.variants, trial))
            if after <= now:
                fit, here, now, damping, moved = trial, there, after, 0.1 * damping, True
                break
            damping = max(10.0 * damping, 1e-3)
        small = before - now <= NEGLIGIBLE
        if fresh and (before - now <= 0.0 or small):
            linear = carried(linear, fit, here) if moved else linear
            candidates = candidates_of(linear, system)
            break
        fresh = small
        linear = _about(problem, system, fit, here) if fresh else carried(linear, fit, here)
        candidates = candidates_of(linear, system)
    H = np.diag(precisions(linear.now)) + candidates.information
    # The prior's own log λ is in the loss; the other is that of a prior so wide.
    wide = -0.5 * float(np.sum(np.log(precisions(_strengths(linear.variants, fit)))))
    score = 0.5 * now + 0.5 * float(np.linalg.slogdet(H)[1]) + wide + float(candidates.price.sum())
    return Posterior(fit, score, linear, candidates)


def _about(problem: Problem, system: System, fit: Placed, here: Array) -> Linear:
    variants = variants_of([site for site, _ in fit], problem.setting, None, fit, problem.stated)
    return linearised(system, problem.joint, fit, variants, here)


def _strengths(variants: tuple[Variant, ...], trial: Placed) -> Array:
    """Return how far a trial's strengths are from the rig, in units of their prior; a shape counts from where a step begins."""
    off = [
        (values[i] - v.rig[k]) / v.deviation[k]
        for v, (_, values) in zip(variants, trial, strict=True)
        for k, i in enumerate(v.free)
        if not v.site.parameters[i].shape
    ]
    return np.array(off)


def _surprise(unknowns: Array) -> float:
    """Return δᵀ Λ δ − log det Λ: what unknowns that far from the rig cost."""
    weight = precisions(unknowns)
    return float(np.sum(weight * unknowns**2 - np.log(weight)))


def begun_by(unknowns: Unknowns, candidates: Candidates, chosen: NDArray[np.bool_]) -> tuple[tuple[Site, Array], ...]:
    """Return the causes of a chosen set with the values that the linear model has for them."""
    own = [unknowns.variants[g] for g in np.flatnonzero(chosen)]
    return with_unknowns(own, candidates.solution(chosen)[candidates.unknowns(chosen)])
