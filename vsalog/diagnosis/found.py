"""Causes that were found, with their numbers and the part of the error that each removes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, erf, expit

from vsalog.core.significance import INTERVAL, INTERVAL_BELOW, SIGNIFICANCE
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.common_causes import scales
from vsalog.diagnosis.linear import Placed, placed
from vsalog.diagnosis.selection import APART, Choice, Selection
from vsalog.diagnosis.subsets import precisions
from vsalog.residuals.system import System

Array = NDArray[np.float64]

# Share of the causes with overwhelming odds that are not there though equations close [1]: something that the catalogue lacks
# looks like them. Odds compare models that are known; this share is counted: 2 of 1080, (2 + 1)/(1080 + 2) by Laplace's rule.
IMITATED_SHARE = 0.003


@dataclass(frozen=True, slots=True)
class Found:
    """A cause that was found.

    Attributes
    ----------
    site : of the catalogue
    values, covariance : as fitted
    choice : why it was chosen
    removed : part of the rig's squared residual, beyond noise, that it takes away
    common_with : other parts that have the same number, or the same factor
    """

    site: Site
    values: Array
    covariance: Array
    choice: Choice
    removed: float
    common_with: tuple[str, ...] = ()

    @property
    def material(self) -> bool:
        """Whether its effect matters, and the log determines it, or a class that it is one member of.

        It matters where it changes an equation by as much as noise and model error together do, beyond what the other causes
        could take up: that is the unit of its size.
        """
        # Where no log determines the cause, as a delay by a part of a sample, no other one can be determined either.
        blurred = any(p.blur for p in self.site.parameters)
        known = any(self.determined().values()) or self._together() or (bool(self.choice.rivals) and not blurred)
        return self.choice.size >= 1.0 and known

    @property
    def confidence(self) -> float:
        """Probability that this cause is there, not what replaces it in other sets, and that nothing imitates it."""
        return self._not_imitated * self.choice.probability

    @property
    def class_confidence(self) -> float:
        """Probability that a member of its class is there, and that nothing imitates it; of a class of one that of the cause."""
        return float(self._not_imitated * expit(self.choice.class_odds))

    @property
    def _not_imitated(self) -> float:
        """Probability that nothing imitates the cause.

        Model error is no noise: it follows the motion and does not average out. Along the cause's direction it may be as large as
        it is on the whole, as a normal variable: this is the probability that it is less than what was found there.
        """
        return float((1.0 - IMITATED_SHARE) * erf(self.choice.over_model_error / 2.0**0.5))

    def numbers(self) -> dict[str, tuple[float, float, str]]:
        """Return name → value, standard deviation, unit, as reported."""
        here, slopes = self.site.reported(self.values.tolist()), self.slopes()
        variance = np.maximum(np.diag(slopes @ self.covariance @ slopes.T), 0.0)
        exact = catalogue()[self.site.cause].exact
        variance += [(exact * value) ** 2 + self.blur(name) ** 2 for name, (value, _) in here.items()]
        spread = np.sqrt(variance)
        return {name: (value, float(s), unit) for (name, (value, unit)), s in zip(here.items(), spread, strict=True)}

    def slopes(self) -> Array:
        """Return how the reported numbers change with those that are fitted, shape (numbers, parameters)."""
        here = self.site.reported(self.values.tolist())
        slopes = np.zeros((len(here), self.values.size))
        for i, parameter in enumerate(self.site.parameters):
            step = 1e-3 * max(abs(parameter.step), 1e-12)
            moved = self.values.copy()
            moved[i] += step
            there = self.site.reported(moved.tolist())
            slopes[:, i] = [(there[name][0] - value) / step for name, (value, _) in here.items()]
        return slopes

    def blur(self, name: str) -> float:
        """Return the part of a number that no log determines, one standard deviation."""
        return next((p.blur for p in self.site.parameters if p.name == name), 0.0)

    def absent(self) -> dict[str, tuple[float, str]]:
        """Return name → value and unit as the rig has it, of a shape as it was found."""
        shapes = [p.shape for p in self.site.parameters]
        return self.site.reported(np.where(shapes, self.values, self.site.start).tolist())

    def determined(self) -> dict[str, bool]:
        """Return name → whether a number's 95 % interval excludes the rig's and zero; a shape's, if any other does.

        Of a shape that is a size, as a speed or a width, the interval has to exclude zero, too.
        """
        absent, here = self.absent(), self.numbers()
        clear = {n: min(abs(v - absent[n][0]), abs(v)) > INTERVAL * std for n, (v, std, _) in here.items()}
        places = {p.name for p in self.site.parameters if p.low <= 0.0}
        sized = {n: n in places or abs(v) > INTERVAL * std for n, (v, std, _) in here.items()}
        return {n: any(clear.values()) and sized[n] if v == absent[n][0] else clear[n] for n, (v, _, _) in here.items()}

    def _together(self) -> bool:
        """Return whether several strengths that may replace one another are determined together, with the same probability."""
        own = [i for i, p in enumerate(self.site.parameters) if not p.shape]
        if len(own) < 2:
            return False
        away = self.values[own] - np.array(self.site.start)[own]
        blur = np.array([self.site.parameters[i].blur for i in own])
        blurred = blur**2 + (catalogue()[self.site.cause].exact * self.values[own]) ** 2
        surprise = float(away @ np.linalg.solve(self.covariance[np.ix_(own, own)] + np.diag(blurred), away))
        return surprise > float(chdtri(len(own), SIGNIFICANCE))


def found_by(selection: Selection, joint: Any) -> list[Found]:
    """Return the causes of the best set with what each takes away, the weightiest first."""
    posterior, out = selection.posterior, list[Found]()
    if not posterior.fit:
        return out
    covariance = posterior.covariance
    more = np.maximum(_between(selection, np.sqrt(np.diag(covariance))), np.diag(undetermined(selection)))
    if posterior.simulated is None:
        more += np.square(
            [p.rounded * v for site, values in posterior.fit for p, v in zip(site.parameters, values, strict=True)]
        )
    covariance = covariance + np.diag(more)
    shares = _removed(selection.system, joint, posterior.fit)
    for g, ((site, values), removed) in enumerate(zip(posterior.fit, shares, strict=True)):
        if not site.named:
            continue
        own = slice(int(posterior.linear.first[g]), int(posterior.linear.first[g + 1]))
        choice = next(c for c in selection.choices if c.site.key == site.key)
        members = site.members or (site,)
        for member, scale in zip(members, scales(members), strict=True):
            others = tuple(m.part for m in members if m.part != member.part)
            there = covariance[own, own] * np.outer(scale, scale)
            out.append(Found(member, values * scale, there, choice, removed / len(members), others))
    return sorted(out, key=lambda f: -f.removed)


def _between(selection: Selection, spread: Array) -> Array:
    """Return the variance that the choice within a class adds to each value, shape (p,).

    A 95 % interval reaches as far as 95 % of the values that go with the other members of the class; of a cause that is absent
    there, the interval is that of its value if it is present. `spread` is each value's standard deviation within the set.
    """
    fit = selection.posterior.fit
    farthest = [np.zeros(values.size) for _, values in fit]
    for instead in (choice.instead or () for choice in selection.choices if choice.rivals):
        there = {s.key: v for s, v in instead}
        for k, (site, values) in enumerate(fit):
            other = there.get(site.key, values)
            if other.size == values.size:
                farthest[k] = np.maximum(farthest[k], np.abs(other - values))
    far = np.concatenate(farthest)
    return np.where(far > 0.0, np.maximum(((far + INTERVAL_BELOW * spread) / INTERVAL) ** 2 - spread**2, 0.0), 0.0)


def undetermined(selection: Selection) -> Array:
    """Return the covariance, shape (p, p), that the other members of the causes' classes add where they are present too.

    A class is a direction that the log cannot determine: along it a value is known by the priors of all members together.
    """
    variants, candidates = selection.stage.unknowns.variants, selection.stage.candidates
    inside = np.array([v.inside for v in variants], dtype=np.bool_)
    chosen = inside.copy()
    rivals = {r.key for choice in selection.choices for r in choice.rivals} | _hidden_by_logs(selection)
    for g, variant in enumerate(variants):
        alone = not (candidates.conflict[g] & chosen).any()
        chosen[g] |= alone and variant.instead is None and variant.site.key in rivals
    H = np.diag(precisions(selection.stage.unknowns.now)) + candidates.information
    own, all_of = candidates.unknowns(inside), candidates.unknowns(chosen)
    among = np.searchsorted(all_of, own)
    together, by_themselves = np.linalg.inv(H[np.ix_(all_of, all_of)]), np.linalg.inv(H[np.ix_(own, own)])
    there = [v for v in variants if v.inside]
    deviation = np.concatenate([np.zeros(0), *(v.deviation for v in there)])
    more = (together[np.ix_(among, among)] - by_themselves) * np.outer(deviation, deviation)
    first = np.cumsum([0, *(v.deviation.size for v in there)])
    parts = {v.site.key: np.arange(a, b) for v, (a, b) in zip(there, pairwise(first), strict=True)}
    order = np.concatenate([np.zeros(0, dtype=np.int64), *(parts[site.key] for site, _ in selection.posterior.fit)])
    return np.asarray(more[np.ix_(order, order)])


def _hidden_by_logs(selection: Selection) -> set[tuple[str, str]]:
    """Return the shared causes that those found in every log could hide: with them the set is about as probable.

    Payloads in all logs are known less well than the link: an error of its inertia may be part of each of them.
    """
    logs = [site for site, _ in selection.posterior.fit if site.log is not None]
    everywhere = any(sum(s.cause == o.cause and s.part == o.part for o in logs) == s.log[1] for s in logs if s.log)
    if not everywhere:
        return set()
    variants, candidates = selection.stage.unknowns.variants, selection.stage.candidates
    inside = np.array([v.inside for v in variants], dtype=np.bool_)
    best, out = candidates.scored(inside), set[tuple[str, str]]()
    for g, variant in enumerate(variants):
        site = variant.site
        if (
            inside[g]
            or (candidates.conflict[g] & inside).any()
            or not site.named
            or site.log is not None
            or site.starts
        ):
            continue
        more = inside.copy()
        more[g] = True
        if candidates.scored(more) - best < APART:
            out.add(site.key)
    return out


def loss_of(system: System, joint: Any) -> float:
    """Return Σ of squares of a joint's averaged equations over their noise."""
    return float(np.sum(system.whitened(joint) ** 2))


def _removed(system: System, joint: Any, fit: Placed) -> Sequence[float]:
    """Return the part of the error that each cause removes.

    What two causes take away together is more, or less, than what each does alone: a cause's part is the mean of what it takes
    away as the first one and as the last one, and the parts add up to what all do.
    """
    nothing, left = loss_of(system, joint), loss_of(system, placed(joint, fit))
    wrong = max(nothing - system.count, 1e-300)
    parts = []
    for site, values in fit:
        alone = loss_of(system, placed(joint, [(site, values)]))
        without = loss_of(system, placed(joint, [(s, v) for s, v in fit if s.key != site.key]))
        parts.append(max(nothing - alone, 0.0) + max(without - left, 0.0))
    whole = float(np.clip((nothing - left) / wrong, 0.0, 1.0))
    return [whole * part / max(sum(parts), 1e-300) for part in parts]
