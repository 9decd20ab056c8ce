"""What a log leaves open: causes it cannot tell apart, or, where there are none, causes it could not have shown."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Parameter, Site
from vsalog.diagnosis.fit import Fit, applied, fitted
from vsalog.diagnosis.joint import JointDiagnosis
from vsalog.diagnosis.selection import related
from vsalog.diagnosis.setting import setting_of

Array = NDArray[np.float64]

# So many hypotheses are held against each other at most, and so many causes that the log would not have shown.
MOST, HIDDEN = 4, 3
# A cause of an ordinary size changes what the rig says by this share, or by so many of its parameter's small steps.
ORDINARY, STEPS = 0.1, 30.0


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What may be wrong with a rig.

    Attributes
    ----------
    site : what is in question; none for nothing
    sites : with all that is beside it
    values : of all parameters, as the log has them
    """

    site: Site | None
    sites: tuple[Site, ...]
    values: Array


@dataclass(frozen=True, slots=True)
class Question:
    """Two hypotheses, and how far this log has them apart.

    Attributes
    ----------
    one, other : the hypotheses; `other` is nothing where causes that the log could not show are in question
    now : D of this log, see `suggest`
    confused : whether the log says that one of the two is right
    size : of the cause in question, what people are told, and its unit; none for causes that are confused
    """

    one: Hypothesis
    other: Hypothesis
    now: float
    confused: bool
    size: tuple[float, str] | None = None


@dataclass(frozen=True, slots=True)
class Questions:
    """What is asked, and whether these are causes that were confused."""

    asked: tuple[Question, ...]
    confused: bool


def questions_of(found: JointDiagnosis) -> Questions:
    """Return what a joint's log leaves open."""
    asked = _confused(found)
    return Questions(asked, True) if asked else Questions(_hidden(found), False)


def _confused(found: JointDiagnosis) -> tuple[Question, ...]:
    """Return the pairs of causes that the log explains equally well with: of the weightiest cause that has any."""
    system, joint, blocks = found.system, found.joint, found.selection.blocks
    for one in found.found:
        # What happened once is told by recording again, however that is done.
        sites = [r.site for r in one.choice.rivals if not (r.site.transient or one.site.transient)]
        if not sites:
            continue
        rest = tuple(s for s in found.fit.sites if s.key != one.site.key)
        beside = np.concatenate([found.fit.own(s) for s in rest]) if rest else np.zeros(0)
        fits = [(one.site, found.fit)]
        for rival in one.choice.rivals:
            if rival.site in sites and len(fits) < MOST:
                start = np.concatenate([beside, rival.fit.own(rival.site)])
                fits.append((rival.site, fitted(system, joint, (*rest, rival.site), start, blocks)))
        return tuple(
            Question(_hypothesis(*a), _hypothesis(*b), _apart(a[1], b[1], system.count), True)
            for a, b in combinations(fits, 2)
        )
    return ()


def _hypothesis(site: Site, fit: Fit) -> Hypothesis:
    return Hypothesis(site, fit.sites, fit.values)


def _apart(one: Fit, other: Fit, count: int) -> float:
    """Return how far two fits are apart on the log."""
    return float(np.sqrt(abs(other.residual @ other.residual - one.residual @ one.residual) / max(count, 1)))


def _hidden(found: JointDiagnosis) -> tuple[Question, ...]:
    """Return the causes that the log would show least of, at an ordinary size, each against nothing."""
    system, fit, joint = found.system, found.fit, found.joint
    nothing = Hypothesis(None, fit.sites, fit.values)
    setting = setting_of(joint, system)
    asked = list[Question]()
    # What the rig predicts of the log as it stands is taken away, so that noise does not count as a difference.
    base = system.whitened(applied(joint, fit.sites, fit.values)).ravel()
    for cause in catalogue().values():
        for site in cause.sites(setting):
            if len(site.parameters) > 1 or site.transient or any(related(site, s) for s in fit.sites):
                continue
            value = _ordinary(site.parameters[0])
            values = np.concatenate([fit.values, [value]])
            change = system.whitened(applied(joint, (*fit.sites, site), values)).ravel() - base
            if fit.values.size:
                J = fit.jacobian
                change = change - J @ np.linalg.lstsq(J, change, rcond=1e-9)[0]
            now = float(np.sqrt(change @ change / max(system.count, 1)))
            told, unit = next(iter(site.reported([value]).values()))
            start = next(iter(site.reported([site.parameters[0].start]).values()))[0]
            one = Hypothesis(site, (*fit.sites, site), values)
            asked.append(Question(one, nothing, now, False, (abs(told - start), unit)))
    return tuple(sorted(asked, key=lambda q: q.now)[:HIDDEN])


def _ordinary(parameter: Parameter) -> float:
    """Return a value that is neither tiny nor gross."""
    change = max(ORDINARY * abs(parameter.start), STEPS * parameter.step)
    value = parameter.start + change
    return float(value if value <= parameter.high else parameter.start - change)
