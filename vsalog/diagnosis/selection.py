"""Which causes: forward on held-out blocks, the simplest of those that explain as much, then a look back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Remainder, Setting, Site
from vsalog.diagnosis.fit import (
    Fit,
    fitted,
    jacobian_of,
    newton_step,
    parameters_of,
    residual_of,
)
from vsalog.diagnosis.sensing import true_roles
from vsalog.diagnosis.system import System, build_system

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# A block is at least so long [s]; a log has between so many.
BLOCK, FEWEST, MOST = 1.0, 8, 24
# A cause must take this much off the mean square of the whitened equations that it acts in (the noise's is 1), and this part of
# what is left in them; without the block that gains most it must still be worth that part of it. It acts in an equation where
# its effect is at least this part, in squares, of that in the equation where it is largest.
WORTH, SHARE, SURE, ACTS = 0.1, 0.08, 0.5, 0.01
# Of that it must be worth this part where what is left with it is weighed by the noise it leaves, which it gains by where that is
# less than this part of what it was; then so many are looked at beside their own noise.
OWN, QUIETER, BESIDE = 0.5, 0.9, 6
# Two causes explain equally much when they differ by no more than so many spreads of their difference over the blocks, and the
# one leaves no more over than this part more.
ALIKE, NEAR = 2.0, 0.3
# What happens once has to stand out by so much more, since it was looked for everywhere.
SEARCHED = 4.0
MOST_CAUSES = 4
# Torques are taken for held, as drives hold them, unless the equations close better with smooth ones by so many spreads of the
# difference over the blocks, and by this part of what a cause must be worth: beside a delay that is looked for the two are one.
CLEARLY, TOLD = 2.0, 0.3
# So many hypotheses are fitted in full after a first step with each.
FITTED, FAMILIES = 8, 3


@dataclass(frozen=True, slots=True)
class Rival:
    """A cause that was considered, and what it would have left over."""

    site: Site
    fit: Fit


@dataclass(frozen=True, slots=True)
class Choice:
    """A cause that was chosen.

    Attributes
    ----------
    site : of the catalogue
    before, after : losses of the blocks without and with it, all others fitted
    rivals : causes that would explain as much in its place
    sureness : how often it is the best one when the blocks are drawn anew, 0 to 1
    """

    site: Site
    before: Array
    after: Array
    rivals: tuple[Rival, ...]
    sureness: float


@dataclass(frozen=True, slots=True)
class Selection:
    """What explains a log.

    Attributes
    ----------
    system : with the noise as the chosen causes have it
    fit : of all chosen causes together
    nothing : of none
    choices : strongest first
    blocks : shape (n,), the block of each whitened equation
    """

    system: System
    fit: Fit
    nothing: Fit
    choices: tuple[Choice, ...]
    blocks: Integers


def select(system: System, joint: Any, setting: Setting, barred: frozenset[str] = frozenset()) -> Selection:
    """Find the causes that explain what the rig leaves over in a log.

    Parameters
    ----------
    system : of the log
    joint : of the rig
    setting : what causes may know
    barred : causes that cannot be told here
    """
    sites = sites_of(setting, barred)
    blocks = blocks_of(system)
    # Torques that only seem to be held would look like a delay.
    system, current = renewed(system, joint, fitted(system, joint, (), np.zeros(0), blocks), blocks)
    nothing = current
    choices = list[Choice]()
    met = set[frozenset[tuple[str, str]]]()
    while len(choices) < MOST_CAUSES:
        found = added(system, joint, current, considered(system, joint, setting, sites, current, blocks), blocks)
        if found is None:
            break
        choice, system, current = found
        choices.append(choice)
        nothing = fitted(system, joint, (), np.zeros(0), blocks)
        current, choices = settled(system, joint, setting, sites, current, choices, blocks)
        current, choices = looked_back(system, joint, setting, sites, current, choices, blocks)
        # Where nothing really fits, a look back may undo what was taken, and the search would go round in circles.
        together = frozenset(choice.site.key for choice in choices)
        if together in met:
            break
        met.add(together)
    return Selection(system, current, nothing, tuple(_by_worth(system, joint, current, choices, blocks)), blocks)


def sites_of(setting: Setting, barred: frozenset[str]) -> list[Site]:
    """Return all causes of the catalogue, wherever they may sit, but for those that are barred."""
    return [site for cause in catalogue().values() if cause.name not in barred for site in cause.sites(setting)]


def added(
    system: System, joint: Any, current: Fit, rivals: Sequence[Rival], blocks: Integers
) -> tuple[Choice, System, Fit] | None:
    """Return the best cause that is worth it also beside its own noise, with the noise as it is then, and the fit.

    What noise makes of the equations depends on what is in them, and so does how long torques seem to be held. Where a torque
    tells the deflection, a stiffer spring makes its noise small: such a fit leaves less, and explains nothing. So the next
    best are looked at too, each beside its own noise, until there is one that does not gain by that.
    """
    best, loss = None, np.inf
    for _ in range(BESIDE):
        found = chosen(system, current, rivals)
        if found is None:
            break
        choice, fit = found
        own, there = renewed(system, joint, fit, blocks)
        worth = OWN * least_worth(system, current, fit.columns(choice.site))
        if current.loss - there.loss > worth and there.loss < loss:
            best, loss = (choice, own, there), there.loss
        if not np.any(own.deviation < QUIETER * system.deviation):
            break
        rivals = [r for r in rivals if r.site.key != choice.site.key]
    return best


def renewed(system: System, joint: Any, current: Fit, blocks: Integers) -> tuple[System, Fit]:
    """Measure the noise anew with the causes in, for torques that are held and such that are not; return what fits better."""
    found = []
    for hold in (0.5 * system.channels.period / system.channels.every, 0.0):
        other = build_system(current.joint(joint), system.channels, system.balance, hold).on_rows_of(system)
        found.append((other, fitted(other, joint, current.sites, current.values, blocks)))
    held, smooth = found
    better = held[1].losses - smooth[1].losses
    least = max(CLEARLY * spread_of(better), TOLD * WORTH * system.centres.size)
    return smooth if better.sum() > least else held


def blocks_of(system: System) -> Integers:
    """Number the blocks of the whitened equations, shape (n,), rising."""
    time = system.time
    count = int(np.clip((time[-1] - time[0]) / BLOCK, FEWEST, MOST))
    rows = np.minimum((np.arange(time.size) * count) // max(time.size, 1), count - 1)
    return np.repeat(rows, len(system.names)).astype(np.int64)


def considered(
    system: System, joint: Any, setting: Setting, sites: Sequence[Site], current: Fit, blocks: Integers
) -> list[Rival]:
    """Fit each cause that is not in the current fit beside it; the promising ones in full."""
    held = {site.key for site in current.sites}
    barred = {(cause, site.part) for site in current.sites for cause in site.excludes}
    left = remainder(system, current.joint(joint), setting)
    trials = []
    for site in sites:
        if site.key in held or site.key in barred:
            continue
        starts = site.starts(left) if site.starts is not None else [site.start]
        tried = [_first_step(system, joint, current, site, start) for start in starts]
        if tried:
            trials.append((*min(tried, key=lambda t: t[0]), site))
    trials.sort(key=lambda t: t[0])
    if not trials:
        return []
    floor = float(current.residual @ current.residual)
    bar = trials[0][0] + 0.1 * (floor - trials[0][0])
    # What cannot become worth it is not fitted; the first step of what is not straight is given some credit.
    hopeful = [t for t in trials if floor - t[0] > (0.3 if t[3].starts is not None else 0.9) * t[2]]
    promising = [t for i, t in enumerate(hopeful) if i < FITTED or t[0] < bar][: 2 * FITTED]
    # One step tells little of what is far from straight: whoever is of the family of a promising one is fitted too.
    taken = {id(t) for t in promising}
    family = [t for t in trials if id(t) not in taken and any(related(t[3], p[3]) for p in promising[:FAMILIES])]
    return [
        Rival(site, fitted(system, joint, (*current.sites, site), start, blocks))
        for _, start, _, site in (*promising, *family)
    ]


def _first_step(
    system: System, joint: Any, current: Fit, site: Site, start: Sequence[float]
) -> tuple[float, Array, float]:
    """Return what one Newton step with a cause beside the current ones leaves over, where it leads, and what it must be worth."""
    sites = (*current.sites, site)
    values = np.concatenate([current.values, start])
    old = current.values.size
    residual = residual_of(system, joint, sites, values)
    own = jacobian_of(system, joint, sites, values, residual, range(old, values.size))
    J = np.concatenate([current.jacobian, own], axis=1)
    parameters = parameters_of(sites)
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    reach = np.array([p.reach for p in parameters])
    step = np.clip(newton_step(J, residual, values, low, high, 0.0), -reach, reach)
    predicted = residual + J @ step
    moved = np.clip(values + step, low, high)
    return float(predicted @ predicted), moved, least_worth(system, current, own)


def chosen(system: System, current: Fit, rivals: Sequence[Rival]) -> tuple[Choice, Fit] | None:
    """Return the best of the causes if it is worth it, with those that explain as much."""
    worthy = [r for r in rivals if _worthy(system, current, r)]
    if not worthy:
        return None
    best = min(worthy, key=_left)
    # The simpler of two of which one contains the other, unless the larger is worth its numbers.
    for smaller in sorted(worthy, key=lambda r: (len(r.site.parameters), _left(r))):
        if _contains(best.site, smaller.site) and not _worthy(system, smaller.fit, best):
            best = smaller
            break
    gained = current.loss - _left(best)
    alike = [r for r in worthy if r is best or (not related(r.site, best.site) and _alike(system, r, best, gained))]
    # Among equals the one with the fewest numbers, then the one that explains most.
    simplest = min(alike, key=lambda r: (len(r.site.parameters), catalogue()[r.site.cause].order, _left(r)))
    others = tuple(r for r in alike if r is not simplest and not related(r.site, simplest.site))
    choice = Choice(simplest.site, current.losses, simplest.fit.losses, others, sureness_of(simplest, worthy))
    return choice, simplest.fit


def _contains(larger: Site, smaller: Site) -> bool:
    """Tell whether one cause is the other and more, as Stribeck friction is Coulomb's."""
    return related(larger, smaller) and len(larger.parameters) > len(smaller.parameters)


def related(one: Site, other: Site) -> bool:
    """Tell whether two causes are of one family at one part, of which only one can be."""
    return one.part == other.part and (one.cause == other.cause or other.cause in one.excludes)


def _left(rival: Rival) -> float:
    """Return what a cause leaves over; what happens once cannot be told from the rest of the log."""
    if rival.site.transient:
        return float(rival.fit.residual @ rival.fit.residual)
    return rival.fit.loss


def least_worth(system: System, current: Fit, own: Array) -> float:
    """Return what a cause must take away to be believed, from its columns of the Jacobian, shape (n, p).

    It is asked for by the equations that the cause acts in: what is wrong with one small motor is not to be outweighed by the
    noise of all the other equations, which say nothing of it.
    """
    m = len(system.names)
    scale = np.maximum(np.linalg.norm(own, axis=0), 1e-300)
    effect = np.sum((own / scale).reshape(-1, m, own.shape[1]) ** 2, axis=(0, 2))
    acts = effect >= ACTS * effect.max() if effect.max() > 0.0 else np.ones(m, dtype=np.bool_)
    count = int(np.count_nonzero(system.weights[:, acts]))
    left = np.sum(current.residual.reshape(-1, m) ** 2, axis=0)
    part = float(left[acts].sum() / max(left.sum(), 1e-300))
    return max(WORTH * count, SHARE * part * current.loss)


def _worthy(system: System, current: Fit, rival: Rival) -> bool:
    if rival.fit.at_a_wall:
        return False
    gain = current.loss - _left(rival)
    if rival.site.transient:
        return gain > SEARCHED * max(WORTH * system.count, SHARE * current.loss)
    gains = current.losses - rival.fit.losses
    least = least_worth(system, current, rival.fit.columns(rival.site))
    return gain > least and gain - gains.max() > SURE * min(least, WORTH * system.count)


def _alike(system: System, rival: Rival, best: Rival, gained: float) -> bool:
    off, near = _left(rival) - _left(best), NEAR * _left(best) + WORTH * system.count
    if rival.site.transient or best.site.transient:
        return off < min(near, WORTH * gained)
    return off < min(near, max(ALIKE * spread_of(rival.fit.losses - best.fit.losses), 0.2 * WORTH * system.count))


def spread_of(differences: Array) -> float:
    """Return the standard deviation of a sum over blocks."""
    return float(np.std(differences) * np.sqrt(differences.size))


def sureness_of(simplest: Rival, worthy: Sequence[Rival]) -> float:
    """Draw the blocks anew and count how often the cause explains most; causes that cannot be told apart share the rest."""
    others = [r for r in worthy if r.site.cause != simplest.site.cause and not related(r.site, simplest.site)]
    losses = np.stack([r.fit.losses for r in (simplest, *others)])
    count = losses.shape[1]
    draws = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), size=400)
    drawn = losses @ draws.T
    margin = drawn - drawn[0]
    spread = np.maximum(np.std(margin, axis=1, keepdims=True), 1e-9 * float(losses[0].sum()))
    equal = margin <= 0.1 * spread
    return float(np.mean(np.where((margin < 0.0).any(axis=0), 0.0, 1.0 / equal.sum(axis=0))))


def settled(
    system: System,
    joint: Any,
    setting: Setting,
    sites: Sequence[Site],
    current: Fit,
    choices: list[Choice],
    blocks: Integers,
) -> tuple[Fit, list[Choice]]:
    """Choose again within the family of the last cause, with the noise as it is known now."""
    last = choices[-1]
    rest = tuple(s for s in current.sites if s.key != last.site.key)
    start = np.concatenate([current.own(s) for s in rest]) if rest else np.zeros(0)
    without = fitted(system, joint, rest, start, blocks)
    family = [s for s in sites if related(s, last.site)]
    if len(family) < 2:
        return current, [*choices[:-1], replace(last, before=without.losses, after=current.losses)]
    found = chosen(system, without, considered(system, joint, setting, family, without, blocks))
    if found is None:
        return current, choices
    choice = replace(found[0], rivals=last.rivals, sureness=last.sureness)
    return found[1], [*choices[:-1], choice]


def looked_back(
    system: System,
    joint: Any,
    setting: Setting,
    sites: Sequence[Site],
    current: Fit,
    choices: list[Choice],
    blocks: Integers,
) -> tuple[Fit, list[Choice]]:
    """Try each earlier cause again now that others are known: drop it, or put another in its place."""
    newest = choices[-1].site.key
    for choice in list(choices) if len(choices) > 1 else []:
        rest = tuple(s for s in current.sites if s.key != choice.site.key)
        start = np.concatenate([current.own(s) for s in rest]) if rest else np.zeros(0)
        without = fitted(system, joint, rest, start, blocks)
        if not _worthy(system, without, Rival(choice.site, current)):
            current, choices = without, [c for c in choices if c is not choice]
            continue
        if choice.site.key == newest:
            continue  # it has just been looked for, with the same others there
        found = chosen(system, without, considered(system, joint, setting, sites, without, blocks))
        if found is None:
            continue
        # Another takes its place only if it explains clearly more than noise can, or as much with fewer numbers.
        better = found[1].loss < current.loss - max(WORTH * system.count, SHARE * current.loss)
        fewer = len(found[0].site.parameters) < len(choice.site.parameters)
        if better or (fewer and any(r.site.key == choice.site.key for r in found[0].rivals)):
            choices = [found[0] if c is choice else c for c in choices]
            current = found[1]
    return current, choices


def _by_worth(system: System, joint: Any, fit: Fit, choices: Sequence[Choice], blocks: Integers) -> list[Choice]:
    """Order causes by what the log would be left with without each."""
    if len(choices) < 2:
        return list(choices)
    out = []
    for choice in choices:
        rest = tuple(s for s in fit.sites if s.key != choice.site.key)
        without = fitted(system, joint, rest, np.concatenate([fit.own(s) for s in rest]), blocks)
        out.append(replace(choice, before=without.losses, after=fit.losses))
    return sorted(out, key=lambda c: float((c.after - c.before).sum()))


def remainder(system: System, joint: Any, setting: Setting) -> Remainder:
    """Return what is left over at every sample."""
    equations = {}
    for i, equation in enumerate(system.equations(joint)):
        equations[equation.name] = np.where(system.usable[i], equation.whole, np.nan)
    return Remainder(system.channels.time, equations, true_roles(joint, system.channels, system.hold))
