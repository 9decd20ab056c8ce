"""Causes that were found and kept, with their numbers and what each takes away of what was wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.fit import Fit, covariance_of, fitted
from vsalog.diagnosis.held_out import others_of
from vsalog.diagnosis.selection import Choice, Selection
from vsalog.diagnosis.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Found:
    """A cause that was found and kept.

    Attributes
    ----------
    site : of the catalogue
    values, covariance : as fitted
    choice : why it was chosen
    removed : part of what the rig left over, beyond noise, that it takes away
    """

    site: Site
    values: Array
    covariance: Array
    choice: Choice
    removed: float

    def numbers(self) -> dict[str, tuple[float, float, str]]:
        """Return name → value, standard deviation, unit, as people are told."""
        told = self.site.reported(self.values.tolist())
        slopes = np.zeros((len(told), self.values.size))
        for i, parameter in enumerate(self.site.parameters):
            step = 1e-3 * max(abs(parameter.step), 1e-12)
            moved = self.values.copy()
            moved[i] += step
            there = self.site.reported(moved.tolist())
            slopes[:, i] = [(there[name][0] - value) / step for name, (value, _) in told.items()]
        variance = np.maximum(np.diag(slopes @ self.covariance @ slopes.T), 0.0)
        exact = catalogue()[self.site.cause].exact
        blur = {p.name: p.blur for p in self.site.parameters}
        beside = [(exact * value) ** 2 + blur.get(name, 0.0) ** 2 for name, (value, _) in told.items()]
        spread = np.sqrt(variance + np.array(beside))
        return {name: (value, float(s), unit) for (name, (value, unit)), s in zip(told.items(), spread, strict=True)}


def found_by(system: System, joint: Any, selection: Selection, fit: Fit) -> list[Found]:
    """Return the causes of a fit with what each takes away, the weightiest first."""
    if not fit.sites:
        return []
    covariance = covariance_of(fit, selection.blocks)
    out, first = [], 0
    for site, removed in zip(fit.sites, _removed(system, joint, selection, fit), strict=True):
        own = slice(first, first + len(site.parameters))
        first += len(site.parameters)
        choice = next(c for c in selection.choices if c.site.key == site.key)
        out.append(Found(site, fit.values[own], covariance[own, own], choice, removed))
    return sorted(out, key=lambda f: -f.removed)


def _removed(system: System, joint: Any, selection: Selection, fit: Fit) -> list[float]:
    """Return the part of what was wrong that each cause takes away.

    What two causes take away together is more, or less, than what each does alone: a cause's part is the mean of what it takes
    away as the first one and as the last one, and the parts add up to what all do.
    """
    nothing = selection.nothing
    wrong = max(nothing.loss - system.count, 1e-300)
    parts = []
    for site in fit.sites:
        if len(fit.sites) == 1:
            parts.append(nothing.loss - fit.loss)
            continue
        alone = fitted(system, joint, (site,), fit.own(site), selection.blocks)
        without_it = fitted(system, joint, *others_of(fit, site), selection.blocks)
        parts.append(max(nothing.loss - alone.loss, 0.0) + max(without_it.loss - fit.loss, 0.0))
    whole = float(np.clip((nothing.loss - fit.loss) / wrong, 0.0, 1.0))
    return [whole * part / max(sum(parts), 1e-300) for part in parts]
