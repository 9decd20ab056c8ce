"""Causes fitted to the equations by plain least squares: for experiments that are only played, which have no model error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.residuals.system import System

Array = NDArray[np.float64]

ROUNDS, ENOUGH = 12, 1e-4
# Directions that the log says nothing of, as parts of the strongest one, are not followed.
RANK = 1e-9
# Values come from units of their priors: one at a bound may be short of it by this part of itself, the rounding of numbers a
# thousand times larger.
ROUNDING = 1e-12


def driven_out(parameters: Sequence[Parameter], values: Array) -> bool:
    """Tell whether all numbers of a cause, or one with hard bounds, have been driven as far as they may go.

    Nothing is no bound: a friction of 0 is one that is not there.
    """
    near = [(p, v, ROUNDING * abs(v)) for p, v in zip(parameters, values, strict=True)]
    out = [(p.low != 0.0 and v <= p.low + e) or v >= p.high - e for p, v, e in near]
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


def jacobian_of(system: System, joint: Any, sites: Sequence[Site], values: Array, residual: Array) -> Array:
    """Return the change of the whitened equations with values, shape (n, p)."""
    parameters = parameters_of(sites)
    out = np.empty((residual.size, len(parameters)))
    for i, parameter in enumerate(parameters):
        step = -parameter.step if values[i] + parameter.step > parameter.high else parameter.step
        moved = values.copy()
        moved[i] += step
        out[:, i] = (residual_of(system, joint, sites, moved) - residual) / step
    return out


def fitted(system: System, joint: Any, sites: Sequence[Site], start: Array) -> tuple[Array, Array]:
    """Fit causes together by damped Gauss–Newton steps within the parameters' bounds.

    Parameters
    ----------
    system : of the log
    joint : of the rig, without the causes
    sites : to fit
    start : values to begin with

    Returns
    -------
    Values, shape (p,), and whitened equations with them, shape (n,)
    """
    parameters = parameters_of(sites)
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    reach = np.array([p.reach for p in parameters])
    values = np.clip(np.asarray(start, dtype=np.float64), low, high)
    residual = residual_of(system, joint, sites, values)
    loss, damping = float(residual @ residual), 0.0
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
    return values, residual


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
