"""Several estimators on one log, side by side: one run of `compare`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.comparison.references import References, references_of
from vsalog.core.errors import BindingError, EstimatorError, FilterError, OtherKindError, VsalogError
from vsalog.core.finding import Finding, Findings
from vsalog.core.significance import INTERVAL
from vsalog.core.trace import Trace
from vsalog.estimation.job import Job, Options, prepare
from vsalog.estimation.joint import PAPER, PRESET, JointEstimate, no_preset
from vsalog.estimators.registry import method
from vsalog.estimators.tuning import read_tuning
from vsalog.validation.document import Score
from vsalog.validation.scores import score

Array = NDArray[np.float64]
Progress = Callable[[str], None]

# The estimators to try by default; a log's roles decide which are possible.
USUAL = (
    "residual-rls",
    "residual-rls:modality=SENSOR",
    "residual-rls:modality=MODEL",
    "qr-rls",
    "batch-ls",
    "smoother",
    "direct",
    "algebraic",
    "impedance",
    "impedance-coupled",
    "grioli-bicchi",
    "grioli-parametric",
    "acceleration-observer",
    "pam-ukf",
    "pam-smoother",
    "pam-model",
)


@dataclass(frozen=True, slots=True)
class Contender:
    """An estimator with its tuning, as asked for: ``residual-rls:modality=SENSOR:forgetting=0.99``."""

    label: str
    name: str
    tune: Mapping[str, str]

    @classmethod
    def parse(cls, text: str) -> Contender:
        """Read NAME[:KEY=VALUE…].

        Raises
        ------
        EstimatorError
            It is not of that form.
        """
        name, *pairs = text.strip().split(":")
        tune = {}
        for pair in pairs:
            key, equals, value = pair.partition("=")
            if not equals or not key.strip():
                raise EstimatorError(f"'{text}': write NAME or NAME:KEY=VALUE, such as residual-rls:modality=SENSOR")
            tune[key.strip()] = value.strip()
        return cls(text.strip(), name.strip(), tune)

    def check(self, tune: Mapping[str, str]) -> None:
        """Refuse an unknown name or tuning, whatever the log allows; `tune` is that of all contenders.

        Raises
        ------
        EstimatorError
            There is no such estimator, or it has no such tuning.
        """
        if self.name != "auto":
            given = {**tune, **self.tune}
            if given.get(PRESET, PAPER) != PAPER:
                raise EstimatorError(no_preset(given[PRESET]))
            found = method(self.name)
            read_tuning(found.TUNING, self.name, {key: value for key, value in given.items() if key != PRESET})


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One estimator on one transmission of one joint; null where the log does not determine it.

    Attributes
    ----------
    estimator : as asked for
    joint, transmission : names
    stiffness_low, stiffness_high : 1 % and 99 % quantile over the excited rows [N·m/rad]
    relative_std : root mean square of stiffness_std / stiffness
    torque_left : RMS residual of the fit [N·m]
    off_sensor : root mean square of the fitted torque less the torque sensor's, over the excited rows [N·m]
    excited_share : share of the rows at which the estimate is excited
    agrees_share : share of the rows excited for both at which it agrees with the first estimator within two standard deviations
    difference : root mean square of the difference to the first, relative to the first's stiffness
    against_truth : stiffness against a simulator's, over the excited rows of the log's second half
    """

    estimator: str
    joint: str
    transmission: str
    stiffness_low: float | None
    stiffness_high: float | None
    relative_std: float | None
    torque_left: float | None
    off_sensor: float | None
    excited_share: float
    agrees_share: float | None
    difference: float | None
    against_truth: Score | None


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """What the estimators found.

    Attributes
    ----------
    logs : names
    rows : all of them
    left_out : estimators that cannot run on the logs, with the reason
    failed : estimators that ended by a bug in vsalog, with its message
    findings : of all estimators; what several have in common is one finding, with the numbers of the first
    warnings : the findings, in words
    """

    logs: tuple[str, ...]
    rows: tuple[Row, ...]
    left_out: dict[str, str]
    failed: dict[str, str] = {}
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Run:
    """The results of one estimator on the logs."""

    contender: Contender
    job: Job
    estimates: Sequence[JointEstimate]


def compare(
    logs: Sequence[Path],
    options: Options,
    asked: Sequence[str],
    progress: Progress = lambda _: None,
    keep_going: bool = True,
) -> tuple[Comparison, list[Run], References]:
    """Run several estimators; return the comparison, its runs, and their references.

    Parameters
    ----------
    logs : several make one model
    options : as for `estimate`; its estimator is ignored
    asked : estimators, `Contender.parse`; all that the logs allow when empty
    progress : called with what is being done
    keep_going : an exception that is no `VsalogError`, hence a bug, ends its estimator only

    Raises
    ------
    VsalogError
        There is no such estimator or tuning, or none of the estimators can run on the logs.
    """
    runs: list[Run] = []
    faults: dict[str, Exception] = {}
    left_out: dict[str, str] = {}
    other_kind: set[str] = set()
    contenders = _once(Contender.parse(text) for text in asked or USUAL)
    for contender in contenders:
        contender.check(options.tune)
    for contender in contenders:
        try:
            chosen = replace(options, estimator=contender.name, tune={**options.tune, **contender.tune})
            job = prepare(logs, chosen, progress)
            progress(f"estimating by {contender.label}")
            runs.append(Run(contender, job, job.run()))
        except (BindingError, EstimatorError, FilterError) as error:
            left_out[contender.label] = str(error)
            if isinstance(error, OtherKindError):
                other_kind.add(contender.label)
        except (VsalogError, OSError):
            raise
        except Exception as error:
            if not keep_going:
                raise
            faults[contender.label] = error
    if not runs and faults:
        raise next(iter(faults.values()))
    if not runs:
        # Of the usual ones the first reason is enough.
        reasons = list(left_out.values()) if len(left_out) == 1 or not asked else []
        raise EstimatorError(reasons[0] if reasons else "; ".join(f"{name}: {why}" for name, why in left_out.items()))
    joints = {e.joint: runs[0].job.rig.joints[e.joint] for run in runs for e in run.estimates}
    references = references_of(logs[0], options, joints) if len(logs) == 1 else References()
    rows = [row for run in runs for estimate in run.estimates for row in _rows(run, estimate, runs[0], references)]
    return (
        Comparison(
            logs=tuple(log.name for log in logs),
            rows=tuple(rows),
            # By default, methods for other joints are not mentioned.
            left_out={label: why for label, why in left_out.items() if asked or label not in other_kind},
            failed={label: f"{type(fault).__name__}: {fault}" for label, fault in faults.items()},
            findings=_each_cause_once(
                (*run.job.findings, *(finding for e in run.estimates for finding in e.findings)) for run in runs
            ),
        ),
        runs,
        references,
    )


def _each_cause_once(found: Iterable[Iterable[Finding]]) -> tuple[Finding, ...]:
    """Return the findings of all runs; those of one code about one part of a joint have one cause, whatever the estimator."""
    kept = dict[tuple[object, ...], Finding]()
    for own in found:
        seen = Counter[tuple[object, ...]]()
        for one in Findings(own):
            about = (one.code, one.log, one.joint, one.part, one.severity)
            seen[about] += 1  # a second one of the same run is another one
            first = kept.setdefault((*about, seen[about]), one)
            names, name = str(first.evidence.get("estimator", "")).split(", "), one.evidence.get("estimator")
            if name and name not in names and one.evidence.get("reference") == first.evidence.get("reference"):
                evidence = {**first.evidence, "estimator": ", ".join((*names, str(name)))}
                kept[*about, seen[about]] = msgspec.structs.replace(first, evidence=evidence)
    return tuple(kept.values())


def _once(contenders: Iterable[Contender]) -> list[Contender]:
    """Leave out repeated estimators: equal ones give equal rows."""
    return list({(c.name, tuple(sorted(c.tune.items()))): c for c in reversed(list(contenders))}.values())[::-1]


def _rows(run: Run, estimate: JointEstimate, first: Run, references: References) -> list[Row]:
    reference = next((e for e in first.estimates if e.joint == estimate.joint), None)
    trace = estimate.trace
    rows = []
    for part in estimate.summary.transmissions:
        mine = _columns(trace, part.transmission)
        whose = estimate.joint, part.transmission, trace
        agrees, difference = None, None
        if run is not first and reference is not None:
            agrees, difference = _agreement(mine, _columns(reference.trace, part.transmission))
        rows.append(
            Row(
                estimator=run.contender.label,
                joint=estimate.joint,
                transmission=part.transmission,
                stiffness_low=part.stiffness_low,
                stiffness_high=part.stiffness_high,
                relative_std=part.relative_std,
                torque_left=part.fit_rms,
                off_sensor=_off_sensor(references.torque(*whose), mine),
                excited_share=part.excited_share,
                agrees_share=agrees,
                difference=difference,
                against_truth=_against(trace, references.stiffness(*whose), mine),
            )
        )
    return rows


def _columns(trace: Trace, transmission: str) -> dict[str, Array]:
    columns = trace.transmissions[transmission]
    names = ("stiffness", "stiffness_std", "excited", "flexibility_torque_fit")
    return {name: np.asarray(columns[name], dtype=np.float64) for name in names}


def _agreement(mine: Mapping[str, Array], theirs: Mapping[str, Array]) -> tuple[float | None, float | None]:
    if mine["stiffness"].shape != theirs["stiffness"].shape:
        return None, None
    both = (mine["excited"] > 0.0) & (theirs["excited"] > 0.0)
    if not both.any():
        return None, None
    gap = (mine["stiffness"] - theirs["stiffness"])[both]
    spread = np.hypot(mine["stiffness_std"], theirs["stiffness_std"])[both]
    relative = gap / theirs["stiffness"][both]
    return float(np.mean(np.abs(gap) <= INTERVAL * spread)), float(np.sqrt(np.mean(relative**2)))


def _against(trace: Trace, true: Array | None, mine: Mapping[str, Array]) -> Score | None:
    """Score a stiffness by the truth, over the excited part of the log's second half."""
    settled = (mine["excited"] > 0.0) & (trace.time > 0.5 * (trace.time[0] + trace.time[-1]))
    return None if true is None else score(mine["stiffness"][settled], true[settled])


def _off_sensor(measured: Array | None, mine: Mapping[str, Array]) -> float | None:
    """Return the RMS difference of a fitted torque from the torque sensor where it is excited."""
    if measured is None:
        return None
    off = (mine["flexibility_torque_fit"] - measured)[mine["excited"] > 0.0]
    off = off[np.isfinite(off)]
    return float(np.sqrt(np.mean(off**2))) if off.size else None
