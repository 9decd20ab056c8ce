"""Causes and their values, compared with the simulated trajectories.

Equations look at 50 ms at a time; a simulation adds up for half a second, and a fine encoder shows at its end what no equation
shows. So the values that the equations give are the prior of a fit to windows of the log: multiple shooting with the beginning of
every window free (variable projection: what beginnings can compensate is projected out; Golub and Pereyra 2003, Inverse Problems
19). Where the trajectories are off by more than their noise all the same, sets of causes are searched once more, with what
equations and trajectories determine together; a set that brings the trajectories to their noise is taken.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.correlation import correlation_time
from vsalog.core.errors import SimulationError
from vsalog.core.progress import counted
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.gain import PARTS
from vsalog.diagnosis.linear import Placed, Variant, columns_of, placed, with_unknowns
from vsalog.diagnosis.posterior import ITERATIONS, Posterior, begun_by, most_probable
from vsalog.diagnosis.selection import (
    APART,
    SETTLED,
    Choice,
    Selection,
    choices_of,
    established,
    fitted,
    simpler_sets,
    sites_in,
    stage_about,
)
from vsalog.diagnosis.subsets import Ranked, best_sets, precisions
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.residuals.sensing import is_commanded
from vsalog.residuals.windows import WITHIN, Shot, Windows, begun, by_states, in_runs, in_windows, player_of, shoot
from vsalog.residuals.windows_bench import BenchPlayer

Array = NDArray[np.float64]


def refined(selection: Selection, windows: Windows) -> Selection:
    """Return a selection whose causes and values fit equations and trajectories best.

    Parameters
    ----------
    selection : by the equations
    windows : of the log, with their noise

    Raises
    ------
    SimulationError
        The joint with the causes cannot be simulated.
    """
    # Where nothing has a beginning nothing is added up: a simulation repeats what equations determine from the same samples.
    if isinstance(player_of(selection.problem.joint, windows.channels), BenchPlayer):
        return selection
    windows = windows.part(in_runs(len(windows.spans), PARTS))
    best, shot, J = _fitted(selection, windows)
    # A cause that trajectories drive as far as it may go imitates something else: they do not determine it.
    if not shot.is_linear or _at_bounds(best):
        return selection
    # Where equations do not close, trajectories mostly cannot either; then they determine nothing that is not in the equations.
    loop = is_commanded(selection.problem.joint, windows.channels.raw)
    if loop and np.max(_squares(shot, windows)) > WITHIN:
        by_loop = _by_loop(selection, windows)
        if np.max(_squares(by_loop[1], windows)) < np.max(_squares(shot, windows)):
            best, shot, J = by_loop
    far = np.max(np.diag(selection.weights.inflation)) > WITHIN**2 and np.max(_squares(shot, windows)) > WITHIN
    if far and not loop:
        return selection
    best, shot, J = _simplified(best, windows, shot, J)
    for _ in counted("trajectories", range(ITERATIONS), at_most=True):
        if np.max(_squares(shot, windows)) <= WITHIN:
            break
        other = _searched(best, windows, shot)
        if other is None:
            break
        try:
            other, there, changes = _fitted(other, windows)
        except SimulationError:
            break
        # What takes away a part of an error only may be anything, where windows are short enough for much to look alike.
        most = float(np.max(_squares(shot, windows))) if loop else WITHIN
        if not there.is_linear or np.max(_squares(there, windows)) > most or _at_bounds(other):
            break
        best, shot, J = other, there, changes
    return replace(best, choices=_as_seen(best, windows, J)) if best.posterior.fit else best


def _by_loop(selection: Selection, windows: Windows) -> tuple[Selection, Shot, Array]:
    """Search sets of causes by the trajectories alone, beginning with the original rig.

    A loop that is commanded a position does not drift: its simulation over many seconds determines causes as equations do from
    their own samples, without derivatives of what a slow log hardly shows.
    """
    problem = selection.problem
    here = replace(selection, posterior=most_probable(problem, selection.weights, ()))
    here, shot, J = _fitted(here, windows)
    for _ in counted("trajectories", range(ITERATIONS), at_most=True):
        if np.max(_squares(shot, windows)) <= WITHIN:
            break
        other = _searched(here, windows, shot, equations=False)
        if other is None:
            break
        try:
            other, there, changes = _fitted(other, windows)
        except SimulationError:
            break
        if _at_bounds(other) or np.max(_squares(there, windows)) >= np.max(_squares(shot, windows)):
            break
        here, shot, J = other, there, changes
    return here, shot, J


def _at_bounds(selection: Selection) -> bool:
    return any(site.driven_out(values) for site, values in selection.posterior.fit)


def _fitted(selection: Selection, windows: Windows) -> tuple[Selection, Shot, Array]:
    """Fit the values of a selection's causes; return their trajectories, too, and what the values change in them.

    Where most windows do not respond linearly to their initial states, as with much sticking, the values stay as they are.
    """
    joint, posterior = selection.problem.joint, selection.posterior
    fit = posterior.fit
    shot = begun(placed(joint, fit), windows)
    if not fit or not shot.is_linear:
        return selection, shot, np.zeros((len(windows.spans), 0, 0))
    loop = is_commanded(joint, windows.channels.raw)
    prior = _prior(posterior, loop)
    # One term is how far the values are from those of the equations, the other how far from the rig's.
    now = posterior.linear.now if loop else np.zeros(prior.shape[0])
    away, information, columns = np.zeros(prior.shape[0]), np.zeros_like(prior), np.zeros(0)
    for _ in counted("trajectories", range(ITERATIONS), at_most=True):
        weights = weights_of(shot, windows)
        slopes = by_states(placed(joint, fit), windows, shot)
        bases = bases_of(slopes)
        columns = _by_values(joint, _at(posterior.linear.variants, fit), fit, windows, shot, bases)
        J = (columns * weights[:, None]).reshape(-1, columns.shape[-1])
        r = (projected(bases, in_windows(shot, windows)) * weights).ravel()
        information = J.T @ J
        step = np.linalg.solve(prior + information, -J.T @ r - prior @ (now + away))
        before, moved, after = (
            _misfit(shot, windows, weights) + float((now + away) @ prior @ (now + away)),
            False,
            np.inf,
        )
        for _ in range(ITERATIONS):
            trial = with_unknowns(posterior.linear.variants, posterior.linear.now + away + step)
            try:
                there = begun(placed(joint, trial), windows, near=shot, slopes=slopes)
                after = _misfit(there, windows, weights) + float((now + away + step) @ prior @ (now + away + step))
            except SimulationError:
                after = np.inf
            if after < before:
                fit, shot, away, moved = trial, there, away + step, True
                break
            step = 0.5 * step
        # Weights follow the misfit: while that falls, the next step has more weight.
        if not moved or before - after < min(SETTLED, NEGLIGIBLE_SHARE * before):
            break
    return replace(selection, posterior=replace(posterior, fit=fit, simulated=prior + information)), shot, columns


def _simplified(selection: Selection, windows: Windows, shot: Shot, J: Array) -> tuple[Selection, Shot, Array]:
    """Exchange causes that filters round for simpler ones of their family where trajectories are about as probable with these."""
    problem, blocks, weights = selection.problem, selection.blocks, weights_of(shot, windows)
    for site, _ in selection.posterior.fit:
        if not any(p.rounded for p in site.parameters):
            continue
        sets = simpler_sets(selection.stage.unknowns.variants, selection.posterior.fit, site)
        if not sets:
            continue
        posterior = min((fitted(problem, selection.stage, s) for s in sets), key=lambda p: p.score)
        sites = [s for s in sites_in(selection.stage) if s.key != site.key]
        stage = stage_about(problem, selection.system, sites, posterior.fit, blocks, selection.system.hold)
        simpler = established(problem, stage, sites, most_probable(problem, stage.weights, posterior.fit), blocks)
        simpler = replace(selection, stage=simpler.stage, posterior=simpler.posterior, choices=simpler.choices)
        try:
            other, there, changes = _fitted(simpler, windows)
        except SimulationError:
            continue
        if there.is_linear and 0.5 * (_misfit(there, windows, weights) - _misfit(shot, windows, weights)) < APART:
            return other, there, changes
    return selection, shot, J


def _searched(selection: Selection, windows: Windows, shot: Shot, equations: bool = True) -> Selection | None:
    """Search sets of causes by equations and trajectories together, or by these alone; none where the best set stays as it is."""
    problem, fit, blocks = selection.problem, selection.posterior.fit, selection.blocks
    sites = sites_in(selection.stage)
    stage = stage_about(problem, selection.system, sites, fit, blocks, selection.system.hold)
    variants, weights = stage.unknowns.variants, weights_of(shot, windows)
    bases = bases_of(by_states(placed(problem.joint, fit), windows, shot))
    J = _by_values(problem.joint, variants, fit, windows, shot, bases)
    J = (J * weights[:, None]).reshape(-1, J.shape[-1])
    r = (projected(bases, in_windows(shot, windows)) * weights).ravel() - J @ stage.unknowns.now
    both = replace(
        stage.candidates,
        information=J.T @ J + (stage.candidates.information if equations else 0.0),
        score=-J.T @ r + (stage.candidates.score if equations else 0.0),
    )
    now = np.array([v.inside for v in variants], dtype=np.bool_)
    found = best_sets(both, [now])[0]
    if found.score > both.scored(now) - APART:
        return None
    start = begun_by(stage.unknowns, both, found.chosen)
    posterior = fitted(problem, stage, start) if equations else most_probable(problem, stage.weights, start, steps=0)
    stage = stage_about(problem, stage.system, sites, posterior.fit, blocks, stage.system.hold)
    choices = choices_of(problem, stage, both, Ranked(found.chosen, found.score), variants, posterior)
    return replace(selection, stage=stage, posterior=posterior, choices=tuple(choices))


def _as_seen(selection: Selection, windows: Windows, J: Array) -> tuple[Choice, ...]:
    """Return a selection's causes with their sizes in the trajectories where these are larger than in the equations.

    The unit is what makes a trajectory, together with its noise, as much off as a simulation may be. J is of `_by_values`.
    """
    posterior = selection.posterior
    fit = posterior.fit
    first, shape = posterior.linear.first, (len(windows.spans), len(windows.roles), -1)
    sizes = {}
    for g, (site, values) in enumerate(fit):
        variant, own = posterior.linear.variants[g], np.arange(first[g], first[g + 1])
        strength = (values[list(variant.free)] - variant.rig) / variant.deviation
        effect = (J[..., own] @ strength).ravel()
        others = np.delete(J, own, axis=-1).reshape(effect.size, -1)
        left = effect - others @ np.linalg.lstsq(others, effect, rcond=1e-9)[0] if others.size else effect
        squares = np.mean(left.reshape(shape) ** 2, axis=(0, 2))
        sizes[site.key] = float(np.sqrt(np.max(squares) / (WITHIN**2 - 1.0)))
    out = []
    for choice in selection.choices:
        size, unit = max(sizes[choice.site.key], choice.size), choice.size or 1.0
        over = choice.over_model_error if choice.size else 1.0
        out.append(replace(choice, size=size, over_model_error=over * size / unit))
    return tuple(out)


def _prior(posterior: Posterior, loop: bool) -> Array:
    """Return the information of the equations, no more certain than filters allow: they round corners and attenuate waves.

    Of a loop that is commanded a position they determine nothing that its simulation over many seconds does not determine better.
    """
    if loop:
        return np.asarray(np.diag(precisions(posterior.linear.now)))
    blur = []
    for (site, values), variant in zip(posterior.fit, posterior.linear.variants, strict=True):
        exact = catalogue()[site.cause].exact if site.named else 0.0
        for k, i in enumerate(variant.free):
            p = site.parameters[i]
            equation = max(p.step if p.shape else exact * abs(values[i]), p.rounded * abs(values[i]))
            blur.append(float(np.hypot(equation, p.blur)) / variant.deviation[k])
    equations = np.linalg.inv(np.diag(precisions(posterior.linear.now)) + posterior.candidates.information)
    return np.asarray(np.linalg.inv(equations + np.diag(np.square(blur))))


def _squares(shot: Shot, windows: Windows) -> Array:
    """Return the mean square of each role's errors over their noise, shape (roles,)."""
    return np.asarray(np.mean(_by_role(shot, windows) ** 2, axis=(0, 2)))


def _by_role(shot: Shot, windows: Windows) -> Array:
    return in_windows(shot, windows).reshape(len(windows.spans), len(windows.roles), -1)


def weights_of(shot: Shot, windows: Windows) -> Array:
    """Return the square root of each error's weight, shape (L · roles,): noise or misfit, and how many samples count as one."""
    errors = _by_role(shot, windows)
    squares = np.maximum(_squares(shot, windows), 1.0)
    times = np.array([np.mean([correlation_time(e) for e in errors[:, i]]) for i in range(len(windows.roles))])
    return np.repeat(1.0 / np.sqrt(squares * times), errors.shape[2])


def _misfit(shot: Shot, windows: Windows, weights: Array) -> float:
    return float(np.sum((in_windows(shot, windows) * weights) ** 2))


def bases_of(slopes: Array) -> list[Array]:
    """Return an orthonormal basis of what each window's beginning can compensate, from `by_states`."""
    out = []
    for S in slopes:
        U, s, _ = np.linalg.svd(S, full_matrices=False)
        out.append(U[:, s > 1e-8 * max(s.max(), 1e-300)])
    return out


def projected(bases: Sequence[Array], errors: Array) -> Array:
    """Project what beginnings can compensate out of the windows' errors, shape (W, L · roles), or of their changes, (…, p)."""
    return np.stack([e - U @ (U.T @ e) for U, e in zip(bases, errors, strict=True)])


def _at(variants: Sequence[Variant], fit: Placed) -> list[Variant]:
    """Return the variants of a fit's own causes with its values."""
    return [
        replace(v, base=values, moved=values + (v.moved - v.base)) for v, (_, values) in zip(variants, fit, strict=True)
    ]


def _by_values(
    joint: Any, variants: Sequence[Variant], fit: Placed, windows: Windows, shot: Shot, bases: Sequence[Array]
) -> Array:
    """Return the change of the windows' errors with all unknowns in units of their prior, shape (W, L · roles, p)."""

    def errors(causes: Placed) -> Array:
        try:
            return in_windows(shoot(placed(joint, causes), windows, shot.states), windows)
        except SimulationError:
            return np.full_like(here, np.nan)

    here = in_windows(shoot(placed(joint, fit), windows, shot.states), windows)
    # Compiled simulations leave the interpreter to one another.
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        columns, *_ = columns_of(
            joint, fit, variants, here, errors, lambda site: np.zeros((*here.shape, len(site.parameters))), pool.map
        )
    return projected(bases, columns)
