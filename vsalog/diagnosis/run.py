"""One run of `diagnose`: a log and its rig in, what is wrong and the extended rig out."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog._version import __version__
from vsalog.binding.joint import bind, names_of, offered_roles, runs_of, wanted_channels
from vsalog.checks.recording_faults import log_findings
from vsalog.core.errors import BindingError, DiagnosisError, RigError, VsalogError, did_you_mean
from vsalog.core.finding import Finding, of_log
from vsalog.core.finding_texts import sentences_of
from vsalog.core.printable import command
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.core.units import shown
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.describe import (
    causes_of,
    equation_errors,
    evidence_of,
    gains_of,
    log_errors,
    signal_errors,
    unexplained_of,
)
from vsalog.diagnosis.document import VERSION, Diagnosis, FoundCause, Gain, Gains, Verdict
from vsalog.diagnosis.evidence import JointEvidence
from vsalog.diagnosis.joint import HELD_OUT, JointDiagnosis, Progress, diagnose_joint
from vsalog.diagnosis.linear import placed
from vsalog.diagnosis.priors import felt
from vsalog.diagnosis.stiffness_gain import stiffness_gains
from vsalog.diagnosis.suggest import Suggestion, suggest
from vsalog.diagnosis.trends import trends_of
from vsalog.estimation.job import sha256
from vsalog.estimation.joint import pick_joints
from vsalog.estimation.missing_channels import without_channels
from vsalog.estimation.modalities import Traces, stiffness_change, stiffness_traces
from vsalog.readers import open_reader, read
from vsalog.residuals.per_log import PerLog
from vsalog.residuals.sensing import as_written, at_joint, bare, motors_of, sensors_as_written
from vsalog.rig import Rig
from vsalog.rig.find import find_rig
from vsalog.rig.schema import PneumaticJoint, RigidJoint

# Of several joints, or runs, the log's verdict is the first of these that one of them has.
WORST_FIRST: tuple[Verdict, ...] = (
    "unexplained",
    "partly explained",
    "explained",
    "consistent as far as checked",
    "consistent",
)


@dataclass(frozen=True, slots=True)
class Options:
    """What can be asked of `diagnose`; the command line's options of the same names.

    Attributes
    ----------
    rig : a loaded rig, a rig file or a preset's name; looked for in the log and next to it when absent
    joints : names of the joints wanted; all when empty
    set : key → value of the rig
    rate, time : as for `estimate`
    suggest : propose the next experiment
    differs : causes that may differ from log to log
    start, end : as for `estimate`; another log that is held out is used whole
    """

    rig: Rig | str | Path | None = None
    joints: tuple[str, ...] = ()
    set: Mapping[str, str] = field(default_factory=dict)
    rate: float | None = None
    time: str = "auto"
    suggest: bool = False
    start: str | None = None
    end: str | None = None
    differs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run gives.

    Attributes
    ----------
    diagnosis : the document, without its words: the report makes them
    evidence : what figures draw, joint by joint
    rig : as given
    extended : with the causes filled in; none where there is nothing to fill in
    proposed : the next experiment; none where it was not asked for, or nothing can be proposed
    """

    diagnosis: Diagnosis
    evidence: tuple[JointEvidence, ...]
    rig: Rig
    extended: Rig | None
    proposed: Suggestion | None = None


def diagnose(
    log: Path | Sequence[Path],
    holdout: Path | Sequence[Path] | None,
    options: Options,
    progress: Progress = lambda _: None,
) -> Outcome:
    """Compare a rig with a log, or several of one machine together, and name what is wrong with it.

    Parameters
    ----------
    log : to learn from
    holdout : other logs of the same machine, to measure the gain on
    options : what is asked for
    progress : called with the step that begins

    Raises
    ------
    VsalogError
        A log cannot be read, the rig is missing or does not fit, or the roles allow nothing to be checked.
    """
    logs, holdouts = _listed(log), _listed(holdout)
    rig = rig_for(logs[0], options)
    wanted = pick_joints(rig.joints, options.joints)
    usable = {name: _alone(rig, name, joint) for name, joint in wanted.items()}
    differs = {name: _differing(joint, options.differs) for name, joint in usable.items()}
    hashes = [sha256(path) for path in logs]
    for i, own in enumerate(hashes):
        if own in hashes[:i]:
            raise DiagnosisError(f"{logs[i].name}: is given twice, and would count as two logs")
    require_other(holdouts, hashes)
    progress(f"reading {', '.join(path.name for path in logs)}")
    recordings = [read_wanted(path, usable, options) for path in logs]
    whole = dataclasses.replace(options, start=None, end=None)
    others = [read_wanted(path, usable, whole) for path in holdouts]
    begins = [_begin(recording) for recording in recordings]
    if None not in begins:
        # What differs from log to log is as it was in the last one, by their dates.
        order = sorted(range(len(logs)), key=lambda k: begins[k] or 0.0)
        logs, hashes = [logs[k] for k in order], [hashes[k] for k in order]
        recordings, begins = [recordings[k] for k in order], [begins[k] for k in order]
    names = names_of(logs)
    title = ", ".join(names)
    found, findings, left_out = list[JointDiagnosis](), list[Finding](), list[Finding]()
    for name, joint in usable.items():
        lacking = [
            f
            for path, one in zip(logs, recordings, strict=True)
            for f in without_channels(
                path, options.rate, wanted_channels(joint, path.name) - set(one.channels), name, joint
            )[1]
        ]
        findings += lacking
        try:
            signals = _one_after_another(bound_as_recorded(recordings, name, joint))
            if isinstance(joint, RigidJoint) and name in _chained(rig) and "torque_sensor" not in signals.roles:
                raise DiagnosisError(
                    f"joint '{name}': is one with a link that the others of the chain move, and no torque sensor measures how"
                )
            other = _one_after_another(bound_as_recorded(others, name, joint, set(signals.roles))) if others else None
            findings += [*signals.findings, *log_findings(recordings, name, joint)]
            stated = felt(joint, rig.tolerances[name])
            parts = [(name, _by_log(signals, recordings, joint))] if len(logs) > 1 else _runs(name, signals)
            found += [
                diagnose_joint(label, joint, part, other, progress, stated, len(logs), differs[name])
                for label, part in parts
            ]
        except VsalogError as error:
            if len(usable) == 1:
                raise DiagnosisError("; ".join([str(error), *sentences_of(lacking[:2])])) from error
            left_out.append(left_out_for(name, error))
    if not found:
        reasons = sentences_of((*findings, *left_out))
        raise DiagnosisError(f"{title}: no joint of the rig can be diagnosed: {'; '.join(reasons)}")
    chained = (f.name for f in found if f.name in _chained(rig))
    findings += [*left_out, *(Finding(code="diagnosis.link_of_chain", joint=name, severity="info") for name in chained)]
    proposed = _proposed(rig, found, findings, progress) if options.suggest else None
    findings += [finding for f in found for finding in f.findings]
    left = max((unexplained_of(f) for f in found), key=lambda u: u.fraction)
    verdict = min((f.verdict for f in found), key=WORST_FIRST.index)
    # Causes that are not believed are not filled into a rig.
    extended = None if verdict == "unexplained" else _extended(rig, found)
    measured, causes, stiffness = (others or recordings)[0], list[FoundCause](), list[Gain]()
    for one in found:
        gains, changes = _stiffness(one, rig, extended, measured, progress)
        causes += causes_of(one, changes, names)
        stiffness += gains
    simulated = [g for f in found for g in gains_of(f)]
    where = next((f.held_out for f in found if f.gain is not None), HELD_OUT if others else "the log")
    document = Diagnosis(
        version=VERSION,
        vsalog=__version__,
        log=title,
        log_sha256=" ".join(hashes),
        holdout=", ".join(names_of(holdouts)) or None,
        holdout_sha256=" ".join(map(sha256, holdouts)) or None,
        rig=rig.to_toml(),
        settings=_settings(options),
        verdict=verdict,
        sentences=(),
        p_values={f.name: f.selection.p_value for f in found if f.selection.p_value is not None},
        simulation_error=tuple(e for f in found for e in signal_errors(f)),
        equations=tuple(e for f in found for e in equation_errors(f)),
        causes=tuple(causes),
        gain=Gains(holdout=bool(others), where=where, signals=(*simulated, *stiffness)),
        unexplained=left,
        next_experiment="",
        findings=(*(f for n, r in zip(names, recordings, strict=True) for f in of_log(n, r.findings)), *findings),
        logs=tuple(e for f in found for e in log_errors(f, names, [None if b is None else _date(b) for b in begins])),
        trends=tuple(t for f in found if f.shares for t in trends_of(f, names, begins)),
    )
    drawn = ", ".join(names_of(holdouts)) or title
    evidence = tuple(evidence_of(f, drawn) for f in found)
    # A spring that was fitted, since the rig has none, is no cause.
    return Outcome(document, evidence, rig, extended if causes else None, proposed)


def _listed(paths: Path | Sequence[Path] | None) -> list[Path]:
    if paths is None:
        return []
    return [paths] if isinstance(paths, Path) else list(paths)


def _differing(joint: Any, asked: Sequence[str]) -> frozenset[str]:
    """Return the causes that may differ from log to log, as it is asked for, or the rig has it.

    Raises
    ------
    DiagnosisError
        There is no such cause.
    """
    for where, names in (("--differs", asked), ("the rig's 'differs'", joint.differs)):
        for name in names:
            if name not in catalogue():
                hint = did_you_mean(name, list(catalogue()))
                raise DiagnosisError(f"{where}: there is no cause '{shown(name)}'{hint or '.'}")
    return frozenset((*asked, *joint.differs))


def _begin(recording: Recording) -> float | None:
    """Return when a recording begins [s since 1970]; None where its stamps are no dates."""
    first = min((int(c.stamps[0]) for c in recording.channels.values() if len(c.stamps)), default=None)
    return None if first is None or not recording.absolute_time else first * 1e-9


def _date(begin: float) -> str:
    return datetime.fromtimestamp(begin, UTC).isoformat(timespec="seconds")


def _one_after_another(signals: JointSignals) -> JointSignals:
    """Return the signals of several logs with times that go on from one to the next."""
    if len(signals.run_names) < 2:
        return signals
    time = np.array(signals.time)
    first = np.flatnonzero(np.diff(signals.run, prepend=-1))
    for a, b in pairwise([*first.tolist(), time.size]):
        begin = 0.0 if a == 0 else time[a - 1] + signals.period
        time[a:b] += begin - time[a]
    return dataclasses.replace(signals, time=time)


def require_other(holdouts: Sequence[Path], hashes: Collection[str]) -> None:
    """Refuse logs to be held out that are among those diagnosed, known by their SHA-256."""
    for path in holdouts:
        if sha256(path) in hashes:
            raise DiagnosisError(
                f"{path.name}: is the log itself, and so holds nothing out; leave --holdout away, or name another"
            )


def left_out_for(name: str, error: VsalogError) -> Finding:
    """Return that a joint was left out, and why."""
    reason = str(error).removeprefix(f"joint '{name}': ")
    return Finding(code="diagnosis.joint_left_out", joint=name, evidence={"reason": reason})


def _chained(rig: Rig) -> frozenset[str]:
    """Return the joints that form the rig's arm."""
    return frozenset() if rig.file.chain is None else frozenset(link.joint for link in rig.file.chain.link)


def _alone(rig: Rig, name: str, joint: Any) -> Any:
    """Return a joint as it is looked at: the link of one in a chain is moved by the others, too."""
    return replace(joint, link=None) if name in _chained(rig) else joint


def _proposed(
    rig: Rig, found: Sequence[JointDiagnosis], findings: list[Finding], progress: Progress
) -> Suggestion | None:
    """Look for the next experiment; where there is none, report why."""
    try:
        return suggest(rig, found, progress)
    except VsalogError as error:
        findings.append(Finding(code="diagnosis.no_experiment", severity="info", evidence={"reason": str(error)}))
    return None


def _extended(rig: Rig, found: Sequence[JointDiagnosis]) -> Rig | None:
    """Return the rig with what was found; parts that nothing was found in stay as they were written."""
    joints, changed = dict(rig.joints), False
    for one in found:
        original = rig.joints.get(one.name)
        # Causes found in one run are no rig for others.
        if original is None or not (one.found or one.selection.problem.setting.fitted):
            continue
        if isinstance(one.extended, PerLog) and all(site.log for site, _ in one.selection.posterior.fit):
            continue  # what differs from log to log is no rig for others
        one = dataclasses.replace(one, extended=shared_of(one))
        changed = True
        plain = at_joint(original)
        kept = {
            name: getattr(original, name)
            for name in original.__struct_fields__
            if getattr(one.extended, name) == getattr(plain, name)
        }
        motors = {m: as_written(getattr(one.extended, m), getattr(original, m)) for m in motors_of(original)}
        if one.name in _chained(rig):
            kept["link"] = getattr(original, "link", None)  # it was looked at without
        signals = {"signals": sensors_as_written(one.extended, original)}
        joints[one.name] = replace(one.extended, **(motors | signals | kept))
    return rig.with_joints(joints, f"{rig.where}, extended") if changed else None


def shared_of(found: JointDiagnosis) -> Any:
    """Return the extended joint with what holds in every log."""
    fit = found.selection.posterior.fit
    if not any(site.log for site, _ in fit):
        return found.extended
    return placed(found.joint, [(site, values) for site, values in fit if site.log is None])


def _stiffness(
    found: JointDiagnosis, rig: Rig, extended: Rig | None, recording: Recording, progress: Progress
) -> tuple[list[Gain], list[float | None]]:
    """Return what the extended rig is worth for a joint's stiffness estimate, and what each cause changes in it."""
    name = found.name
    nothing = extended is None or not found.found or name not in rig.joints or isinstance(found.extended, PerLog)
    if nothing or isinstance(found.joint, PneumaticJoint | RigidJoint):
        return [], [None] * len(found.found)
    progress(f"joint {name}: estimating its stiffness with both rigs")
    known = dict[Any, Traces]()

    def traces(one: Any) -> Traces:
        joint = replace(one.joints[name], link=None)  # neither estimate reads it
        if joint not in known:
            known[joint] = stiffness_traces(name, joint, recording)
        return known[joint]

    before, after = traces(rig), traces(extended)
    each = (found.extended_without(cause) if cause.material else None for cause in found.found)
    lacking = (joint and _extended(rig, [dataclasses.replace(found, extended=joint)]) for joint in each)
    changes = [stiffness_change(after, traces(one)) if one else None for one in lacking]
    return [] if before is after else stiffness_gains(name, before, after), changes


def rig_for(log: Path, options: Options) -> Rig:
    """Return the rig that is asked for, or found in or next to a log.

    Raises
    ------
    RigError
        There is none, or it is at fault.
    """
    text = open_reader(log, options.rate).rig_text if options.rig is None else None
    rig = find_rig(log, text, options.rig)
    if rig is None:
        raise RigError(
            f"no rig was found in or next to {log.name}, and without one there is no simulation to be wrong:"
            f" '{command('init', log, '-o', 'rig.toml')}' writes a first one, to be completed by hand; give it with --rig"
        )
    return rig.with_settings(options.set)


def read_wanted(log: Path, joints: Mapping[str, Any], options: Options) -> Recording:
    """Read the channels of a log that some joints name.

    Raises
    ------
    VsalogError
        The log cannot be read.
    """
    channels = set().union(*(wanted_channels(joint, log.name) for joint in joints.values()))
    return read(log, channels, options.time, options.rate, options.start, options.end)


def bound_as_recorded(
    recording: Recording | Sequence[Recording], name: str, joint: Any, roles: set[str] | None = None, gains: bool = True
) -> JointSignals:
    """Bind every role that a log has, as recorded, or that several logs have.

    Parameters
    ----------
    recording, name, joint : of the log or logs, and the rig
    roles : that are needed; all that every log has when absent
    gains : in the joint's units; else in those that its sensors count in

    Raises
    ------
    BindingError
        A role that is needed, or every one, is missing.
    """
    recordings = [recording] if isinstance(recording, Recording) else list(recording)
    plain, kept = bare(joint, gains=gains), set(offered_roles(joint)) if roles is None else roles
    for one in recordings:
        offered = offered_roles(plain)
        there = [r for r in offered if wanted_channels(plain, one.path.name, [r]) <= set(one.channels)]
        if not there:
            raise BindingError(
                f"{one.path.name}: none of the channels that the rig names for joint '{name}' is there;"
                f" '{command('inspect', one.path)}' lists them"
            )
        missing = sorted((roles or set()) - set(there))
        if missing:
            raise BindingError(
                f"{one.path.name}: lacks {', '.join(missing)}, which the log to be diagnosed has; another log needs the same"
                " roles"
            )
        kept = kept & set(there)
    return bind(recordings, name, plain, [r for r in offered_roles(plain) if r in kept], noise=True)


def _by_log(signals: JointSignals, recordings: Sequence[Recording], joint: Any) -> JointSignals:
    """Return the signals of several logs, each of which is one run, whatever runs it holds."""
    runs = [len(runs_of(joint, recording.path.name)) for recording in recordings]
    log = np.repeat(np.arange(len(runs), dtype=np.int32), runs)[signals.run]
    first = np.cumsum([0, *runs[:-1]])
    periods = tuple(signals.periods[k] for k in first)
    return dataclasses.replace(
        signals, run=log, run_names=tuple(names_of([r.path for r in recordings])), periods=periods
    )


def _runs(name: str, signals: JointSignals) -> list[tuple[str, JointSignals]]:
    """Return the runs of a log, each under a set-point of its own, with what they are called."""
    if len(signals.run_names) < 2:
        return [(name, signals)]
    edges = [*np.flatnonzero(np.diff(signals.run, prepend=-1)), len(signals)]
    parts = [signals[a:b] for a, b in pairwise(edges)]
    return [(f"{name}, {signals.run_names[int(part.run[0])]}", part) for part in parts]


def _settings(options: Options) -> dict[str, str]:
    asked = {
        "joints": ",".join(options.joints),
        "differs": ",".join(options.differs),
        "time": options.time,
        "start": options.start or "",
        "end": options.end or "",
        **{f"set {k}": v for k, v in options.set.items()},
    }
    asked["rate"] = "" if options.rate is None else f"{options.rate:g}"
    return {key: value for key, value in asked.items() if value}
