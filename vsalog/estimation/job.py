"""One run of `estimate`: logs and options in, estimates and their provenance out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from vsalog._version import __version__
from vsalog.binding.joint import names_of, offered_roles, wanted_channels
from vsalog.binding.neighbours import own_and_others
from vsalog.checks.cross_check import reference_roles
from vsalog.core.errors import BindingError, EstimatorError, ReadError, RigError, did_you_mean
from vsalog.core.finding import Finding, Findings, of_log
from vsalog.core.finding_texts import sentence
from vsalog.core.look import of_recording
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.model import UNITS, ModelFile
from vsalog.core.printable import command
from vsalog.core.recording import Recording
from vsalog.core.trace import Trace
from vsalog.estimation.external_stiffness import position_roles
from vsalog.estimation.joint import (
    Choice,
    JointEstimate,
    choose_all,
    estimate_joint,
    pick_joints,
)
from vsalog.estimation.missing_channels import without_channels
from vsalog.estimators.device import device_of
from vsalog.readers import Reader, open_reader, read
from vsalog.rig import Rig
from vsalog.rig.find import find_rig, tell_rig
from vsalog.rig.guess import guess_roles
from vsalog.rig.guess_types import JointGuess
from vsalog.rig.template import rig_template

Progress = Callable[[str], None]


# Bytes of samples that are held in memory; larger logs are processed in a temporary file.
@dataclass(frozen=True, slots=True)
class Options:
    """The options of `estimate`, named as on the command line.

    Attributes
    ----------
    rig : a loaded rig, a rig file or a preset; searched in the log and next to it when absent
    joints : names of the joints wanted; all when empty
    estimator : a method's name or ``auto``
    tune : NAME → VALUE of the method's tuning
    set : key → VALUE; ``setpoint`` is the logs' fixed set-point (one value, or one per log with commas between), every other
        key is one of the rig's
    rate : samples per second of tables without a time column [Hz]
    time : which clock stamps come from: auto, header, log, publish
    start, end : the part of each log that is used, as `vsalog.readers.read` takes them; all of it when absent
    """

    rig: Rig | str | Path | None = None
    joints: tuple[str, ...] = ()
    estimator: str = "auto"
    tune: Mapping[str, str] = field(default_factory=dict)
    set: Mapping[str, str] = field(default_factory=dict)
    rate: float | None = None
    time: str = "auto"
    start: str | None = None
    end: str | None = None


@dataclass(frozen=True, slots=True)
class Job:
    """Logs that were read, with their rig and the estimators chosen: ready to run.

    Attributes
    ----------
    rig : as loaded, with the settings worked in
    guessed : whether no rig was found and the roles were guessed
    choices : the estimator for each joint
    findings : of the logs and the rig
    options : as requested
    """

    logs: tuple[Path, ...]
    recordings: tuple[Recording, ...]
    rig: Rig
    guessed: bool
    choices: Mapping[str, Choice]
    setpoints: tuple[float | None, ...]
    findings: tuple[Finding, ...]
    options: Options = field(default_factory=lambda: Options())

    def run(
        self, sink: Callable[[Trace], None] | None = None, progress: Progress = lambda _: None
    ) -> list[JointEstimate]:
        """Estimate every joint that can be; traces go to the sink, or stay in memory without one."""
        out = []
        for name, choice in self.choices.items():
            progress(f"estimating joint {name}")
            out.append(
                estimate_joint(
                    self.recordings,
                    name,
                    self.rig.joints[name],
                    choice,
                    setpoints=self.setpoints,
                    sink=sink,
                    rig=self.rig.file,
                    stated=self.rig.tolerances[name],
                )
            )
        return out

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings about the logs and the rig, in sentences."""
        return tuple(map(sentence, self.findings))

    @property
    def is_long(self) -> bool:
        """Whether a log is too long for memory."""
        return any(recording.in_file for recording in self.recordings)

    def provenance(self) -> dict[str, str]:
        """Return the provenance of a result: version, rig, settings, and the input's hashes."""
        settings = {
            name: {"estimator": c.name, **{k: getattr(c.tuning, k) for k in c.tuning.__struct_fields__}}
            for name, c in self.choices.items()
        }
        return {
            "vsalog.version": __version__,
            "vsalog.rig": self.rig.to_toml(),
            "vsalog.estimator": json.dumps(settings),
            "vsalog.options": json.dumps(self._asked()),
            "vsalog.input": json.dumps({name: sha256(log) for name, log in self._names() if log.exists()}),
        }

    def _asked(self) -> dict[str, Any]:
        """Return the settings that repeat the run in addition to its rig; settings in the rig are in the rig."""
        o = self.options
        setpoint = {key: value for key, value in o.set.items() if key == "setpoint"}
        asked = {"joints": list(o.joints), "estimator": o.estimator, "tune": dict(o.tune), "set": setpoint}
        return asked | {"rate": o.rate, "time": o.time, "start": o.start, "end": o.end}

    def _names(self) -> list[tuple[str, Path]]:
        return list(zip(names_of(self.logs), self.logs, strict=True))

    def model_file(self, estimates: Sequence[JointEstimate], provenance: Mapping[str, str]) -> ModelFile:
        """Put the joints' models into one file's structure."""
        return ModelFile(
            vsalog=__version__,
            units=dict(UNITS),
            log=json.loads(provenance["vsalog.input"]),
            settings={e.joint: {"estimator": e.estimator, **e.settings} for e in estimates},
            rig=provenance["vsalog.rig"],
            joint={e.joint: e.model for e in estimates},
        )


def prepare(logs: Sequence[Path | Recording], options: Options, progress: Progress = lambda _: None) -> Job:
    """Find the rig, choose the estimators, and read the channels they need.

    Parameters
    ----------
    logs : paths, or recordings read before
    options : as requested
    progress : called with the step that begins

    Raises
    ------
    VsalogError
        A log cannot be read, the rig is missing or does not fit, or a role is missing.
    """
    if not logs:
        raise ReadError("no log was given")
    findings = Findings()
    opened = None if options.rig is not None or isinstance(logs[0], Recording) else open_reader(logs[0], options.rate)
    rig, guessed = _rig(logs[0], opened, options), False
    read_all: list[Recording] | None = None
    if rig is None:
        read_all = _read_all(logs, [None] * len(logs), options, progress, opened)
        rig, remarks = _guess(of_recording(read_all[0]))
        guessed = True
        tell_rig(rig, "guessed", _path(logs[0]))
        findings.add(*remarks)
    rig = rig.with_settings({key: value for key, value in options.set.items() if key != "setpoint"})
    rig, setpoints = _setpoints(rig, options.set.get("setpoint"), len(logs))
    joints = pick_joints(rig.joints, options.joints)
    try:
        choices, left_out = choose_all(joints, options.estimator, options.tune, rig.file)
    except EstimatorError as error:
        if not guessed:
            raise
        name = _path(logs[0]).name
        raise EstimatorError(
            f"{name}: no rig was found in or next to it, and by the names of its channels {error}"
        ) from None
    findings.add(*left_out)
    while read_all is None:
        names = [_path(log).name for log in logs]
        wanted = [_Wanted.of(rig, choices, name) for name in names]
        try:
            read_all = _read_all(logs, wanted, options, progress, opened)
        except _MissingChannelError as error:
            rig, choices, lacking = _without_missing(rig, choices, options, error)
            findings.add(*lacking)
            opened = None
    for recording in read_all:
        findings.add(*of_log(recording.path.name, recording.findings))
    long = [recording.path.name for recording in read_all if recording.in_file]
    findings.add(*(Finding(code="recording.too_long_for_memory", log=name) for name in long))
    paths = tuple(_path(log) for log in logs)
    return Job(paths, tuple(read_all), rig, guessed, choices, setpoints, tuple(findings), options)


@dataclass(frozen=True, slots=True)
class _Wanted:
    """Channels of a log: those that the estimators need, and references for them if they were recorded."""

    needed: set[str]
    welcome: set[str]

    @classmethod
    def of(cls, rig: Rig, choices: Mapping[str, Choice], log: str) -> _Wanted:
        """Name the channels for the estimators that were chosen."""
        needed, welcome = set[str](), set[str]()
        for name, choice in choices.items():
            needed |= _channels(rig, name, log, choice.roles)
            joint = rig.joints[name]
            references = reference_roles(device_of(name, joint, rig=rig.file), joint, choice.roles)
            welcome |= _channels(rig, name, log, (*references, *position_roles(name, rig.file, joint)))
        return cls(needed, welcome)


def _channels(rig: Rig, joint: str, log: str, roles: Sequence[str]) -> set[str]:
    """Return the names of the channels that an estimator's roles for a joint are found in, those of its neighbours included."""
    own, neighbours = own_and_others(roles, rig.joints)
    found = wanted_channels(rig.joints[joint], log, own)
    return found.union(*(wanted_channels(other, log, its) for other, its in neighbours.values()))


class _MissingChannelError(BindingError):
    """Channels that are needed are missing in a log, or have no row."""

    def __init__(self, message: str, log: Path, channels: Sequence[str]) -> None:
        super().__init__(message)
        self.log, self.channels = log, channels


def _without_missing(
    rig: Rig, choices: Mapping[str, Choice], options: Options, error: _MissingChannelError
) -> tuple[Rig, dict[str, Choice], list[Finding]]:
    """Return the rig without the channels that a log lacks, and estimators that can do without; raise where none can."""
    joints, findings = dict(rig.joints), list[Finding]()
    for name in choices:
        joints[name], found = without_channels(error.log, options.rate, error.channels, name, joints[name])
        findings += of_log(error.log.name, found)
    rig = rig.with_joints(joints)
    try:
        chosen, left_out = choose_all(
            {name: joints[name] for name in choices}, options.estimator, options.tune, rig.file
        )
    except EstimatorError:
        raise error from None
    if left_out or not findings:
        raise error
    return rig, chosen, findings


def _path(log: Path | Recording) -> Path:
    return log.path if isinstance(log, Recording) else log


def _read_all(
    logs: Sequence[Path | Recording],
    wanted: Sequence[_Wanted | None],
    options: Options,
    progress: Progress,
    opened: Reader | None,
) -> list[Recording]:
    """Read logs, the first of them `opened`; where they do not fit in memory together, the later ones go to files."""
    found: list[Recording] = []
    room = AT_ONCE_BYTES
    for log, channels, reader in zip(logs, wanted, [opened, *[None] * (len(logs) - 1)], strict=True):
        found.append(_read(log, channels, options, progress, room, reader))
        if not found[-1].in_file:
            room = max(0, room - sum(c.values.nbytes + c.stamps.nbytes for c in found[-1].channels.values()))
    return found


def _read(
    log: Path | Recording,
    wanted: _Wanted | None,
    options: Options,
    progress: Progress,
    room: int,
    opened: Reader | None,
) -> Recording:
    if isinstance(log, Recording):
        return log
    progress(f"reading {log.name}")
    channels = None if wanted is None else wanted.needed | wanted.welcome
    found = read(log, channels, options.time, options.rate, options.start, options.end, room, opened)
    missing = sorted((wanted.needed if wanted else set()) - set(found.channels) - set(found.unread))
    if missing:
        known = open_reader(log, options.rate).catalogue()
        if missing[0] in known.channels:
            message = f"{log.name}: channel '{missing[0]}' has no rows: nothing was recorded in it"
            raise _MissingChannelError(message, log, missing)
        if missing[0] not in known.unread:
            raise _MissingChannelError(
                f"{log.name}: there is no channel '{missing[0]}'{did_you_mean(missing[0], known.channels) or '.'}"
                f" '{command('inspect', log)}' lists all {len(known.channels)}. Leave a role that was not recorded out of the"
                " rig: another estimator may do without it",
                log,
                missing,
            )
    return found


def _rig(log: Path | Recording, opened: Reader | None, options: Options) -> Rig | None:
    carries = log if isinstance(log, Recording) else opened
    return find_rig(_path(log), None if carries is None else carries.rig_text, options.rig)


def _guess(recording: Recording) -> tuple[Rig, list[Finding]]:
    """Guess the rig of a log that has none, with a warning that it was guessed."""
    guess, name, path = guess_roles(recording), recording.path.name, recording.path
    if not guess.joints:
        raise RigError(
            f"no rig was found in or next to {name}, and no channel of it looks like a joint's position or deflection."
            f" '{command('inspect', recording.path)}' lists the channels,"
            f" '{command('init', recording.path)}' writes a rig to fill in"
        )
    rig = Rig.from_toml(rig_template(recording, guess, with_beginnings=False), f"the rig guessed for {name}")
    roles = "; ".join(f"{joint.name}: {_roles_of(joint, rig)}" for joint in guess.joints)
    file = path.with_name(f"{path.stem}.rig.toml") if path.exists() else f"{path.stem}.rig.toml"  # of an address
    evidence = {"roles": roles, "name": str(path), "rig": str(file)}
    guessed = Finding(code="rig.guessed", value=len(guess.joints), evidence=evidence)
    return rig, of_log(name, [guessed, *guess.findings])


def _roles_of(joint: JointGuess, rig: Rig) -> str:
    """Return the guessed channels, and which of them are not used, as a torque before an unknown gear."""
    used = set(offered_roles(rig.joints[joint.name]))
    unused = {role: "" if role in used else ", not used before the rig is completed" for role in joint.roles}
    return ", ".join(
        f"{role} = '{g.channel}' (confidence {g.confidence:.0%}{unused[role]})" for role, g in joint.roles.items()
    )


def _setpoints(rig: Rig, text: str | None, count: int) -> tuple[Rig, tuple[float | None, ...]]:
    """Read --set setpoint=VALUE[,VALUE…] by way of the rig, which knows the units."""
    if text is None:
        return rig, ()
    serial = [name for name, joint in rig.joints.items() if "setpoint" in joint.signals.__struct_fields__]
    if not serial:
        raise RigError('--set setpoint: no joint of the rig has a set-point (kind = "serial")')
    values = [v.strip() for v in text.split(",")]
    if len(values) not in (1, count):
        raise RigError(f"--set setpoint: {len(values)} values for {count} logs; give one, or one per log")
    out: list[float | None] = []
    for value in values * (count if len(values) == 1 else 1):
        fixed = _without_setpoint(rig, serial)
        for name in serial:
            fixed = fixed.with_setting(f"joint.{name}.signals.setpoint", f"{{ constant = {_toml_value(value)} }}")
        out.append(offered_roles(fixed.joints[serial[0]])["setpoint"].constant)
    return fixed, tuple(out)


def _toml_value(text: str) -> str:
    """Write a number as one, SI, and anything else as a text, whose unit the rig reads."""
    try:
        return repr(float(text))
    except ValueError:
        return json.dumps(text)


def _without_setpoint(rig: Rig, joints: Sequence[str]) -> Rig:
    """Remove the rig's entries for the set-point, so that only the requested one applies."""
    changed = dict(rig.joints)
    for name in joints:
        joint = changed[name]
        changed[name] = msgspec.structs.replace(joint, signals=msgspec.structs.replace(joint.signals, setpoint=None))
    return rig.with_joints(changed)


def sha256(path: Path) -> str:
    """Hash a file; of a folder, the hashes of its files in the order of their names."""
    if path.is_dir():
        parts = [sha256(p) for p in sorted(path.rglob("*")) if p.is_file()]
        return hashlib.sha256("".join(parts).encode()).hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
