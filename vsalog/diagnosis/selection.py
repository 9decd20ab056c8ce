"""Which causes: a search over whole sets of them, each scored by its marginal likelihood under noise, model error and priors.

The equations are linearised about the best set so far, all sets are searched (`subsets`), the best few are fitted in full
(`posterior`), and the equations are linearised about the best of those, until it stays the same. The weights are noise and
model error together (`discrepancy`): the residual of a fit of everything in blocks that it has not seen. So the search goes from
coarse to fine by itself, as the residual shrinks.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logsumexp

from vsalog.core.dependence import LEAST_BLOCKS
from vsalog.core.progress import counted
from vsalog.core.significance import SIGNIFICANCE
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Remainder, Setting, Site
from vsalog.diagnosis.clock import all_late, counted_from, delays_in, on_fewest_clocks, read_apart
from vsalog.diagnosis.common_causes import common_sites
from vsalog.diagnosis.discrepancy import Weights, left_out, weighted_by
from vsalog.diagnosis.linear import (
    Linear,
    Placed,
    Unknowns,
    Variant,
    candidates_of,
    clash,
    linearised,
    placed,
    set_in,
    variants_of,
)
from vsalog.diagnosis.omnibus import p_value
from vsalog.diagnosis.posterior import ITERATIONS, Posterior, Problem, begun_by, most_probable
from vsalog.diagnosis.smooth import smooth_sites
from vsalog.diagnosis.subsets import BEST, Candidates, Ranked, best_sets, precisions, without
from vsalog.diagnosis.unknown_spring import spring_sites
from vsalog.residuals.per_log import any_of
from vsalog.residuals.sensing import torque_role, true_roles
from vsalog.residuals.system import System, build_system, whitener

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

# Least length of a block [s]: longer than any transient of a joint; and the largest number of blocks [1].
LEAST_BLOCK, MOST_BLOCKS = 1.0, 24
# Sets are fitted in full whose linear score is as near to the best [log-probability]: it may be off by as much far from where it
# is linearised.
LINEAR_SCORE_ERROR = 10.0
# A set that is found again is settled where its score gains less than this [log-probability]: a factor of e in probability.
SETTLED = 1.0
# Causes of which a set without the one is less probable by no more than this [log-probability] are not separated from it.
APART = -float(np.log(SIGNIFICANCE))


@dataclass(frozen=True, slots=True)
class Choice:
    """A cause of the best set.

    Attributes
    ----------
    site : of the catalogue
    against : logs of how much more probable the best set is than others: than the best without this cause, and, for as long as
        another cause replaces it there, than the best without these either; the last is that without all of its class
    rivals : the causes that replace it, where that is about as probable: with it they are its class
    size : what the cause changes in the equation where it shows most, beyond what the other causes of the set could take up, root
        mean square over that of noise and model error
    over_model_error : the same over that of model error alone; infinite where there is none
    instead : the best set without this cause; nothing where none was fitted in full
    """

    site: Site
    against: tuple[float, ...]
    rivals: tuple[Site, ...]
    size: float
    over_model_error: float = np.inf
    instead: tuple[tuple[Site, Array], ...] | None = None

    @property
    def odds(self) -> float:
        """Log of how much more probable the best set is than the best without this cause."""
        return self.against[0]

    @property
    def class_odds(self) -> float:
        """Log of how much more probable the best set is than the best without any member of the cause's class."""
        return self.against[-1]

    @property
    def probability(self) -> float:
        """Probability of the best set among it and those in which others replace this cause, or nothing does.

        A set that is the more probable one only until noise and model error are measured about it is as probable.
        """
        return float(expit(-logsumexp(-np.maximum(self.against, 0.0))))


@dataclass(frozen=True, slots=True)
class Stage:
    """The equations about one set of causes.

    Attributes
    ----------
    system : with the noise as the set has it
    weights : of noise and model error
    unknowns, candidates : of the equations, linearised in the numbers of all causes
    """

    system: System
    weights: Weights
    unknowns: Unknowns
    candidates: Candidates


@dataclass(frozen=True, slots=True)
class Selection:
    """What explains a log.

    Attributes
    ----------
    problem : what was asked
    stage : the equations about the best set
    posterior : of its causes together
    choices : of its causes
    blocks : shape (R,), the block of each row
    p_value : of the original rig, see `omnibus`; none where no cause can be looked for
    settled : whether the search ended in a set that it finds again when it begins there
    """

    problem: Problem
    stage: Stage
    posterior: Posterior
    choices: tuple[Choice, ...]
    blocks: Integers
    p_value: float | None = None
    settled: bool = True

    @property
    def system(self) -> System:
        """The equations with the noise as the causes have it."""
        return self.stage.system

    @property
    def weights(self) -> Weights:
        """Noise and model error."""
        return self.stage.weights


def select(
    system: System, joint: Any, setting: Setting, barred: frozenset[str], stated: Mapping[str, float]
) -> Selection:
    """Find the set of causes that explains a log best.

    Parameters
    ----------
    system : of the log
    joint : of the rig
    setting : what causes may know
    barred : causes that cannot be determined here
    stated : tolerances of the rig
    """
    sites, problem, blocks = sites_of(setting, barred), Problem(joint, setting, stated), blocks_of(system)
    held = 0.5 * system.channels.period / system.channels.every
    stage, contradiction = _rig_stage(problem, system, sites, blocks, held)
    stage, best, _ = _settled(problem, stage, sites, blocks)
    smooth = stage_about(problem, system, sites, best.fit, blocks, 0.0)
    smooth, other, _ = _settled(problem, smooth, sites, blocks, best)
    # Two fits can be compared under one noise and model error only, and with the noise read at the same samples: what it happens
    # to be between them is by some parts in a hundred larger or smaller.
    early = read_apart(other.fit, best.fit, sites, held, _noise_of(problem, stage, best.fit)) / system.channels.period
    alike = replace(stage.weights, system=replace(stage.weights.system, hold=0.0, early=early))
    more = most_probable(problem, stage.weights, best.fit).score - most_probable(problem, alike, other.fit).score
    if smooth_drive(more, other.fit, best.fit):
        contradiction = _rig_stage(problem, system, sites, blocks, 0.0)[1]
        stage, best = smooth, other
    # What was found has to compete with unknown functions, which are not looked at before: there are many of them.
    there = placed(joint, best.fit)
    sites = [*sites, *smooth_sites(stage.system, any_of(there))]
    stage = stage_about(problem, stage.system, sites, best.fit, blocks, stage.system.hold)
    stage, best, settled = _settled(problem, stage, sites, blocks, best)
    found = established(problem, stage, sites, most_probable(problem, stage.weights, best.fit), blocks)
    return replace(found, p_value=contradiction, settled=settled and found.settled)


def _noise_of(problem: Problem, stage: Stage, fit: Placed) -> Callable[[Site], float]:
    """Return the function that gives how much of the equations' noise, in squares, the channel of a delay makes."""
    joint, system = placed(problem.joint, fit), stage.weights.system
    rows = system.averaged(joint)

    def noise(site: Site) -> float:
        role = torque_role(site.part) if site.cause == "motor.torque_delay" else site.part
        if role not in system.channels.roles:
            return 0.0
        added = replace(system, channels=system.channels.with_noise(0, role)).averaged(joint) - rows
        return float(np.sum(system.white(added) ** 2))

    return noise


def smooth_drive(more: float, smooth: Placed, held: Placed) -> bool:
    """Return whether drives are taken for smooth.

    They hold a torque from sample to sample. One that is smooth acts half a sample earlier, which several delays together would
    explain as well. It is taken for smooth where that is the more probable: by far, or with fewer causes; with fewer delays also
    where it is nearly as probable.

    Parameters
    ----------
    more : log of how much more probable the set for smooth drives is
    smooth, held : the sets
    """
    fewer = delays_in(held) - delays_in(smooth)
    return more > APART or (more >= -APART and fewer > 0) or (more > 0.0 and fewer == 0 and len(smooth) < len(held))


def _settled(
    problem: Problem, stage: Stage, sites: Sequence[Site], blocks: Integers, best: Posterior | None = None
) -> tuple[Stage, Posterior, bool]:
    """Search, from `best` on, until the best set stays the same; return the equations about it, it, and whether it did."""
    for _ in counted("causes", range(ITERATIONS), at_most=True):
        found = _best(problem, stage, best)
        if best is not None and found.keys == best.keys and found.score > best.score - SETTLED:
            return stage, found, True
        best = found
        stage = stage_about(problem, stage.system, sites, best.fit, blocks, stage.system.hold)
    assert best is not None
    return stage, best, False


def nothing_found(system: System, joint: Any, setting: Setting) -> Selection:
    """Return the selection of no cause, where there is nothing to look for any with."""
    problem, blocks = Problem(joint, setting, {}), blocks_of(system)
    stage = stage_about(problem, system, (), (), blocks, system.hold)
    return Selection(problem, stage, most_probable(problem, stage.weights, ()), (), blocks)


def established(problem: Problem, stage: Stage, sites: Sequence[Site], final: Posterior, blocks: Integers) -> Selection:
    """Drop the causes without which the set is about as probable and nothing replaces them, the least probable first.

    Where a set that was looked at in the place of a cause turns out to be the more probable one, it goes on from there, but not
    where it has been: of two sets each of which is the more probable one under the other's noise neither is.
    """
    been, settled = {_shapes(final.fit)}, True
    while True:
        variants = stage.unknowns.variants
        chosen = np.array([v.inside for v in variants], dtype=np.bool_)
        best = Ranked(chosen, stage.candidates.scored(chosen))
        choices, better = list[Choice](), None
        for choice in choices_of(problem, stage, stage.candidates, best, variants, final):
            if choice.odds <= -SETTLED and choice.instead is not None:
                if _shapes(choice.instead) not in been and len(been) <= ITERATIONS:
                    better = choice.instead
                    break
                settled = False
            choices.append(choice)
        if better is not None:
            been.add(_shapes(better))
            stage = stage_about(problem, stage.system, sites, better, blocks, stage.system.hold)
            final = most_probable(problem, stage.weights, better)
            continue
        # A cause that is driven as far as it may go imitates something else; what happened once has to be an outlier of the rest.
        out = {site.key for site, values in final.fit if site.driven_out(values)}
        out |= {s.key for s, values in final.fit if s.transient and not _begins(problem, stage, final.fit, s, values)}
        loose = min(choices, key=lambda c: c.class_odds, default=None)
        if loose is None or (loose.class_odds >= APART and not out):
            choices.sort(key=lambda c: -c.odds)
            return Selection(problem, stage, final, tuple(choices), blocks, settled=settled)
        gone = out or {loose.site.key}
        # Nor may it come back in the place of another.
        sites = [site for site in sites if site.key not in out]
        fit = tuple((site, values) for site, values in final.fit if site.key not in gone)
        stage = stage_about(problem, stage.system, sites, fit, blocks, stage.system.hold)
        final = most_probable(problem, stage.weights, fit)


def _shapes(fit: Placed) -> frozenset[tuple[str, str, int]]:
    """Return causes and parts, and in how many numbers each."""
    return frozenset((*site.key, len(site.parameters)) for site, _ in fit)


def _begins(problem: Problem, stage: Stage, fit: Placed, site: Site, values: Array) -> bool:
    """Return whether the search for a cause would begin, in the residual of a set without it, where a fit might have led here."""
    if site.starts is None:
        return True
    without_it = placed(problem.joint, [(s, v) for s, v in fit if s.key != site.key])
    begun = site.starts(remainder(stage.system, without_it))
    within = np.array([ITERATIONS * p.reach if p.shape else np.inf for p in site.parameters])
    return any(bool(np.all(np.abs(np.array(start) - values) <= within)) for start in begun)


def sites_of(setting: Setting, barred: frozenset[str]) -> list[Site]:
    """Return all causes of the catalogue, wherever they may sit, but for those that are barred."""
    sites = [site for cause in catalogue().values() if cause.name not in barred for site in cause.sites(setting)]
    if setting.logs > 1:
        # What happens once happens in one log.
        sites = [site for site in sites if not site.transient]
    shared = [site for site in sites if site.cause not in setting.differs]
    own = [
        replace(site, log=(k, setting.logs))
        for site in sites
        if site.cause in setting.differs
        for k in range(setting.logs)
    ]
    return [*spring_sites(setting), *shared, *own, *common_sites(shared)]


def blocks_of(system: System) -> Integers:
    """Number the blocks of the rows, shape (R,), rising."""
    time = system.time
    count = int(np.clip((time[-1] - time[0]) / LEAST_BLOCK, LEAST_BLOCKS, MOST_BLOCKS))
    return np.minimum((np.arange(time.size) * count) // max(time.size, 1), count - 1).astype(np.int64)


def remainder(system: System, joint: Any) -> Remainder:
    """Return the residual of each equation at every sample."""
    whole, noise = system.equations(joint), dict[str, Array]()
    copies = [copy.equations(joint) for copy in system.noisy]
    equations = {}
    for i, equation in enumerate(whole):
        equations[equation.name] = np.where(system.usable[i], equation.whole, np.nan)
        noise[equation.name] = np.stack([copy[i].whole - equation.whole for copy in copies])
    return Remainder(system.channels.time, equations, true_roles(any_of(joint), system.channels, system.hold), noise)


def stage_about(
    problem: Problem,
    system: System,
    sites: Sequence[Site],
    fit: tuple[tuple[Site, Array], ...],
    blocks: Integers,
    hold: float,
) -> Stage:
    """Linearise the equations about a set of causes, under its own noise and model error.

    Parameters
    ----------
    problem : what is asked
    system : of the log, for the rows that are used
    sites : of the catalogue
    fit : the set
    blocks : shape (R,), the block of each row
    hold : how long after its stamp a motor torque acts on average [s]
    """
    linear, own = equations_about(problem, system, sites, fit, hold)
    return _stage(linear, own, blocks)


def _rig_stage(
    problem: Problem, system: System, sites: Sequence[Site], blocks: Integers, hold: float
) -> tuple[Stage, float]:
    """Linearise the equations about the original rig; return the p-value of that, too."""
    linear, own = equations_about(problem, system, sites, (), hold)
    stage = _stage(linear, own, blocks)
    return stage, p_value(linear, stage.weights.system, everything(linear), blocks)


def equations_about(
    problem: Problem, system: System, sites: Sequence[Site], fit: tuple[tuple[Site, Array], ...], hold: float
) -> tuple[Linear, System]:
    """Return the equations, linearised about a set of causes, and the system with the noise as the set has it."""
    there = placed(problem.joint, fit)
    own = build_system(there, system.channels, system.balance, hold, system.copies).on_rows_of(system)
    left = remainder(own, there)
    variants = variants_of(sites, problem.setting, left, fit, problem.stated)
    return linearised(own, problem.joint, fit, variants), own


def _stage(linear: Linear, system: System, blocks: Integers) -> Stage:
    weights = weighted_by(system, left_out(linear, system, everything(linear), blocks))
    return Stage(system, weights, linear.unknowns, candidates_of(linear, weights.system))


def everything(linear: Linear) -> Flags:
    """Return the unknowns of all causes that can be in one set: those of the fit, and all others that begin with no shape.

    Of unknown functions there are too many: what all of them predict in a block that they have not seen is mostly noise.
    """
    inside = [v.site for v in linear.variants if v.inside]
    plain = [v.site.starts is None and v.site.added is None for v in linear.variants]
    able = [
        v.inside or (p and not any(clash(v.site, s) for s in inside))
        for p, v in zip(plain, linear.variants, strict=True)
    ]
    return np.repeat(np.array(able, dtype=np.bool_), np.diff(linear.first))


def _best(problem: Problem, stage: Stage, about: Posterior | None) -> Posterior:
    """Search the sets about a stage, fit the best few in full, and return the most probable of them and the one it is about."""
    start = np.array([v.inside for v in stage.unknowns.variants], dtype=np.bool_)
    sets = best_sets(stage.candidates, [start])
    near = [s for s in sets if s.score <= sets[0].score + LINEAR_SCORE_ERROR][:BEST]
    begun = [begun_by(stage.unknowns, stage.candidates, s.chosen) for s in near]
    begun.append(() if about is None else about.fit)
    return min((fitted(problem, stage, b) for b in begun), key=lambda p: p.score)


def fitted(problem: Problem, stage: Stage, start: Placed) -> Posterior:
    """Fit a set under a stage's noise and model error, with its delays counted from the channel that leaves the fewest late.

    Shifting all channels together changes only how samples fall between those of the log: a fit must not gain by that.
    """
    found, sites = most_probable(problem, stage.weights, start), sites_in(stage)
    fewest = on_fewest_clocks(found.fit, sites)
    if fewest is None:
        return found
    other = most_probable(problem, stage.weights, fewest)
    return other if all_late(found.fit, sites) else min(found, other, key=lambda p: p.score)


def choices_of(
    problem: Problem, stage: Stage, c: Candidates, best: Ranked, variants: Sequence[Variant], final: Posterior
) -> Iterator[Choice]:
    """Compare the best set with the best one without each of its causes; first the cause that looks least probable to begin with.

    Parameters
    ----------
    problem, stage : about the best set
    c : normal equations in which the sets are scored
    best : the set among them
    variants : their groups
    final : the best set, fitted
    """
    searched, known, without_it = list[Ranked](), dict[bytes, Posterior](), list[tuple[Ranked, Site]]()

    def best_without(barred: Flags) -> Ranked:
        # A set that is better than the best one, found in the place of another cause, will do for all that it lacks.
        better = [r for r in searched if r.score < best.score and not (r.chosen & barred).any()]
        found = better[0] if better else without(c, best, barred)
        searched.append(found)
        return found

    for site in (site for site, _ in final.fit if not site.given):
        # A cause of two parts is as probable as it is of either of them.
        each = [np.array([v.site.overlaps(m) for v in variants], dtype=np.bool_) for m in site.members or (site,)]
        without_it.append((min((best_without(barred) for barred in each), key=lambda r: r.score), site))
    for other, site in sorted(without_it, key=lambda w: w[0].score):
        odds, instead = other.score - best.score, None
        if c is stage.candidates:
            exact = [fitted(problem, stage, o) for o in simpler_sets(variants, final.fit, site)]
            for o, price in _richer_sets(variants, final.fit, site):
                richer = fitted(problem, stage, o)
                exact.append(replace(richer, score=richer.score + price))
            if odds < LINEAR_SCORE_ERROR:
                begun, name = begun_by(stage.unknowns, c, other.chosen), other.chosen.tobytes()
                known[name] = known.get(name) or fitted(problem, stage, begun)
                exact.append(known[name])
                if exact[-1].score > final.score - SETTLED:
                    # What else came and went on the way there may be worth more than the linear model predicts.
                    exact.append(fitted(problem, stage, _exchanged(final.fit, site, begun)))
                odds = np.inf
            likeliest = min(exact, key=lambda e: e.score, default=None)
            if likeliest is not None:
                odds, instead = min(odds, likeliest.score - final.score), likeliest.fit
        counted = counted_from(final.fit, site, sites_in(stage))
        if counted is not None and odds > 0.0:
            # Counted from its own channel the delays are the same, however the samples of this log fall.
            odds, instead = 0.0, counted
        rivals, against, there = list[Site](), [odds], instead
        while against[-1] < APART and (more := _new_in(there, {*final.keys, *(r.key for r in rivals)})):
            rivals += more
            barred = np.array([any(v.site.overlaps(m) for m in (site, *rivals)) for v in variants], dtype=np.bool_)
            gone = without(c, best, barred)
            odds, there = gone.score - best.score, None
            if odds < LINEAR_SCORE_ERROR:
                after = fitted(problem, stage, begun_by(stage.unknowns, c, gone.chosen))
                odds, there = after.score - final.score, after.fit
            against.append(odds)
        yield Choice(site, tuple(against), tuple(rivals), *_size_of(final, stage, site), instead)


def _new_in(instead: Placed | None, known: Collection[tuple[str, str]]) -> list[Site]:
    """Return the causes of a set that are not known."""
    return [site for site, _ in instead or () if site.key not in known]


def _exchanged(fit: Placed, site: Site, instead: Placed) -> Placed:
    """Return a set without a cause, with what another set has that this one lacks."""
    out = [(s, v) for s, v in fit if not s.overlaps(site)]
    for other, values in instead:
        if all(other.key != s.key for s, _ in fit):
            out = list(set_in(out, other, values))
    return out


def simpler_sets(variants: Sequence[Variant], fit: Placed, site: Site) -> list[Placed]:
    """Return a set with a cause exchanged for each simpler one of its family, which begins with its numbers."""
    return [set_in(fit, v.site, v.base) for v in variants if v.instead == site.key != v.site.key]


def _richer_sets(variants: Sequence[Variant], fit: Placed, site: Site) -> list[tuple[Placed, float]]:
    """Return a set with a cause exchanged for each richer one of its family, which begins with its numbers; and its price.

    As any cause it pays for the choice among the shapes that a search begins with: none has to lie where the log shows nothing.
    """
    values, out = next(v for s, v in fit if s.key == site.key), list[tuple[Placed, float]]()
    own, kin = {p.name: v for p, v in zip(site.parameters, values, strict=True)}, dict[tuple[str, str], Site]()
    for other in sorted((v.site for v in variants), key=lambda s: len(s.parameters)):
        family = other.key != site.key and other.parts == site.parts and clash(other, site)
        if family and own.keys() <= {p.name for p in other.parameters}:
            kin.setdefault(other.key, other)
    for s in kin.values():
        begun = np.array([own.get(p.name, p.start if p.shape else p.start + p.step) for p in s.parameters])
        more = [i for i, p in enumerate(s.parameters) if p.shape and p.name not in own]
        shapes = {tuple(v.base[more]) for v in variants if v.site is s}
        out.append((set_in(fit, s, begun), float(np.log(len(shapes)))))
    return out


def sites_in(stage: Stage) -> list[Site]:
    """Return the causes that a stage has, each once."""
    return list({(v.site.key, len(v.site.parameters)): v.site for v in stage.unknowns.variants}.values())


def _size_of(final: Posterior, stage: Stage, site: Site) -> tuple[float, float]:
    """Return how large a cause is in the equation where it shows most, beyond what the others could take up, see `Choice`."""
    weights = stage.weights
    g = next(i for i, v in enumerate(final.linear.variants) if v.site.key == site.key)
    variant = final.linear.variants[g]
    first = int(final.linear.first[g])
    own = [first + k for k, i in enumerate(variant.free) if not variant.site.parameters[i].shape]
    covariance = np.linalg.inv(np.diag(precisions(final.linear.now)) + final.candidates.information)
    values = final.linear.now[own]
    wald = float(values @ np.linalg.solve(covariance[np.ix_(own, own)], values))
    effect = weights.system.white(final.linear.columns[:, :, own] @ values)
    squares = np.sum(effect**2, axis=0)
    # What happens once is as large as it is while it happens.
    acts = np.abs(effect) > 0.0 if site.transient else weights.system.weights > 0.0
    rows = np.count_nonzero(acts, axis=0) / weights.times
    i = int(np.argmax(squares))
    size = float(np.sqrt(wald / max(rows[i], 1.0)))
    white = whitener(weights.system.covariance, (1 << len(rows)) - 1)[i]
    beyond_noise = max(1.0 - float(white @ stage.system.covariance @ white), 0.0)
    return size, size / beyond_noise**0.5 if beyond_noise else np.inf
