"""One run of `validate`: a model file and logs in, a report and the data of its figures out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import msgspec

from vsalog._version import __version__
from vsalog.binding.joint import bind, names_of, offered_roles, wanted_channels
from vsalog.checks.recording_faults import log_findings
from vsalog.checks.sensor import without_clipped
from vsalog.checks.signals import implausible
from vsalog.core.errors import BindingError, EstimatorError, RigError, did_you_mean
from vsalog.core.finding import Finding, of_log
from vsalog.core.model import JointModel, ModelFile
from vsalog.core.printable import command
from vsalog.core.recording import Recording
from vsalog.estimation.evidence import Draw, JointEvidence
from vsalog.estimation.job import sha256
from vsalog.estimation.joint import pick_joints
from vsalog.estimators.device import Device, device_of
from vsalog.estimators.needs import require
from vsalog.readers import open_reader, read
from vsalog.rig import Rig
from vsalog.rig.find import find_rig, tell_rig
from vsalog.rig.schema import Joint
from vsalog.validation.document import VERSION, JointReport, LogReport, Report
from vsalog.validation.frozen import frozen
from vsalog.validation.joint import judge, prepare
from vsalog.validation.modalities import side_by_side
from vsalog.validation.references import truth_channels
from vsalog.validation.verdict import joint_report, thresholds

Progress = Callable[[str], None]

# Estimating a log by all modalities takes longer than testing a model: logs with more samples only on request.
MANY_SAMPLES = 300_000


@dataclass(frozen=True, slots=True)
class Options:
    """The options of `validate`, named as on the command line.

    Attributes
    ----------
    rig : a loaded rig, a rig file or a preset; the log's own, else the model's, when absent
    joints : names of the joints wanted; all of the model's when empty
    set : key → value of the rig
    rate, time : as for `estimate`
    modalities : estimate the logs by MODEL, SENSOR and RESIDUAL too; for logs of up to 300 000 samples when absent
    max_nrmse, max_msrep : thresholds [%]
    start, end : as for `estimate`
    """

    rig: Rig | str | Path | None = None
    joints: tuple[str, ...] = ()
    set: Mapping[str, str] = field(default_factory=dict)
    rate: float | None = None
    time: str = "auto"
    modalities: bool | None = None
    max_nrmse: float | None = None
    max_msrep: float | None = None
    start: str | None = None
    end: str | None = None


def validate(
    model: Path,
    logs: Sequence[Path],
    options: Options,
    progress: Progress = lambda _: None,
    draw: Draw = lambda _, __: None,
) -> Report:
    """Test a frozen model on logs.

    Parameters
    ----------
    model : that `estimate` wrote
    logs : other experiments
    options : of the command
    progress : called with the step that begins
    draw : given the data of the figures, one transmission at a time

    Raises
    ------
    VsalogError
        A file cannot be read, the rig does not fit, or a role is missing.
    """
    file = frozen(model)
    reports, rig, hashes = [], None, dict[str, str]()
    for i, (name, log) in enumerate(zip(names_of(logs), logs, strict=True)):
        rig = _rig(file, log, options)
        progress(f"validating against {log.name}")
        with ThreadPoolExecutor(1) as pool:
            digest = pool.submit(_hash, log)
            joints = _judge_log(file, rig, log, digest, options, progress, partial(draw, i))
        same = hashes.setdefault(digest.result() or name, name)
        if same != name or log in logs[:i]:
            evidence = {"log": name, "same_as": same}
            twice = Finding(code="validation.same_log", severity="info", evidence=evidence)
            joints = [msgspec.structs.replace(j, findings=(twice, *j.findings)) for j in joints]
        reports.append(LogReport(log=name, sha256=digest.result(), joints=tuple(joints)))
    assert rig is not None
    return Report(
        version=VERSION,
        vsalog=__version__,
        model=model.name,
        model_sha256=sha256(model),
        model_logs=dict(file.log),
        settings=_settings(options),
        rig=rig.to_toml(),
        logs=tuple(reports),
        thresholds=thresholds(reports, options.max_nrmse, options.max_msrep),
    )


def _hash(log: Path) -> str:
    return sha256(log) if log.exists() else ""


def _rig(file: ModelFile, log: Path, options: Options) -> Rig:
    text = open_reader(log, options.rate).rig_text if options.rig is None else None
    rig = find_rig(log, text, options.rig)
    if rig is None:
        rig = Rig.from_toml(file.rig, "the rig in the model file")
        tell_rig(rig, "model", log)
    for key, value in options.set.items():
        rig = rig.with_setting(key, value)
    return rig


def _judge_log(
    file: ModelFile, rig: Rig, log: Path, digest: Future[str], options: Options, progress: Progress,
    draw: Callable[[JointEvidence], None],
) -> list[JointReport]:  # fmt: skip
    wanted = list(options.joints) or list(file.joint)
    reports = []
    for name in wanted:
        if name not in file.joint:
            known = ", ".join(file.joint)
            raise EstimatorError(
                f"the model has no joint '{name}'{did_you_mean(name, file.joint) or '.'} It has: {known}"
            )
        joint = pick_joints(rig.joints, [name])[name]
        device = device_of(name, joint)
        if device.pneumatic is not None:
            raise EstimatorError(
                f"joint '{name}' is of kind 'pneumatic': its model is the rig, and no fitted one; 'vsalog diagnose LOG' compares"
                " the rig with a log"
            )
        _check_fit(file.joint[name], device, rig)
        roles = _roles(device, joint)
        recording = _read(log, joint, roles, name, options)
        bound = bind([recording], name, joint, roles)
        doubts = [*bound.findings, *implausible(device, bound), *log_findings([recording], name, joint)]
        prepared = prepare(device, without_clipped(bound))
        del bound  # long arrays are not kept twice
        signals = prepared.signals
        short = len(signals) <= MANY_SAMPLES if options.modalities is None else options.modalities
        truth = {c: recording.channels[c] for c in truth_channels(name) if c in recording.channels}
        if not short:
            recording = replace(recording, channels=truth)
        judged = judge(file.joint[name], joint, device, prepared, truth, draw)
        learnt_from = digest.result() in file.log.values() and not _other_runs(file, name, joint)
        if file.joint[name].basis.branches:
            doubts.append(Finding(code="validation.whole_cycles_only", joint=name))
        modalities = {}
        if short:
            progress(f"estimating {log.name} by each modality")
            modalities = side_by_side(name, joint, recording)
        elif options.modalities is None:
            many = partial(Finding, value=len(signals), limit=MANY_SAMPLES)
            doubts.append(many(code="validation.modalities_skipped", joint=name, severity="info"))
        found = joint_report(judged, signals, modalities, doubts, learnt_from)
        findings = (*of_log(log.name, recording.findings), *found.findings)
        reports.append(msgspec.structs.replace(found, findings=findings))
    return reports


def _other_runs(file: ModelFile, name: str, joint: Joint) -> bool:
    """Return whether the model was fitted to other runs of the same file."""
    fitted = Rig.from_toml(file.rig, "the rig in the model file").joints.get(name)
    theirs, ours = ({run.name for run in getattr(j, "run", ())} for j in (fitted, joint))
    return bool(theirs) and bool(ours) and not theirs & ours


def _check_fit(model: JointModel, device: Device, rig: Rig) -> None:
    """Refuse a rig for another kind of device than the model's."""
    theirs, ours = [t.name for t in model.transmission], [v.name for v in device.transmissions]
    if not theirs:
        raise EstimatorError(
            f"the model of joint '{device.joint}' contains no torque over the deflection, because {model.estimator} follows the"
            " stiffness or observes a state; fit one with another --estimator ('vsalog estimate --help' lists them)"
        )
    if len(theirs) == len(ours) and theirs != ours:
        raise RigError(
            f"{rig.where}: joint '{device.joint}' has the transmissions {', '.join(ours)}, but the model {', '.join(theirs)}"
        )
    if theirs != ours:
        raise RigError(
            f"{rig.where}: joint '{device.joint}' has {len(ours)} transmission{'s' if len(ours) > 1 else ''}, but the model was"
            f" fitted on a joint with {len(theirs)}"
        )
    if model.basis.has_setpoint and not device.has_setpoint:
        raise RigError(
            f"{rig.where}: the model of joint '{device.joint}' depends on a set-point, which this rig's joint lacks"
        )


def _roles(device: Device, joint: Joint) -> tuple[str, ...]:
    """Return what is read: deflections, set-point, and every torque the rig names."""
    offered, wanted = offered_roles(joint), []
    for view in device.transmissions:
        needed = list(view.deflection_roles(offered))
        require("validate", device, needed, offered)
        wanted += needed
        # Without the motor's inertia there is no residual, and unused roles need not fit.
        if {view.motor_position, view.motor_torque} <= set(offered) and view.motor.inertia is not None:
            wanted += [view.motor_position, view.motor_torque]
        wanted += [view.torque_sensor]
    wanted.append("torque_sensor")
    if device.has_setpoint:
        require("validate", device, ["setpoint"], offered)
        wanted.append("setpoint")
    return tuple(role for role in dict.fromkeys(wanted) if role in offered)


def _read(log: Path, joint: Joint, roles: Sequence[str], name: str, options: Options) -> Recording:
    reader = open_reader(log, options.rate)
    known = reader.catalogue()
    channels = wanted_channels(joint, log.name, roles)
    missing = sorted(c for c in channels if c not in known.channels and c not in known.unread)
    if missing:
        raise BindingError(
            f"{log.name}: there is no channel '{missing[0]}'{did_you_mean(missing[0], known.channels) or '.'}"
            f" '{command('inspect', log)}' lists all {len(known.channels)}"
        )
    truth = {c for c in truth_channels(name) if c in known.channels}
    return read(log, channels | truth, options.time, options.rate, options.start, options.end)


def _settings(options: Options) -> dict[str, str]:
    asked = {"rig": options.rig, "joints": ", ".join(options.joints), "rate": options.rate, "time": options.time}
    asked |= {"start": options.start, "end": options.end}
    settings = {key: str(value) for key, value in asked.items() if value}
    return settings | {f"set {key}": value for key, value in options.set.items()}
