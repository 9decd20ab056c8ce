"""One run of `simulate`: a rig and options in, a recording and its log out."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from vsalog.binding.joint import offered_roles
from vsalog.core.errors import SimulationError, WriteError
from vsalog.core.memory import usable_memory
from vsalog.core.recording import Recording
from vsalog.core.toml import parse_toml
from vsalog.rig import Rig
from vsalog.rig.find import given_rig
from vsalog.rig.load import preset_text, presets
from vsalog.rig.schema import Joint, RigFile, Signal
from vsalog.simulation.channels import named_signals
from vsalog.simulation.control import Controller
from vsalog.simulation.control_loop import EstimatorFactory
from vsalog.simulation.inputs import Input
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate
from vsalog.writers.recording_files import MESSAGE_FORMATS, LogFiles, write_log
from vsalog.writers.recording_topics import read_back_name

BYTES_PER_SAMPLE = 500
"""Memory that a sample of one joint takes: some forty numbers of truth and measurement, copies included; 350 were measured."""

VALVES_AND_PRESSURES = ("valve_1", "valve_2", "pressure_1", "pressure_2")


@dataclass(frozen=True, slots=True)
class Options:
    """What can be asked of `simulate`; the command line's options of the same names.

    Attributes
    ----------
    scenario : a scenario's name or file; one that suits the rig when absent
    duration, rate : [s], [Hz]; the scenario's when absent
    seed : of all noise
    ideal : sensors without noise, steps, jitter and dropped samples
    set : key → value, of the machine and of the rig that the log carries
    actual : key → value, of the machine alone
    truth : record the truth too
    output : the log's path, whose ending gives the format
    """

    scenario: str | None = None
    duration: float | None = None
    rate: float | None = None
    seed: int = 0
    ideal: bool = False
    set: Mapping[str, str] = field(default_factory=dict)
    actual: Mapping[str, str] = field(default_factory=dict)
    truth: bool = False
    output: str | None = None


@dataclass(frozen=True, slots=True)
class Job:
    """A simulation that was found possible as far as is known before it runs.

    Attributes
    ----------
    rig : the machine that is simulated
    rig_text : the rig that the log carries
    inputs : joint → role → what drives it
    controllers : joint → the controller that drives it by its sensors' readings
    believed : the rig as controllers know it, which is that of the log
    samples : of each channel, before any is dropped
    """

    rig: Rig
    rig_text: str
    scenario: Scenario
    inputs: Mapping[str, Mapping[str, Input]]
    controllers: Mapping[str, Controller]
    believed: RigFile
    files: LogFiles
    samples: int
    options: Options

    def run(self, estimator: EstimatorFactory | None = None) -> Recording:
        """Simulate.

        Parameters
        ----------
        estimator : makes the estimators that controllers read; see `simulate`

        Raises
        ------
        SimulationError
            The rig lacks what a simulation needs, or the motion leaves the range of the model.
        """
        file = self.scenario.file
        experiment = simulate(
            self.rig.file,
            self.inputs,
            file.duration,
            period=file.period,
            seed=self.options.seed,
            ideal=self.options.ideal,
            controllers=self.controllers,
            believed=self.believed,
            estimator=estimator,
            name=self.files.log.stem,
        )
        return experiment.recording(truth=self.options.truth)

    def with_rig(self, recording: Recording) -> Recording:
        """Return a recording that carries its rig, as the log that is written of it does."""
        return replace(recording, rig_text=_as_recorded(self.rig_text, recording))

    def write(self, recording: Recording) -> None:
        """Write the log, and the rig next to it where the format has no place for it.

        Raises
        ------
        WriteError
            A file cannot be written.
        """
        write_log(recording, self.files, _as_recorded(self.rig_text, recording))


def prepare(source: Rig | str | Path, options: Options) -> Job:
    """Load rig and scenario and see that they fit, and that the log can be written.

    Parameters
    ----------
    source : a rig, its file or a preset's name
    options : what is asked for

    Raises
    ------
    VsalogError
        An option names something missing or impossible.
    """
    rig = given_rig(source)
    text = rig.to_toml() if isinstance(source, Rig) else _text(str(source), rig)
    rig = rig.with_settings(options.set)
    if not rig.joints:
        raise SimulationError(f"{rig.where}: has no joint to simulate")
    period = None if options.rate is None else _period(options.rate)
    scenario = Scenario.find(options.scenario, rig.file, period).lasting(options.duration, period)
    name = _name(rig.name if isinstance(source, Rig) else str(source), scenario)
    files = LogFiles.named(options.output if options.output is not None else f"{name}.mcap")
    named = _as_written(_with_channels(rig), files.format)
    if options.set or named is not rig:
        text = named.to_toml()
    actual = named.with_settings(options.actual, "--actual")
    given = [] if isinstance(source, Rig) else [Path(source)]
    check_inputs([*given, Path(options.scenario or ""), *scenario.files()], files)
    samples = _samples(scenario, len(rig.joints))
    controllers = scenario.controllers(named.file)
    return Job(actual, text, scenario, scenario.inputs(actual.file), controllers, named.file, files, samples, options)


def _period(rate: float) -> float:
    # Stamps are whole nanoseconds: one is off by no more than a thousandth of the period.
    if not 0.0 < rate <= 1e-3 * 1e9:
        raise SimulationError(f"a rate of {rate:g} Hz cannot be simulated: stamps are whole nanoseconds, up to 1 MHz")
    return 1.0 / rate


def _samples(scenario: Scenario, joints: int) -> int:
    """Return the number of samples, unless they would not fit into memory."""
    _period(1.0 / scenario.file.period)
    count = scenario.file.duration / scenario.file.period + 1.0
    needed, there = count * joints * BYTES_PER_SAMPLE, usable_memory()
    if needed > there:
        raise SimulationError(
            f"{scenario.file.duration:g} s at {1.0 / scenario.file.period:g} Hz are {count:.3g} samples of {joints}"
            f" {'joint' if joints == 1 else 'joints'}, about {needed / 1e9:.3g} GB of memory; this machine has"
            f" {there / 1e9:.3g} GB free: take a shorter duration or a lower rate"
        )
    if count < 2.0 - 1e-9:
        raise SimulationError(
            f"{scenario.file.duration:g} s at {1.0 / scenario.file.period:g} Hz are less than two samples"
        )
    return round(scenario.file.duration / scenario.file.period) + 1


def _as_recorded(text: str, recording: Recording) -> str:
    """Return a log's rig without the roles of which nothing was recorded: a motor that is moved as prescribed has no torque."""
    rig = Rig.from_toml(text, "the log's rig")
    joints = {}
    for name, joint in rig.joints.items():
        named = {role: signal.channel for role, signal in named_signals(joint).items()}
        absent = {role for role, channel in named.items() if channel is not None and channel not in recording.channels}
        if absent:
            signals = msgspec.structs.replace(joint.signals, **dict.fromkeys(absent))
            joints[name] = msgspec.structs.replace(joint, signals=signals)
    if not joints:
        return text
    return Rig(msgspec.structs.replace(rig.file, joint={**rig.joints, **joints}), rig.where).to_toml()


def _text(source: str, rig: Rig) -> str:
    """Return a rig's own text, with its comments; where it builds on a preset, whole, so that it stays what was simulated."""
    if source in presets() and not Path(source).is_file():
        return preset_text(source)
    text = Path(source).read_text(encoding="utf-8-sig") if Path(source).is_file() else source
    return rig.to_toml() if "preset" in parse_toml(text) else text


def _with_channels(rig: Rig) -> Rig:
    """Return the rig with the usual channels in each joint that names none, so that the log's rig names them."""
    joints: dict[str, Joint] = {}
    for i, (name, joint) in enumerate(rig.joints.items()):
        roles = joint.signals.__struct_fields__
        if all(getattr(joint.signals, role) is None for role in roles):
            # In a rig of several joints each has channels of its own, numbered where names alone would not be distinct.
            plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
            own = "" if len(rig.joints) == 1 else f"{plain}_" if plain == name else f"joint_{i}_{plain}_"
            usual = {role: signal.channel or "" for role, signal in named_signals(joint).items()}
            usual |= {role: f"/{role}.data" for role in VALVES_AND_PRESSURES if role in roles}
            channels = {role: re.sub(r"\[|^/(?=.*\.data$)", rf"\g<0>{own}", channel) for role, channel in usual.items()}
            joints[name] = msgspec.structs.replace(joint, signals=type(joint.signals)(**channels))
    if not joints:
        return rig
    return Rig(msgspec.structs.replace(rig.file, joint={**rig.joints, **joints}), rig.where)


def _as_written(rig: Rig, log_format: str) -> Rig:
    """Return the rig with the channels' names as the log's format can hold them: as a topic has no spaces."""
    if log_format not in MESSAGE_FORMATS:
        return rig
    joints: dict[str, Joint] = {}
    for name, joint in rig.joints.items():
        renamed: dict[str, Signal] = {}
        for role, signal in offered_roles(joint).items():
            if signal.channel is not None and "{run}" not in signal.channel:
                written = read_back_name(signal.channel)
                if written != signal.channel:
                    renamed[role] = msgspec.structs.replace(signal, channel=written)
        if renamed:
            joints[name] = msgspec.structs.replace(joint, signals=msgspec.structs.replace(joint.signals, **renamed))
    return Rig(msgspec.structs.replace(rig.file, joint={**rig.joints, **joints}), rig.where) if joints else rig


def _name(source: str, scenario: Scenario) -> str:
    """Return the log's name: rig and scenario."""
    rig = re.sub(r"(\.rig)?\.toml$", "", Path(source).name)
    name = scenario.file.name or re.sub(r"(\.scenario)?\.toml$", "", scenario.where)
    return file_name(name if name.startswith(rig) else f"{rig}-{name}")


def file_name(text: str) -> str:
    """Return a text in letters without a meaning for a shell or a file system."""
    return re.sub(r"[^\w.-]+", "_", text).strip("._-")[:100] or "simulated"


def check_inputs(read: list[Path], files: LogFiles) -> None:
    """Refuse to write over what is read.

    Raises
    ------
    WriteError
        One of `files` is one of `read`.
    """
    for path in (files.log, files.rig):
        for source in read:
            if path is not None and path.exists() and source.is_file() and path.samefile(source):
                raise WriteError(f"{path}: is read by the simulation; choose another name with -o")
