"""Which causes the equations of a motion can separate, before anything is found wrong.

Two questions. The structural one is of the equations alone: causes whose columns span the same space, whatever the noise, are one
and the same (single-fault isolability of Frisk, Krysander, Jung 2017, A toolbox for analysis and design of model based diagnosis
systems, IFAC-PapersOnLine 50(1); here by the rank of columns on a motion). The practical one is of the Fisher information A of
the motion with its sensors: a cause of strength u is expected to have the score A u, and with it sets of causes compete as they
do in a diagnosis.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vsalog.core.progress import counted
from vsalog.core.significance import INTERVAL, SIGNIFICANCE
from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.discrepancy import Weights, left_out, weighted_by
from vsalog.diagnosis.linear import (
    Linear,
    Placed,
    Variant,
    candidates_of,
    linearised,
    placed,
    variants_of,
    whitened_columns,
    with_unknowns,
)
from vsalog.diagnosis.posterior import ITERATIONS, Problem
from vsalog.diagnosis.selection import (
    APART,
    SETTLED,
    blocks_of,
    equations_about,
    everything,
    remainder,
    sites_of,
    stage_about,
)
from vsalog.diagnosis.smooth import smooth_sites
from vsalog.diagnosis.subsets import Candidates, Ranked, without
from vsalog.residuals.system import EXACT, System

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
# Cause and part.
Key = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Rival:
    """A cause that a diagnosis may name instead of another one.

    Attributes
    ----------
    site : of the catalogue, or an unknown function
    odds : log of how much less probable the best set is in which it replaces the other, expected
    probability : that a diagnosis cannot separate the two
    fit : that set with its values
    """

    site: Site
    odds: float
    probability: float
    fit: Placed


@dataclass(frozen=True, slots=True)
class Isolation:
    """How well a motion isolates a cause that is as large as the rig's tolerance of it.

    Attributes
    ----------
    site : of the catalogue
    values : of all its parameters, shape (p,)
    seen : probability that a diagnosis finds it, or a member of its class
    rivals : that a diagnosis may not separate from it, with a probability of `SIGNIFICANCE` or more
    """

    site: Site
    values: Array
    seen: float
    rivals: tuple[Rival, ...]

    @property
    def fit(self) -> Placed:
        """Return it as a set of causes."""
        return ((self.site, self.values),)

    @property
    def visible(self) -> bool:
        """Whether a diagnosis finds it rather than not."""
        return self.seen >= 0.5

    def absent(self) -> dict[str, tuple[float, str]]:
        """Return name → value and unit as the rig has it, of a shape as it is assumed."""
        shapes = [p.shape for p in self.site.parameters]
        return self.site.reported(np.where(shapes, self.values, self.site.start).tolist())

    def members(self, probability: float) -> frozenset[tuple[str, str]]:
        """Return cause and part of those of its class that are confused so probably; its own is one.

        What looks the same by the roles there are, and has no numbers, is at no part.
        """
        sites = [self.site, *(r.site for r in self.rivals if r.probability >= probability)]
        return frozenset(s.key for s in sites) | {(double, "") for s in sites for double in s.doubles}


def isolations(problem: Problem, system: System, only: Collection[tuple[str, str]] | None = None) -> list[Isolation]:
    """Predict for each cause of the catalogue the result of a diagnosis of a motion if it were there, as large as tolerated.

    Causes that happen once are left out: recording again shows them.

    Parameters
    ----------
    problem : the rig's joint, as the motion was simulated with it
    system : of the motion
    only : causes and parts that are asked about; all when absent
    """
    if not system.count:
        return []
    race = race_of(problem, system)
    assumed = [v for v in _assumed(race.linear.variants) if only is None or v.site.key in only]
    return [race.isolation(v) for v in counted("isolations", assumed)]


def _hypotheses(problem: Problem, system: System) -> list[Site]:
    return [*sites_of(problem.setting, frozenset()), *smooth_sites(system, problem.joint)]


def _assumed(variants: tuple[Variant, ...]) -> Iterator[Variant]:
    """Yield each cause at each part with the simplest of its shapes, the one in the middle of those."""
    groups = dict[tuple[str, str], list[Variant]]()
    for v in variants:
        if v.site.named and not v.site.transient and not v.site.members:
            groups.setdefault(v.site.key, []).append(v)
    for group in groups.values():
        least = min(len(v.site.parameters) for v in group)
        simplest = [v for v in group if len(v.site.parameters) == least]
        yield simplest[len(simplest) // 2]


def tolerated(variant: Variant) -> Array:
    """Return the strengths of a cause that is as large as the rig's tolerance, in units of their prior deviations, shape (k,)."""
    up = np.full(len(variant.free), INTERVAL)
    high = np.array([variant.site.parameters[i].high for i in variant.free])
    return np.where(variant.rig + up * variant.deviation > high, -up, up)


@dataclass(frozen=True, slots=True)
class Race:
    """The causes that compete for the log of a motion.

    Attributes
    ----------
    problem : the rig's joint
    system : of the motion, with nothing wrong
    sites : of all that competes
    linear : the equations about the rig
    weights : of noise and model error
    """

    problem: Problem
    system: System
    sites: tuple[Site, ...]
    linear: Linear
    weights: Weights

    def competing(self, there: Placed) -> tuple[tuple[Variant, ...], Candidates]:
        """Return what competes where a cause is there, with the shapes too that searches begin with in its effect."""
        joint, plain = self.problem.joint, self.linear
        left = remainder(self.system, placed(joint, there))
        shaped = [s for s in self.sites if s.starts is not None]
        known = {_shape(v) for v in plain.variants}
        variants = variants_of(shaped, self.problem.setting, left, (), self.problem.stated)
        new = [v for v in variants if _shape(v) not in known]
        linear = _joined(plain, linearised(self.system, joint, (), new)) if new else plain
        return linear.variants, candidates_of(linear, self.weights.system)

    def about(self, fit: tuple[tuple[Site, Array], ...]) -> tuple[tuple[Variant, ...], Candidates]:
        """Return what competes, linearised about a set of causes."""
        stage = stage_about(self.problem, self.system, self.sites, fit, blocks_of(self.system), self.system.hold)
        return stage.unknowns.variants, stage.candidates

    def isolation(self, assumed: Variant) -> Isolation:
        """Return how well a cause is isolated."""
        site = assumed.site
        ((_, values),) = with_unknowns([assumed], tolerated(assumed))
        expected = _expected(*self.competing(((site, values),)), assumed)
        # The cause itself is the best set, or near it: there is no need to search from everything, as in a log.
        alone = Ranked(expected.alone, expected.c.scored(expected.alone))
        best = without(expected.c, alone, np.zeros(len(expected.variants), dtype=np.bool_))
        inside = [expected.variants[g].site for g in np.flatnonzero(best.chosen)]
        if any(s.key == site.key for s in inside):
            seen, rivals = self._class_of(expected, assumed, best, [site])
            return Isolation(site, values, seen, tuple(rivals))
        # Another set is the more probable one. Of its causes the one counts that replaces this one.
        odds = expected.c.scored(expected.alone) - best.score
        there = [Rival(s, -odds, expected.confused(-odds, best.chosen), expected.fit(best.chosen)) for s in inside]
        seen, rivals = self._class_of(expected, assumed, best, [site, *inside])
        return Isolation(site, values, seen, (*there, *rivals))

    def _class_of(
        self, expected: Expected, assumed: Variant, best: Ranked, known: list[Site]
    ) -> tuple[float, list[Rival]]:
        """Return the probability that a member of a cause's class is found, and that class: see `selection.choices_of`."""
        names, rivals = {s.key for s in known}, list[Rival]()
        names |= {expected.variants[g].site.key for g in np.flatnonzero(best.chosen)}
        while True:
            barred = np.array([any(v.site.overlaps(s) for s in known) for v in expected.variants], dtype=np.bool_)
            gone = without(expected.c, best, barred)
            odds, fit, probability = self._bent(expected, assumed, best, gone)
            new = [s for s, _ in fit if s.key not in names]
            if probability < SIGNIFICANCE or not new:
                return 1.0 - probability, rivals
            rivals += [Rival(s, odds, probability, fit) for s in new]
            names |= {s.key for s in new}
            known = [*known, *new]

    def _bent(self, expected: Expected, assumed: Variant, best: Ranked, other: Ranked) -> tuple[float, Placed, float]:
        """Return the odds of the best set against another one, that with its values, and the probability that both explain a log.

        A set with shapes is linearised about itself, as a fit of it is, for as long as it gains.
        """
        odds, fit = other.score - best.score, expected.fit(other.chosen)
        probability = expected.confused(odds, other.chosen)
        for _ in range(ITERATIONS):
            shaped = any(p.shape for s, _ in fit for p in s.parameters)
            if not shaped or probability >= 0.5:
                break
            there = _expected(*self.about(tuple(fit)), assumed)
            inside = np.array([v.inside for v in there.variants], dtype=np.bool_)
            sharper = there.c.scored(inside) - there.c.scored(there.alone)
            if sharper > odds - SETTLED:
                break
            odds, fit, probability = sharper, there.fit(inside), there.confused(sharper, inside)
        return odds, fit, probability


@dataclass(frozen=True, slots=True)
class Expected:
    """A linear model whose scores are those that a cause is expected to make.

    Attributes
    ----------
    c : normal equations
    variants : their groups
    group : of the cause
    deviance : ½ uᵀ A u, the log of how much more probable the cause's own values make a log
    """

    c: Candidates
    variants: tuple[Variant, ...]
    group: int
    deviance: float

    @property
    def alone(self) -> Flags:
        """The set of the cause itself, shape (G,)."""
        out = np.zeros(len(self.variants), dtype=np.bool_)
        out[self.group] = True
        return out

    def fit(self, chosen: Flags) -> Placed:
        """Return a set with its values."""
        own = [self.variants[g] for g in np.flatnonzero(chosen)]
        return with_unknowns(own, self.c.solution(chosen)[self.c.unknowns(chosen)])

    def confused(self, odds: float, chosen: Flags) -> float:
        """Return the probability that a log gives less than the odds `APART` against a set.

        With noise of one standard deviation, odds scatter with the variance of twice the misfit ½ dᵀ d of the set.
        """
        x = self.c.solution(chosen)
        misfit = self.deviance - float(x @ self.c.score) + 0.5 * float(x @ self.c.information @ x)
        return float(ndtr((APART - odds) / np.sqrt(max(2.0 * misfit, 1e-12))))


def _expected(variants: tuple[Variant, ...], c: Candidates, assumed: Variant) -> Expected:
    """Return the model in which the scores are what a cause is expected to make."""
    own = [g for g, v in enumerate(variants) if v.site.key == assumed.site.key and v.base.size == assumed.base.size]
    group = min(own, key=lambda g: float(np.sum(np.square(variants[g].base - assumed.base))))
    strengths = tolerated(variants[group])
    score = c.information[:, c.first[group] : c.first[group + 1]] @ strengths
    there = score[c.first[group] : c.first[group + 1]]
    return Expected(replace(c, score=score), variants, group, 0.5 * float(there @ strengths))


def race_of(problem: Problem, system: System) -> Race:
    """Linearise the equations of a motion about the rig in the numbers of all that may compete for its log."""
    sites = _hypotheses(problem, system)
    linear, own = equations_about(problem, system, sites, (), system.hold)
    weights = weighted_by(own, left_out(linear, own, everything(linear), blocks_of(system)))
    return Race(problem, own, tuple(sites), linear, weights)


def _shape(variant: Variant) -> tuple[Key, int, bytes]:
    return variant.site.key, variant.base.size, variant.base.tobytes()


def _joined(one: Linear, other: Linear) -> Linear:
    """Return two linear models of the same equations, about the same fit, as one."""
    return replace(
        one,
        variants=(*one.variants, *other.variants),
        first=np.concatenate([one.first, one.first[-1] + other.first[1:]]),
        now=np.concatenate([one.now, other.now]),
        columns=np.concatenate([one.columns, other.columns], axis=-1),
        noise_columns=np.concatenate([one.noise_columns, other.noise_columns], axis=-1),
    )


@dataclass(frozen=True, slots=True)
class Structure:
    """What equations determine of causes without any noise: the spaces that their columns span on motions.

    Attributes
    ----------
    motions : for each motion cause and part → orthonormal bases of its shapes, shape (n, k) each
    """

    motions: tuple[Mapping[Key, Sequence[Array]], ...]

    def __and__(self, other: Structure) -> Structure:
        """Return the structure on the motions of both."""
        return Structure((*self.motions, *other.motions))

    def covers(self, rival: Rival, one: Isolation) -> bool:
        """Return whether the set of a rival can do whatever a cause does, on every motion, whatever the noise.

        Such a set has the same causes' numbers under other names, or more of them, and is less simple then.
        """
        keys = [site.key for site, _ in rival.fit if site.key != one.site.key]
        return all(_covered(spaces, one.site.key, keys) for spaces in self.motions)

    def richer(self, rival: Rival, one: Isolation) -> bool:
        """Return whether that set can do more than the cause: then only its being less simple rules it out."""
        return sum(_numbers(s) for s, _ in rival.fit) > _numbers(one.site)

    def nested(self, rival: Rival, one: Isolation) -> bool:
        """Return whether a cause can do whatever each of the set of a rival does, on every motion."""
        keys = [site.key for site, _ in rival.fit]
        return all(_covered(spaces, key, [one.site.key]) for spaces in self.motions for key in keys)

    def open(self, one: Isolation) -> list[Rival]:
        """Return the rivals of a cause that a motion may separate from it."""
        return [r for r in one.rivals if r.site.named and not self.covers(r, one)]


def _numbers(site: Site) -> int:
    return sum(not p.shape for p in site.parameters)


def _covered(spaces: Mapping[Key, Sequence[Array]], key: Key, others: Sequence[Key]) -> bool:
    """Return whether the simplest space of a cause is within that of others, each with the shape that fits best."""
    own, left = spaces.get(key, ()), 1.0
    if not own or not all(k in spaces for k in others):
        return False
    first = min(own, key=lambda U: U.shape[1])
    for choice in product(*(spaces[k] for k in others)):
        U, sizes, _ = np.linalg.svd(np.concatenate(choice, axis=1), full_matrices=False)
        B = U[:, sizes > EXACT]
        left = min(left, float(np.linalg.norm(first - B @ (B.T @ first), 2)))
    return left < EXACT


def structure_of(problem: Problem, system: System) -> Structure:
    """Return the spaces that causes' columns span on a motion.

    Filters are exact to a part `EXACT`, so columns that agree to that are equal.
    """
    linear, _ = equations_about(problem, system, sites_of(problem.setting, frozenset()), (), system.hold)
    whitened, spaces = whitened_columns(linear.columns, system), dict[Key, list[Array]]()
    for g, v in enumerate(linear.variants):
        columns = whitened[:, linear.first[g] : linear.first[g + 1]]
        norms = np.linalg.norm(columns, axis=0)
        U, sizes, _ = np.linalg.svd(columns[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
        if sizes.size:
            spaces.setdefault(v.site.key, []).append(U[:, sizes > EXACT])
    return Structure((spaces,))


def until(system: System, time: float) -> System:
    """Return a system without its rows after a time [s]."""
    return replace(system, weights=np.where(system.time[:, None] <= time, system.weights, 0.0))
