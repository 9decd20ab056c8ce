"""Causes fitted to the stacked equations, and what each block of the log would have said of a fit made without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.system import System

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

ROUNDS, ENOUGH = 12, 1e-4
# Directions that the log says nothing of, as parts of the strongest one, are not followed.
RANK = 1e-9
# A block without which a number is so many times less sure is the only one that tells it.
UNTOLD = 100.0


@dataclass(frozen=True, slots=True)
class Fit:
    """Causes with the values that explain a log best.

    Attributes
    ----------
    sites : the causes
    values : of all their parameters, one after another
    residual : shape (n,), whitened equations that are left over
    jacobian : shape (n, p), their change with the values
    losses : shape (B,), Σ of squares in each block when the values are fitted to the others, but for those of what happens once
    """

    sites: tuple[Site, ...]
    values: Array
    residual: Array
    jacobian: Array
    losses: Array

    @property
    def loss(self) -> float:
        """Σ of squares over all blocks, each predicted by the others."""
        return float(self.losses.sum())

    @property
    def at_a_wall(self) -> bool:
        """Whether a cause has been driven as far as it may go: what it stands for is then something else.

        Of several numbers all have to be there, but for those with hard bounds. Nothing is no wall: a friction of 0 is one
        that is not there.
        """
        return any(driven_out(site.parameters, self.own(site)) for site in self.sites)

    def own(self, site: Site) -> Array:
        """Return the values of one cause."""
        return self.values[self._part(site)]

    def columns(self, site: Site) -> Array:
        """Return the change of the whitened equations with the values of one cause, shape (n, own p)."""
        return self.jacobian[:, self._part(site)]

    def _part(self, site: Site) -> slice:
        first = 0
        for other in self.sites:
            if other.key == site.key:
                return slice(first, first + len(other.parameters))
            first += len(other.parameters)
        raise KeyError(site.key)

    def joint(self, joint: Any) -> Any:
        """Return a joint with the causes in it."""
        return applied(joint, self.sites, self.values)


def driven_out(parameters: Sequence[Parameter], values: Array) -> bool:
    """Tell whether all numbers of a cause, or one with hard bounds, have been driven as far as they may go."""
    out = [(p.low != 0.0 and v <= p.low) or v >= p.high for p, v in zip(parameters, values, strict=True)]
    return all(out) or any(o and p.hard for o, p in zip(out, parameters, strict=True))


def applied(joint: Any, sites: Sequence[Site], values: Array) -> Any:
    """Return a joint with causes put in."""
    first = 0
    for site in sites:
        count = len(site.parameters)
        joint = site.apply(joint, values[first : first + count].tolist())
        first += count
    return joint


def parameters_of(sites: Sequence[Site]) -> list[Parameter]:
    """Return the parameters of causes, one after another."""
    return [p for site in sites for p in site.parameters]


def residual_of(system: System, joint: Any, sites: Sequence[Site], values: Array) -> Array:
    """Return the whitened equations with causes put in, shape (n,)."""
    return system.whitened(applied(joint, sites, values)).ravel()


def jacobian_of(
    system: System,
    joint: Any,
    sites: Sequence[Site],
    values: Array,
    residual: Array,
    columns: Sequence[int] | None = None,
) -> Array:
    """Return the change of the whitened equations with values, shape (n, p), or of some columns."""
    parameters = parameters_of(sites)
    wanted = range(len(parameters)) if columns is None else columns
    out = np.empty((residual.size, len(wanted)))
    for k, i in enumerate(wanted):
        step = parameters[i].step
        if values[i] + step > parameters[i].high:
            step = -step
        moved = values.copy()
        moved[i] += step
        out[:, k] = (residual_of(system, joint, sites, moved) - residual) / step
    return out


def fitted(system: System, joint: Any, sites: Sequence[Site], start: Array, blocks: Integers) -> Fit:
    """Fit causes together by damped Gauss–Newton steps within the parameters' bounds.

    Parameters
    ----------
    system : of the log
    joint : of the rig, without the causes
    sites : to fit
    start : values to begin with
    blocks : shape (n,), the block of each whitened equation
    """
    parameters = parameters_of(sites)
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    reach = np.array([p.reach for p in parameters])
    values = np.clip(np.asarray(start, dtype=np.float64), low, high)
    residual = residual_of(system, joint, sites, values)
    loss, damping = float(residual @ residual), 0.0
    jacobian = np.zeros((residual.size, len(parameters)))
    for _ in range(ROUNDS if parameters else 0):
        jacobian = jacobian_of(system, joint, sites, values, residual)
        before = loss
        for _ in range(6):
            step = np.clip(newton_step(jacobian, residual, values, low, high, damping), -reach, reach)
            trial = np.clip(values + step, low, high)
            left = residual_of(system, joint, sites, trial)
            if float(left @ left) <= loss:
                values, residual, loss = trial, left, float(left @ left)
                damping *= 0.1
                break
            damping = max(10.0 * damping, 1e-3)
        if before - loss <= ENOUGH * before:
            break
    return _as_fit(sites, values, residual, jacobian, blocks)


def fit_at(system: System, joint: Any, sites: Sequence[Site], values: Array, blocks: Integers) -> Fit:
    """Return the fit that given values are."""
    residual = residual_of(system, joint, sites, values)
    return _as_fit(sites, values, residual, jacobian_of(system, joint, sites, values, residual), blocks)


def _as_fit(sites: Sequence[Site], values: Array, residual: Array, jacobian: Array, blocks: Integers) -> Fit:
    # What happens once says nothing of other blocks, nor they of it: it stays as it is when one is left out.
    lasting = np.array([not site.transient for site in sites for _ in site.parameters], dtype=np.bool_)
    losses = block_losses(jacobian[:, lasting], residual, blocks)
    return Fit(tuple(sites), values, residual, jacobian, losses)


def newton_step(J: Array, r: Array, values: Array, low: Array, high: Array, damping: float) -> Array:
    """Return the step towards the least sum of squares; what would leave its bounds stays where it is."""
    free = np.ones(values.size, dtype=np.bool_)
    step = np.zeros(values.size)
    for _ in range(values.size + 1):
        step[:] = 0.0
        if not free.any():
            break
        step[free] = -solved(J[:, free].T @ J[:, free], J[:, free].T @ r, damping)
        leaving = free & (((values <= low) & (step < 0.0)) | ((values >= high) & (step > 0.0)))
        if not leaving.any():
            break
        free &= ~leaving
    return step


def solved(A: Array, b: Array, damping: float = 0.0) -> Array:
    """Solve A x = b of normal equations, in scaled unknowns; directions without information stay at zero."""
    scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    good = values > RANK * max(values.max(), 1e-300)
    inverse = np.where(good, 1.0 / np.where(good, values + damping, 1.0), 0.0)
    return np.asarray(vectors @ (inverse * (vectors.T @ (b / scale))) / scale)


def block_losses(J: Array, r: Array, blocks: Integers) -> Array:
    """Return each block's Σ of squares for values fitted to the other blocks, by one Newton step from the fit to all.

    With A_b = J_bᵀJ_b and g_b = J_bᵀr_b the values without block b are off by δ = (A − A_b)⁻¹ (g_b − g), and what is left
    over in it becomes r_b + J_b δ.
    """
    count = int(blocks[-1]) + 1
    squares: Array = np.bincount(blocks, r * r, minlength=count).astype(np.float64)
    if J.shape[1] == 0:
        return squares
    edges = np.searchsorted(blocks, np.arange(count + 1))
    A = np.stack([J[a:b].T @ J[a:b] for a, b in pairwise(edges)])
    g = np.stack([J[a:b].T @ r[a:b] for a, b in pairwise(edges)])
    whole, pull = A.sum(axis=0), g.sum(axis=0)
    out = np.empty(count)
    for b in range(count):
        delta = solved(whole - A[b], g[b] - pull)
        out[b] = squares[b] + 2.0 * delta @ g[b] + delta @ A[b] @ delta
    return out


def covariance_of(fit: Fit, blocks: Integers) -> Array:
    """Return the covariance of fitted values, from how much the blocks pull apart.

    The blocks, not the samples, are what is independent: (JᵀJ)⁻¹ (Σ g_b g_bᵀ) (JᵀJ)⁻¹ with the blocks' gradients g_b. Blocks are
    few, and each has pulled the fit its own way: where leaving them out one by one (the jackknife) moves a value by more, that
    counts; and the whole is as wide as Student's t makes the 95 % interval of so many blocks (Cameron and Miller 2015, §VI).
    """
    J, r = fit.jacobian, fit.residual
    count = int(blocks[-1]) + 1
    edges = np.searchsorted(blocks, np.arange(count + 1))
    g = np.stack([J[a:b].T @ r[a:b] for a, b in pairwise(edges)])
    g = g - g.mean(axis=0)
    A = J.T @ J
    meat = g.T @ g * count / max(count - 1, 1)
    inverse = np.stack([solved(A, e) for e in np.eye(A.shape[0])], axis=-1) if A.size else A
    plain = np.asarray(inverse @ meat @ inverse)
    if not A.size or count < 3:
        return plain
    moved = np.stack([solved(A - J[a:b].T @ J[a:b], own) for (a, b), own in zip(pairwise(edges), g, strict=True)])
    with np.errstate(over="ignore"):
        jackknife = (count - 1) / count * np.sum(moved**2, axis=0)
    variance = np.diag(plain)
    wider = np.sqrt(np.divide(jackknife, variance, out=np.ones_like(variance), where=variance > 0.0))
    # What happens within one block cannot be told without it: there the jackknife says nothing.
    wider = np.where(wider < UNTOLD, np.maximum(wider, 1.0), 1.0)
    student = float(special.stdtrit(count - 1, 0.975) / special.ndtri(0.975))
    return np.asarray(plain * np.outer(wider, wider) * student**2)
