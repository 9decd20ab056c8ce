"""One run of `diagnose`: a log and its rig in, what is wrong and the extended rig out."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog._version import __version__
from vsalog.binding.joint import bind, offered_roles, wanted_channels
from vsalog.checks.recording_faults import log_findings
from vsalog.core.errors import BindingError, DiagnosisError, RigError, VsalogError, near_names
from vsalog.core.finding import Finding, of_log
from vsalog.core.finding_texts import sentences_of
from vsalog.core.recording import Recording
from vsalog.core.signals import JointSignals
from vsalog.diagnosis.describe import causes_of, equation_errors, evidence_of, gains_of, signal_errors, unexplained_of
from vsalog.diagnosis.document import VERSION, Diagnosis, FoundCause, Gain, Gains, Verdict
from vsalog.diagnosis.evidence import JointEvidence
from vsalog.diagnosis.joint import HELD_OUT, JointDiagnosis, Progress, diagnose_joint
from vsalog.diagnosis.priors import felt
from vsalog.diagnosis.stiffness_gain import stiffness_gains
from vsalog.diagnosis.suggest import Suggestion, suggest
from vsalog.estimation.job import sha256
from vsalog.estimation.joint import pick_joints
from vsalog.estimation.modalities import Traces, stiffness_change, stiffness_traces
from vsalog.readers import open_reader, read
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


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run gives.

    Attributes
    ----------
    diagnosis : the document, without its words: the report makes them
    evidence : what figures draw, joint by joint
    rig : as it stands
    extended : with the causes filled in; none where there is nothing to fill in
    proposed : the next experiment; none where it was not asked for, or nothing can be proposed
    """

    diagnosis: Diagnosis
    evidence: tuple[JointEvidence, ...]
    rig: Rig
    extended: Rig | None
    proposed: Suggestion | None = None


def diagnose(log: Path, holdout: Path | None, options: Options, progress: Progress = lambda _: None) -> Outcome:
    """Hold a rig against a log, and name what is wrong with it.

    Parameters
    ----------
    log : to learn from
    holdout : another log of the same machine, to measure the gain on
    options : what is asked for
    progress : called with the step that begins

    Raises
    ------
    VsalogError
        A log cannot be read, the rig is missing or does not fit, or the roles allow nothing to be checked.
    """
    rig = rig_for(log, options)
    wanted = pick_joints(rig.joints, options.joints)
    usable = {name: _alone(rig, name, joint) for name, joint in wanted.items()}
    if holdout is not None and sha256(holdout) == sha256(log):
        raise DiagnosisError(
            f"{holdout.name}: is the log itself, and so holds nothing out; leave --holdout away, or name another"
        )
    progress(f"reading {log.name}")
    recording = read_wanted(log, usable, options)
    second = (
        None if holdout is None else read_wanted(holdout, usable, dataclasses.replace(options, start=None, end=None))
    )
    found, findings, left_out = list[JointDiagnosis](), list[Finding](), list[Finding]()
    for name, joint in usable.items():
        lacking = _lacking(log, options, recording, name, joint)
        findings += lacking
        try:
            signals = bound_as_recorded(recording, name, joint)
            if isinstance(joint, RigidJoint) and name in _chained(rig) and "torque_sensor" not in signals.roles:
                raise DiagnosisError(
                    f"joint '{name}': is one with a link that the others of the chain move, and no torque sensor says how"
                )
            other = None if second is None else bound_as_recorded(second, name, joint, set(signals.roles))
            findings += [*signals.findings, *log_findings([recording], name, joint)]
            stated = felt(joint, rig.tolerances[name])
            found += [
                diagnose_joint(label, joint, part, other, progress, stated) for label, part in _runs(name, signals)
            ]
        except VsalogError as error:
            if len(usable) == 1:
                raise DiagnosisError("; ".join([str(error), *sentences_of(lacking[:2])])) from error
            left_out.append(left_out_for(name, error))
    if not found:
        reasons = sentences_of((*findings, *left_out))
        raise DiagnosisError(f"{log.name}: no joint of the rig can be diagnosed: {'; '.join(reasons)}")
    chained = (f.name for f in found if f.name in _chained(rig))
    findings += [*left_out, *(Finding(code="diagnosis.link_of_chain", joint=name, severity="info") for name in chained)]
    proposed = _proposed(rig, found, findings, progress) if options.suggest else None
    findings += [finding for f in found for finding in f.findings]
    left = max((unexplained_of(f) for f in found), key=lambda u: u.fraction)
    verdict = min((f.verdict for f in found), key=WORST_FIRST.index)
    # What is not believed is no rig to go on with.
    extended = None if verdict == "unexplained" else _extended(rig, found)
    measured, causes, stiffness = recording if second is None else second, list[FoundCause](), list[Gain]()
    for one in found:
        gains, changes = _stiffness(one, rig, extended, measured, progress)
        causes += causes_of(one, changes)
        stiffness += gains
    simulated = [g for f in found for g in gains_of(f)]
    where = next((f.held_out for f in found if f.gain is not None), "the log" if holdout is None else HELD_OUT)
    document = Diagnosis(
        version=VERSION,
        vsalog=__version__,
        log=log.name,
        log_sha256=sha256(log),
        holdout=None if holdout is None else holdout.name,
        holdout_sha256=None if holdout is None else sha256(holdout),
        rig=rig.to_toml(),
        settings=_settings(options),
        verdict=verdict,
        sentences=(),
        p_values={f.name: f.selection.p_value for f in found if f.selection.p_value is not None},
        simulation_error=tuple(e for f in found for e in signal_errors(f)),
        equations=tuple(e for f in found for e in equation_errors(f)),
        causes=tuple(causes),
        gain=Gains(holdout=holdout is not None, where=where, signals=(*simulated, *stiffness)),
        unexplained=left,
        next_experiment="",
        findings=(*of_log(log.name, recording.findings), *findings),
    )
    drawn = (log if holdout is None else holdout).name
    evidence = tuple(evidence_of(f, drawn) for f in found)
    return Outcome(document, evidence, rig, extended, proposed)


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


def _lacking(log: Path, options: Options, recording: Recording, name: str, joint: Any) -> list[Finding]:
    """Return which channels the rig names that the log does not have."""
    named = {r: wanted_channels(joint, log.name, [r]) - set(recording.channels) for r in offered_roles(joint)}
    missing = [(role, channel) for role, channels in named.items() for channel in sorted(channels)]
    known = list(open_reader(log, options.rate).catalogue().channels) if missing else []
    found = []
    for role, channel in missing:
        near = " or ".join(f"'{n}'" for n in near_names(channel, known)) if channel not in known else ""
        code = "channel.empty" if channel in known else "channel.misnamed" if near else "channel.missing"
        found.append(Finding(code=code, joint=name, part=role, evidence={"channel": channel, "near": near}))
    return found


def _proposed(
    rig: Rig, found: Sequence[JointDiagnosis], findings: list[Finding], progress: Progress
) -> Suggestion | None:
    """Look for the next experiment; where there is none, say why."""
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
        # What was found of one run is no rig for others.
        if original is None or not (one.found or one.selection.problem.setting.fitted):
            continue
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


def _stiffness(
    found: JointDiagnosis, rig: Rig, extended: Rig | None, recording: Recording, progress: Progress
) -> tuple[list[Gain], list[float | None]]:
    """Return what the extended rig is worth for a joint's stiffness estimate, and what each cause changes in it."""
    name = found.name
    nothing = extended is None or not found.found or name not in rig.joints
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
    """Return the rig that is asked for, or lies in or next to a log.

    Raises
    ------
    RigError
        There is none, or it is at fault.
    """
    text = open_reader(log, options.rate).rig_text if options.rig is None else None
    rig = find_rig(log, text, options.rig)
    if rig is None:
        raise RigError(
            f"no rig was found in or beside {log.name}, and without one there is no simulation to be wrong:"
            f" 'vsalog init {log.name} > rig.toml' writes a first one, to be completed by hand (docs/rig.md); give it with --rig"
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
    recording: Recording, name: str, joint: Any, roles: set[str] | None = None, gains: bool = True
) -> JointSignals:
    """Bind every role that the log has, as recorded.

    Parameters
    ----------
    recording, name, joint : of the log and the rig
    roles : that are needed; all that the log has when absent
    gains : in the joint's units; else in those that its sensors count in

    Raises
    ------
    BindingError
        A role that is needed, or every one, is missing.
    """
    plain = bare(joint, gains=gains)
    offered = offered_roles(plain)
    there = [r for r in offered if wanted_channels(plain, recording.path.name, [r]) <= set(recording.channels)]
    if roles is not None:
        missing = sorted(roles - set(there))
        if missing:
            raise BindingError(
                f"{recording.path.name}: lacks {', '.join(missing)}, which the log to be diagnosed has; a held-out log needs"
                " the same roles"
            )
        there = [r for r in there if r in roles]
    if not there:
        raise BindingError(
            f"{recording.path.name}: none of the channels that the rig names for joint '{name}' is there;"
            f" 'vsalog inspect {recording.path.name}' lists them"
        )
    return bind([recording], name, plain, there, noise=True)


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
        "time": options.time,
        "start": options.start or "",
        "end": options.end or "",
        **{f"set {k}": v for k, v in options.set.items()},
    }
    asked["rate"] = "" if options.rate is None else f"{options.rate:g}"
    return {key: value for key, value in asked.items() if value}
