"""What a log leaves open: causes it cannot separate, or, where there are none, causes it could not have shown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.experiment_design import DESIGN
from vsalog.diagnosis.found import loss_of
from vsalog.diagnosis.joint import JointDiagnosis
from vsalog.diagnosis.linear import Placed, clash, placed
from vsalog.diagnosis.posterior import Problem
from vsalog.diagnosis.priors import deviation_of
from vsalog.diagnosis.unknown_spring import TAKEN_UP
from vsalog.residuals.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What may be wrong with a rig.

    Attributes
    ----------
    site : what is in question; none for nothing
    fit : with all others that are present, at the values that the log has
    """

    site: Site | None
    fit: Placed

    @property
    def values(self) -> Array:
        """Of all parameters, shape (p,)."""
        return np.concatenate([np.zeros(0), *(values for _, values in self.fit)])

    def at(self, values: Array) -> Hypothesis:
        """Return it at other values, shape (p,)."""
        ends = np.cumsum([own.size for _, own in self.fit])
        return Hypothesis(self.site, [(s, v) for (s, _), v in zip(self.fit, np.split(values, ends), strict=False)])

    def in_another_log(self) -> Hypothesis:
        """Return it for a log that is not one of those it is of: what differs from log to log is as in the last one.

        What is in question is there, whichever log it was found in.
        """
        asked = None if self.site is None else self.site.key
        there = [(s, v) for s, v in self.fit if s.log is None or s.log[0] + 1 == s.log[1] or s.key == asked]
        # One that is in question is the first of its kind.
        there.sort(key=lambda own: own[0].key != asked)
        kept = {(s.cause, s.part): (replace(s, log=None), v) for s, v in reversed(there)}
        return Hypothesis(None if self.site is None else replace(self.site, log=None), tuple(reversed(kept.values())))

    def residual(self, system: System, joint: Any) -> Array:
        """Return the whitened equations of a joint with it put in, shape (n,)."""
        return system.whitened(placed(joint, self.fit)).ravel()

    def jacobian(self, system: System, joint: Any) -> Array:
        """Return the change of the whitened equations with the values, shape (n, p)."""
        values, here, columns = self.values, self.residual(system, joint), list[Array]()
        for i, parameter in enumerate(p for site, _ in self.fit for p in site.parameters):
            step = -parameter.step if values[i] + parameter.step > parameter.high else parameter.step
            moved = values.copy()
            moved[i] += step
            columns.append((self.at(moved).residual(system, joint) - here) / step)
        return np.stack(columns, axis=-1)


@dataclass(frozen=True, slots=True)
class Question:
    """Two hypotheses, and how far this log has them apart.

    Attributes
    ----------
    one, other : the hypotheses; `other` is nothing where causes that the log could not show are in question
    now : D of this log, see `suggest`
    size : of the cause in question, the reported number and its unit; none for causes that are confused
    nested : whether `one` can do whatever `other` does: only a machine with `one` in it can separate them
    """

    one: Hypothesis
    other: Hypothesis
    now: float
    size: tuple[float, str] | None = None
    nested: bool = False


@dataclass(frozen=True, slots=True)
class Questions:
    """What is asked, and whether these are causes that were confused."""

    asked: tuple[Question, ...]
    confused: bool

    def in_another_log(self) -> Questions:
        """Return what is asked of a log that is not one of those that leave it open, see `Hypothesis`."""
        asked = [replace(q, one=q.one.in_another_log(), other=q.other.in_another_log()) for q in self.asked]
        return replace(self, asked=tuple(asked))


def questions_of(found: JointDiagnosis) -> Questions:
    """Return what a joint's log leaves open."""
    asked = _confused(found)
    return Questions(asked, True) if asked else Questions(_hidden(found), False)


def _confused(found: JointDiagnosis) -> tuple[Question, ...]:
    """Return the pairs of causes that the log explains equally well with: of the weightiest cause that has any."""
    system, joint = found.system, found.joint
    for one in found.found:
        # Any new recording shows whether what happened once is there.
        rivals = [r for r in one.choice.rivals if not (r.transient or one.site.transient or not r.named)]
        if not rivals:
            continue
        held = [Hypothesis(one.site, found.selection.posterior.fit)]
        for rival in rivals:
            # Of a family the first: the others are the same and more.
            if len(held) < DESIGN.most_hypotheses and not any(h.site and clash(rival, h.site) for h in held[1:]):
                held.append(Hypothesis(rival, one.choice.instead or ()))
        left = {id(h): loss_of(system, placed(joint, h.fit)) for h in held}
        return tuple(
            Question(a, b, float(np.sqrt(abs(left[id(a)] - left[id(b)]) / max(system.count, 1))))
            for a, b in combinations(held, 2)
        )
    return ()


def _hidden(found: JointDiagnosis) -> tuple[Question, ...]:
    """Return the causes that the log would show least of, at an ordinary size, each against nothing."""
    system, joint, nothing = found.system, found.joint, Hypothesis(None, found.selection.posterior.fit)
    asked = [
        Question(one, nothing, shown(system, joint, one, nothing), size)
        for one, size in ordinary_causes(found.selection.problem, nothing)
    ]
    return tuple(sorted(asked, key=lambda q: q.now)[: DESIGN.most_hypotheses])


def ordinary_causes(problem: Problem, present: Hypothesis) -> list[tuple[Hypothesis, tuple[float, str]]]:
    """Return the causes of one number, each as large as one prior deviation, with that size and its unit.

    They are in addition to the causes that are present.
    """
    out = []
    setting, stated = problem.setting, problem.stated
    # What a spring that is fitted again takes up shows in no experiment.
    for cause in (c for c in catalogue().values() if not (setting.fitted and c.name in TAKEN_UP)):
        for site in cause.sites(setting):
            if len(site.parameters) > 1 or site.transient or any(clash(site, s) for s, _ in present.fit):
                continue
            (parameter,) = site.parameters
            change = deviation_of(site, parameter, setting, stated)
            if not change:
                continue  # the rig knows it exactly
            value = parameter.start + (change if parameter.start + change <= parameter.high else -change)
            reported, unit = next(iter(site.reported([value]).values()))
            start = next(iter(site.reported([parameter.start]).values()))[0]
            out.append((Hypothesis(site, [*present.fit, (site, np.array([value]))]), (abs(reported - start), unit)))
    return out


def shown(system: System, joint: Any, one: Hypothesis, nothing: Hypothesis) -> float:
    """Return how far a cause moves the equations, in standard deviations of one average, beyond what the others can take up.

    Parameters
    ----------
    system : of a log or an experiment
    joint : of the rig, without any of them
    one, nothing : with and without the cause
    """
    change = one.residual(system, joint) - nothing.residual(system, joint)
    if nothing.values.size:
        J = nothing.jacobian(system, joint)
        change = change - J @ np.linalg.lstsq(J, change, rcond=1e-9)[0]
    return float(np.sqrt(float(change @ change) / max(system.count, 1)))
