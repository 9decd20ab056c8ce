"""Causes that the equations do not show and a simulation of half a second does.

Where the deflection is told from a torque sensor, its noise is that of the sensor over the spring's stiffness, and the equations,
which look at 50 ms at a time, drown in it. A simulation adds up: what a cause does within a window is held against the fine
encoders at its end. So where the equations close and the simulation does not, the causes are fitted to the windows themselves,
with every window's beginning free (variable projection: what beginnings can make up for is taken off first).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Remainder, Site
from vsalog.diagnosis.fit import Fit, applied, block_losses, covariance_of, driven_out, newton_step
from vsalog.diagnosis.selection import ALIKE, NEAR, WORTH, Choice, Rival, related, spread_of, sureness_of
from vsalog.diagnosis.windows import Shot, Windows, begun, by_states, in_windows, shoot
from vsalog.errors import SimulationError

Array = NDArray[np.float64]

# So many windows are looked at, and so many of them for the first step with each cause; so many causes are then fitted in full
# in so many rounds; a step that makes it worse is halved so often.
WINDOWS, FIRST, FITTED, ROUNDS, HALVED = 20, 8, 4, 8, 3
# Rounds end when less than this part is gained, or than the second where more is left than so many times what noise makes. When
# a cause leaves no more than noise, others are looked at if their first step has promised as much, but for this factor.
ENOUGH, FAST, FAR = 0.01, 0.2, 10.0
NOISE, AS_MUCH = 2.0, 1.1
# A cause must take this part off what is wrong beyond noise.
SHARE = 0.7


@dataclass(frozen=True, slots=True)
class Seen:
    """A cause that the simulation shows.

    Attributes
    ----------
    choice : with the windows' losses
    values, covariance : as fitted to the windows
    hold : whether the recorded torques then seem to act from sample to sample
    removed : part of what was wrong with the windows, beyond noise, that it takes away
    """

    choice: Choice
    values: Array
    covariance: Array
    hold: bool
    removed: float


def sought(joint: Any, sites: Sequence[Site], left: Remainder, windows: Windows, shot: Shot) -> Seen | None:
    """Find the cause that makes the simulation of the windows right.

    Parameters
    ----------
    joint : of the rig
    sites : of the catalogue
    left : what is left over in the equations
    windows : of the log, weighed by their noise
    shot : their simulation with the joint, from the states that fit them best

    Returns
    -------
    None where no cause is worth it
    """
    part, base = _few(windows, shot, WINDOWS)
    before = np.sum(in_windows(base, part) ** 2, axis=1)
    wrong = float(before.sum()) - in_windows(base, part).size
    few, begun_few = _few(part, base, FIRST)
    bases = _bases(joint, few, begun_few)
    unchanged = in_windows(shoot(joint, few, begun_few.states), few)

    def tried(site: Site) -> tuple[Site, float, Array] | None:
        starts, here = ([site.start], unchanged) if site.starts is None else (site.starts(left), None)
        steps = [s for s in (_step(joint, site, np.array(start), few, begun_few, bases, here) for start in starts) if s]
        return (site, *min(steps, key=lambda s: s[0])) if steps else None

    # Compiled simulations leave the interpreter to one another.
    with ThreadPoolExecutor(os.cpu_count() or 1) as beside:
        trials = sorted(filter(None, beside.map(tried, sites)), key=lambda t: t[1])
    worthy, last = list[Rival](), np.inf
    for site, promised, values in trials[:FITTED]:
        if promised > last:
            break
        try:
            fit = _fitted(joint, site, values, part, base)
        except SimulationError:  # it led to where a small change diverges
            continue
        if fit is None or float(before.sum()) - fit.loss <= SHARE * wrong:
            continue
        worthy.append(Rival(site, fit))
        if fit.loss <= NOISE * fit.residual.size:
            last = AS_MUCH * promised
    if not worthy:
        return None
    best = min(worthy, key=lambda r: r.fit.loss)
    alike = [r for r in worthy if r is best or _alike(r.fit, best.fit)]
    simplest = min(alike, key=lambda r: (len(r.site.parameters), catalogue()[r.site.cause].order, r.fit.loss))
    others = tuple(r for r in alike if r is not simplest and not related(r.site, simplest.site))
    fit, hold = _held_or_not(joint, simplest, part, base)
    choice = Choice(simplest.site, before, fit.losses, others, sureness_of(simplest, worthy))
    removed = (float(before.sum()) - fit.loss) / wrong
    return Seen(choice, fit.values, covariance_of(fit, _blocks(part)), hold, min(removed, 1.0))


def _few(windows: Windows, shot: Shot, most: int) -> tuple[Windows, Shot]:
    """Return some windows, spread evenly, and their simulation."""
    count = len(windows.spans)
    some = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))
    return windows.part(some), Shot(shot.states[some], shot.errors)


def _held_or_not(joint: Any, found: Rival, windows: Windows, base: Shot) -> tuple[Fit, bool]:
    """Return the fit to torques that are held, or to such that are not, whichever fits better, and whether they are held.

    The equations told it without the cause, and half a sample is much of a delay.
    """
    if found.fit.loss <= NOISE * found.fit.residual.size:
        return found.fit, windows.hold
    other = replace(windows, hold=not windows.hold)
    try:
        fit = _fitted(joint, found.site, found.fit.values, other, begun(joint, other, near=base))
    except SimulationError:
        fit = None
    if fit is None or fit.loss >= found.fit.loss:
        return found.fit, windows.hold
    return fit, other.hold


def _alike(one: Fit, best: Fit) -> bool:
    off, noise = one.loss - best.loss, WORTH * one.residual.size
    return off < min(NEAR * best.loss + noise, max(ALIKE * spread_of(one.losses - best.losses), 0.2 * noise))


def _bases(joint: Any, windows: Windows, shot: Shot) -> list[Array]:
    """Return an orthonormal basis of what each window's beginning can make up for."""
    out = []
    for S in by_states(joint, windows, shot):
        U, s, _ = np.linalg.svd(S, full_matrices=False)
        out.append(U[:, s > 1e-8 * max(s.max(), 1e-300)])
    return out


def _projected(bases: Sequence[Array], errors: Array) -> Array:
    """Take what the beginnings can make up for off the windows' errors, shape (W, L·roles); return them in a row."""
    return np.concatenate([e - U @ (U.T @ e) for U, e in zip(bases, errors, strict=True)])


def _blocks(windows: Windows) -> NDArray[np.int64]:
    lengths = (windows.spans[:, 1] - windows.spans[:, 0]) * len(windows.roles)
    return np.repeat(np.arange(lengths.size), lengths)


def _linear(
    joint: Any,
    site: Site,
    values: Array,
    windows: Windows,
    shot: Shot,
    bases: Sequence[Array],
    here: Array | None = None,
) -> tuple[Array, Array]:
    """Return the windows' errors, shape (n,), and their change with a cause's values, shape (n, p), beginnings left free.

    The errors as they are `here` need not be simulated again.
    """

    def errors(values: Array) -> Array:
        return in_windows(shoot(applied(joint, (site,), values), windows, shot.states), windows)

    here = errors(values) if here is None else here
    columns = []
    for i, parameter in enumerate(site.parameters):
        step = -parameter.step if values[i] + parameter.step > parameter.high else parameter.step
        moved = values.copy()
        moved[i] += step
        columns.append(_projected(bases, (errors(moved) - here) / step))
    return _projected(bases, here), np.stack(columns, axis=1)


def _towards(site: Site, values: Array, r: Array, J: Array) -> Array:
    low, high = np.array([p.low for p in site.parameters]), np.array([p.high for p in site.parameters])
    reach = np.array([p.reach for p in site.parameters])
    return np.clip(values + np.clip(newton_step(J, r, values, low, high, 0.0), -reach, reach), low, high)


def _step(
    joint: Any, site: Site, start: Array, windows: Windows, shot: Shot, bases: Sequence[Array], here: Array | None
) -> tuple[float, Array] | None:
    """Return what a first step promises to leave over, and where it leads; none where it cannot be simulated."""
    try:
        r, J = _linear(joint, site, start, windows, shot, bases, here)
    except SimulationError:
        return None
    if not (np.isfinite(r).all() and np.isfinite(J).all()):
        return None
    values = _towards(site, start, r, J)
    promised = r + J @ (values - start)
    return float(promised @ promised), values


def _fitted(joint: Any, site: Site, first: Array, windows: Windows, base: Shot) -> Fit | None:
    """Fit a cause to the windows, from where a first step led."""
    errors = in_windows(base, windows)
    values, shot, loss, size, aim = np.array(site.start), base, float(np.sum(errors**2)), errors.size, first
    for _ in range(ROUNDS):
        old = loss
        for _ in range(HALVED):
            try:
                trial = begun(applied(joint, (site,), aim), windows, near=shot)
            except SimulationError:
                trial = None
            squares = np.inf if trial is None else float(np.sum(in_windows(trial, windows) ** 2))
            if trial is not None and squares < loss:
                values, shot, loss = aim, trial, squares
                break
            aim = 0.5 * (aim + values)
        if old - loss <= (FAST if loss > FAR * size else ENOUGH) * old:
            break
        there = applied(joint, (site,), values)
        r, J = _linear(joint, site, values, windows, shot, _bases(there, windows, shot))
        aim = _towards(site, values, r, J)
    if shot is base or driven_out(site.parameters, values):
        return None
    r, J = _linear(joint, site, values, windows, shot, _bases(applied(joint, (site,), values), windows, shot))
    return Fit((site,), values, r, J, block_losses(J, r, _blocks(windows)))
