"""Perturbations: changes of the signals or the tuning, and how far an estimate moves with them.

Encoder steps that repeat with the motion, a motion that is hardly sampled, a prior that is too strong: none shows in a residual.
But it can be made larger, and the estimate be run again. How far it moves shows how far it is off already (simulation
extrapolation: Cook and Stefanski, JASA 89, 1994).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import PART
from vsalog.core.finding import Finding
from vsalog.core.model import JointModel
from vsalog.core.progress import counted
from vsalog.core.signals import JointSignals
from vsalog.core.significance import INTERVAL
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.equation import REPORTED_CHANGE, SUPPORTED_SHARE
from vsalog.estimators.fold import Fold, Method, follows_changes
from vsalog.estimators.folding import Estimated, run
from vsalog.estimators.tuning import Tuning
from vsalog.uncertainty.shift import Spread, beyond_noise, change, spread_over

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Samples that are tried [1], a minute at 1 kHz: such errors repeat with the motion, and show as soon as it repeats.
TRIED_SAMPLES = PART


class Subject(NamedTuple):
    """What is perturbed: the method, what it was built for, and the fold that was built."""

    method: Method
    device: Device
    signals: JointSignals
    tuning: Tuning
    fold: Fold


class Trial(NamedTuple):
    """A fold, the signals it shall be run on, and which samples of the subject's these are."""

    fold: Fold
    signals: JointSignals
    every: slice = slice(None)


class Perturbation(Protocol):
    """A change that makes an error larger.

    Attributes
    ----------
    name : one noun, unique
    scale : the estimate's own error as a part of a trial's shift
    while_learning : whether a shift falls while the recursion learns, so that it is counted sample by sample
    uniform : whether it moves a stiffness by the same part everywhere, so that one number suffices
    own_noise : which part of a trial's variance its difference from the estimate has by noise alone
    """

    name: str
    scale: float
    uniform: bool
    own_noise: float
    while_learning: bool

    def trials(self, subject: Subject) -> Iterable[Trial] | None:
        """Return the trials, empty where the method refuses them all; None where the error cannot matter."""

    def findings(self, subject: Subject, shift: Shift) -> list[Finding]:
        """Return the findings about a shift."""


@dataclass(frozen=True, slots=True)
class Shift:
    """What the trials of one perturbation show.

    Attributes
    ----------
    spreads : of each stiffness that moves, transmission by transmission and of the total
    significant : by which part at most, beyond what noise may do
    overall : by which part, in the median of all samples, and its noise, one standard deviation
    samples : the square of the part by which each tried sample moves beyond noise, shape (N,); where shifts fall while the
        recursion learns
    covariance : of the coefficients of each transmission's model
    supported : whether a stiffness is excited in some trial where it is in the estimate; true where it is excited nowhere
    """

    spreads: Mapping[str, Spread]
    significant: Mapping[str, float]
    overall: Mapping[str, tuple[float, float]]
    samples: Mapping[str, Array]
    covariance: Mapping[str, Array]
    supported: bool

    def squares(self, name: str, columns: Mapping[str, NDArray[np.generic]], first: int) -> Array | float:
        """Return the square of the part by which a stiffness is off in rows of a trace, the first of them of that number."""
        if name not in self.spreads:
            return 0.0
        spread = self.spreads[name]
        found = spread.at(*_places(columns)[: len(spread.places)], count=len(columns["stiffness"])) ** 2
        # An estimate that a recursion does not have yet it may have later, at the same deflection.
        own = self.samples.get(name, np.empty(0))[first : first + found.size]
        found[: own.size] = np.maximum(found[: own.size], own)
        return found

    def largest(self, name: str) -> float:
        """Return the largest part by which a stiffness moves beyond noise and that is reported, else zero."""
        significant = self.significant.get(name, 0.0)
        return significant if significant > REPORTED_CHANGE else 0.0


@dataclass(frozen=True, slots=True)
class Trials:
    """What all perturbations of a subject show."""

    subject: Subject
    shifts: Mapping[Perturbation, Shift]

    def findings(self) -> list[Finding]:
        """Return the shifts that are worth reporting."""
        return [found for kind, shift in self.shifts.items() for found in kind.findings(self.subject, shift)]

    def widened(self, trace: Trace, first: int = 0) -> Trace:
        """Return rows of a trace, after `first` others, with standard deviations that count all shifts in.

        What is too uncertain then is not excited.
        """
        parts = dict(trace.transmissions)
        for name, columns in parts.items():
            stiffness, std = (np.asarray(columns[k], dtype=np.float64) for k in ("stiffness", "stiffness_std"))
            share = sum(shift.squares(name, columns, first) for shift in self.shifts.values())
            std = np.sqrt(std**2 + share * stiffness**2)
            excited = np.asarray(columns["excited"], dtype=np.bool_) & (std < SUPPORTED_SHARE * stiffness)
            parts[name] = {**columns, "stiffness_std": std, "excited": excited}
        return replace(trace, transmissions=parts)

    def widened_model(self, model: JointModel) -> JointModel:
        """Return a model whose covariances count all shifts in."""
        parts = []
        for part in model.transmission:
            added = sum(s.covariance[part.name] for s in self.shifts.values() if part.name in s.covariance)
            covariance = np.array(part.covariance) + added
            rows = tuple(tuple(float(x) for x in row) for row in covariance)
            parts.append(msgspec.structs.replace(part, covariance=rows))
        return msgspec.structs.replace(model, transmission=tuple(parts))


def run_trials(subject: Subject, perturbations: Sequence[Perturbation], base: Estimated | None = None) -> Trials:
    """Run an estimator again under perturbations, and compare.

    Parameters
    ----------
    subject : what is perturbed; no more than its first `TRIED_SAMPLES` are looked at
    perturbations : by name unique
    base : the estimate of all samples of the subject, where it is known
    """
    part = subject._replace(signals=subject.signals[:TRIED_SAMPLES])
    if len(part.signals) < len(subject.signals):
        base = None
    shifts = {}
    for perturbation in counted("perturbations", perturbations):
        trials = perturbation.trials(part)
        if trials is not None:
            base = base or run(part.fold, part.signals)
            if follows_changes(part.fold):
                # Its choices from the log are not perturbed, and take the most time.
                part = part._replace(fold=part.fold.settled(base.state))
                trials = perturbation.trials(part) or ()
            shifts[perturbation] = _shift(perturbation, part, base, trials)
    return Trials(part, shifts)


def tried(subject: Subject, perturbations: Sequence[Perturbation]) -> Trace:
    """Return an estimator's trace of signals that fit into memory, with what perturbations show counted in."""
    base = run(subject.fold, subject.signals)
    return run_trials(subject, perturbations, base).widened(base.trace)


def _shift(perturbation: Perturbation, subject: Subject, base: Estimated, trials: Iterable[Trial]) -> Shift:
    """Return what the trials of a perturbation show."""
    scale, whole = perturbation.scale, base.trace
    before = whole.transmissions
    squares: dict[str, list[tuple[Array, Array]]] = {name: [] for name in before}
    moved: dict[str, list[Array]] = {}
    model, supported = _coefficients(subject.fold, base.state), not _excited(whole)
    for trial in trials:
        blocks, state = run(trial.fold, trial.signals)
        after = Trace.concatenate(blocks)
        supported = supported or _excited(after)
        for name in before:
            squares[name].append(change(before[name], after[name], trial.every))
        for name, (coefficients, covariance) in _coefficients(trial.fold, state).items():
            allowed = perturbation.own_noise * covariance
            moved.setdefault(name, []).append(scale**2 * beyond_noise(coefficients - model[name][0], allowed))
    spreads, significant, overall, samples = {}, {}, {}, {}
    for name, pairs in squares.items():
        if not pairs:
            continue
        places = _places(before[name])
        excited = np.asarray(before[name]["excited"], dtype=np.bool_)
        changes, noise = (np.array(part) for part in zip(*pairs, strict=True))
        if perturbation.uniform:
            places, changes = [], _middles(changes, excited)
        shifted, noise = (scale * changes) ** 2, scale**2 * perturbation.own_noise * noise
        known = excited & np.isfinite(shifted).any(axis=0)
        if known.any():
            middle = (float(np.sqrt(np.nanmedian(x[:, known]))) for x in (shifted, noise))
            overall[name] = (next(middle), next(middle))
        spread = spread_over(places, excited, shifted - noise)
        if spread is not None and spread.most > 0.0:
            spreads[name] = spread
            significant_shift = shifted - INTERVAL**2 * noise
            beyond = spread_over(places, excited, significant_shift)
            significant[name] = 0.0 if beyond is None else beyond.most
            if perturbation.while_learning:
                samples[name] = np.nanmax(significant_shift, axis=0, initial=0.0)
    return Shift(
        spreads, significant, overall, samples, {name: np.mean(m, axis=0) for name, m in moved.items()}, supported
    )


def _middles(changes: Array, excited: Flags) -> Array:
    """Return the median of each trial's changes where it has any and the estimate is excited, shape (n, N)."""
    known = np.isfinite(changes) & excited
    middles = [np.median(row[there]) if there.any() else np.nan for row, there in zip(changes, known, strict=True)]
    return np.where(np.isfinite(changes), np.array(middles)[:, None], np.nan)


def _places(columns: Mapping[str, NDArray[np.generic]]) -> list[Array]:
    """Return what a stiffness depends on: the deflection, and the set-point where there is one."""
    return [np.asarray(columns[k], dtype=np.float64) for k in ("deflection", "setpoint") if k in columns]


def _excited(trace: Trace) -> bool:
    return any(bool(np.any(columns["excited"])) for columns in trace.transmissions.values())


def _coefficients(fold: Fold, state: Any) -> dict[str, tuple[Array, Array]]:
    """Return the coefficients of each transmission's model and their covariance."""
    parts = fold.model(state).transmission
    return {part.name: (np.array(part.coefficients), np.array(part.covariance)) for part in parts}
