"""The values of a set of causes, fitted once more to the simulated trajectories.

Equations look at 50 ms at a time; a simulation adds up for half a second, and a fine encoder sees at its end what no equation
shows. So the values that the equations give are the prior of a fit to the windows of the log: multiple shooting with every window's
beginning free (variable projection: what beginnings can make up for is taken off; Golub and Pereyra 2003, Inverse Problems 19).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.discrepancy import correlation_time
from vsalog.diagnosis.linear import Placed, placed
from vsalog.diagnosis.posterior import Posterior
from vsalog.diagnosis.windows import Shot, Windows, begun, by_states, in_runs, in_windows, shoot
from vsalog.errors import SimulationError

Array = NDArray[np.float64]

# So many windows are fitted, spread over the log, in so many steps; one that makes it worse is halved so often.
WINDOWS, STEPS, HALVINGS = 20, 8, 4
# Steps end where less than this is gained, in squares over noise.
ENOUGH = 1.0


def refined(joint: Any, posterior: Posterior, windows: Windows) -> Posterior:
    """Return a set of causes with the values that fit equations and trajectories best.

    Parameters
    ----------
    joint : of the rig, without the causes
    posterior : of the equations
    windows : of the log

    Raises
    ------
    SimulationError
        The joint with the causes cannot be simulated.
    """
    if not posterior.fit:
        return posterior
    windows = windows.part(in_runs(len(windows.spans), WINDOWS))
    fit = posterior.fit
    shot = begun(placed(joint, fit), windows)
    prior = _prior(posterior)
    away = np.zeros(prior.shape[0])
    information = np.zeros_like(prior)
    for _ in range(STEPS):
        weights = _weights(shot, windows)
        J = _by_values(joint, posterior, fit, windows, shot)
        bases = _bases(placed(joint, fit), windows, shot)
        J = np.stack([_projected(bases, J[..., k]) for k in range(J.shape[-1])], axis=-1)
        J = (J * weights[:, None]).reshape(-1, J.shape[-1])
        r = (_projected(bases, in_windows(shot, windows)) * weights).ravel()
        information = J.T @ J
        step = np.linalg.solve(prior + information, -J.T @ r - prior @ away)
        before, moved = _misfit(shot, windows, weights) + float(away @ prior @ away), False
        for _ in range(HALVINGS):
            trial = _with_values(posterior, away + step)
            try:
                there = begun(placed(joint, trial), windows, near=shot)
                after = _misfit(there, windows, weights) + float((away + step) @ prior @ (away + step))
            except SimulationError:
                after = np.inf
            if after < before:
                fit, shot, away, moved = trial, there, away + step, True
                break
            step = 0.5 * step
        if not moved or before - after < ENOUGH:
            break
    return replace(posterior, fit=fit, simulated=prior + information)


def _prior(posterior: Posterior) -> Array:
    """Return the information of the equations, no surer than filters let them be: they round corners and take off waves."""
    blur = []
    for (site, values), variant in zip(posterior.fit, posterior.linear.variants, strict=True):
        exact = catalogue()[site.cause].exact
        for k, i in enumerate(variant.free):
            p = site.parameters[i]
            blur.append(float(np.hypot(p.step if p.shape else exact * values[i], p.blur)) / variant.deviation[k])
    equations = np.linalg.inv(np.eye(len(blur)) + posterior.candidates.information)
    return np.asarray(np.linalg.inv(equations + np.diag(np.square(blur))))


def _weights(shot: Shot, windows: Windows) -> Array:
    """Return the square root of each error's weight, shape (L · roles,): noise or misfit, and how many samples count as one."""
    errors = in_windows(shot, windows).reshape(len(windows.spans), len(windows.roles), -1)
    squares = np.maximum(np.mean(errors**2, axis=(0, 2)), 1.0)
    times = np.array([np.mean([correlation_time(e) for e in errors[:, i]]) for i in range(len(windows.roles))])
    return np.repeat(1.0 / np.sqrt(squares * times), errors.shape[2])


def _misfit(shot: Shot, windows: Windows, weights: Array) -> float:
    return float(np.sum((in_windows(shot, windows) * weights) ** 2))


def _bases(joint: Any, windows: Windows, shot: Shot) -> list[Array]:
    """Return an orthonormal basis of what each window's beginning can make up for."""
    out = []
    for S in by_states(joint, windows, shot):
        U, s, _ = np.linalg.svd(S, full_matrices=False)
        out.append(U[:, s > 1e-8 * max(s.max(), 1e-300)])
    return out


def _projected(bases: Sequence[Array], errors: Array) -> Array:
    """Take what the beginnings can make up for off the windows' errors, shape (W, L · roles)."""
    return np.stack([e - U @ (U.T @ e) for U, e in zip(bases, errors, strict=True)])


def _by_values(joint: Any, posterior: Posterior, fit: Placed, windows: Windows, shot: Shot) -> Array:
    """Return the change of the windows' errors with the causes' numbers in units of their prior, shape (W, L · roles, p)."""
    here = in_windows(shoot(placed(joint, fit), windows, shot.states), windows)
    columns = []
    for g, variant in enumerate(posterior.linear.variants):
        site, values = fit[g]
        for k, i in enumerate(variant.free):
            moved = values.copy()
            step = variant.moved[k, i] - variant.base[i]
            moved[i] += step
            changed = [*fit[:g], (site, moved), *fit[g + 1 :]]
            there = in_windows(shoot(placed(joint, changed), windows, shot.states), windows)
            columns.append((there - here) / (step / variant.deviation[k]))
    return np.stack(columns, axis=-1)


def _with_values(posterior: Posterior, away: Array) -> tuple[tuple[Site, Array], ...]:
    """Return the causes with their numbers so far from those of the equations, within their bounds."""
    out, j = [], 0
    for (site, values), variant in zip(posterior.fit, posterior.linear.variants, strict=True):
        moved = values.copy()
        for k, i in enumerate(variant.free):
            p = site.parameters[i]
            moved[i] = np.clip(values[i] + away[j] * variant.deviation[k], p.low, p.high)
            j += 1
        out.append((site, moved))
    return tuple(out)
