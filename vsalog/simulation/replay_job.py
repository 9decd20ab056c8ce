"""One run of `simulate --replay`: a log in, the same log with the simulation of its inputs out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import bind, offered_roles, wanted_channels
from vsalog.core.errors import BindingError, SimulationError, did_you_mean
from vsalog.core.printable import command
from vsalog.core.recording import Channel, Recording, Stream
from vsalog.core.signals import JointSignals
from vsalog.core.units import shown
from vsalog.readers import open_reader, read
from vsalog.rig import Rig
from vsalog.rig.find import find_rig
from vsalog.rig.roles import ROLE_UNITS
from vsalog.rig.schema import Joint, PneumaticJoint, RigidJoint, Signal
from vsalog.simulation.channels import topic_parts
from vsalog.simulation.experiment import FLOAT64
from vsalog.simulation.machine import Movable
from vsalog.simulation.replay import Replayed, replay
from vsalog.simulation.run import check_inputs, file_name
from vsalog.simulation.sensors import SENSED
from vsalog.writers.recording_files import LogFiles, write_log

Array = NDArray[np.float64]

# Roles that a replay begins with or is driven by: they have to be in the log if the rig names them.
NEEDED = (
    "motor_position",
    "link_position",
    "deflection",
    "setpoint",
    "commanded_position",
    "commanded_velocity",
    "motor_torque",
    "secondary_torque",
    "external_torque",
)
MEASURED, SIMULATED = "/measured/", "/simulated/"
UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s^2",
    "deflection": "rad",
    "torque": "N*m",
    "stiffness": "N*m/rad",
    "arm": "m",
}


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """What can be asked of `simulate --replay`; the command line's options of the same names.

    Attributes
    ----------
    window : restart from the measured state every so often [s]; with each run of the log only when absent
    rate : samples per second of a table that has no time column [Hz]
    set : key → value, of the machine and of the rig that the log carries
    actual : key → value, of the machine alone
    output : the log's path, whose ending gives the format
    """

    window: float | None = None
    rate: float | None = None
    set: Mapping[str, str] = field(default_factory=dict)
    actual: Mapping[str, str] = field(default_factory=dict)
    output: str | None = None


@dataclass(frozen=True, slots=True)
class JointReplay:
    """The replay of one joint.

    Attributes
    ----------
    signals : the measured roles, SI, on the joint's side
    simulated : name → shape (N,), the truth of the simulation, and each measured role by its own name
    driven : role → "torque" or "motion"
    restarts : how often the state was set to the measured one
    """

    signals: JointSignals
    simulated: Mapping[str, Array]
    driven: Mapping[str, str]
    restarts: int

    def error(self, role: str) -> tuple[float, float]:
        """Return the rms of simulated − measured, and the standard deviation of what was measured [both SI]."""
        measured = self.signals.roles[role]
        off = self.simulated[role] - measured
        there = np.isfinite(off)
        return float(np.sqrt(np.mean(off[there] ** 2))), float(np.std(measured[there]))

    def compared(self) -> list[str]:
        """Return the measured roles that the simulation predicts: all that do not drive it."""
        drives = {position_of(role) if how == "motion" else role for role, how in self.driven.items()}
        own = [role for role in self.signals.roles if role in self.simulated and role not in drives]
        return [role for role in own if np.isfinite(self.simulated[role] - self.signals.roles[role]).any()]


@dataclass(frozen=True, slots=True)
class ReplayJob:
    """A replay that was found possible as far as is known before it runs.

    Attributes
    ----------
    log : that is replayed
    rig : the machine that is simulated
    believed : the rig as the log has it
    signals : joint → its roles
    left_out : joints that are left out, and why
    """

    log: Path
    rig: Rig
    believed: Rig
    signals: Mapping[str, JointSignals]
    left_out: Mapping[str, str]
    files: LogFiles
    options: ReplayOptions

    def run(self) -> dict[str, JointReplay]:
        """Simulate.

        Raises
        ------
        SimulationError
            The rig lacks what a simulation needs, or the motion leaves the range of the model.
        """
        chain = self.rig.file.chain
        chained = [] if chain is None else [link.joint for link in chain.link]
        found: dict[str, JointReplay] = {}
        groups = [chained] * bool(chained) + [[name] for name in self.signals if name not in chained]
        for names in groups:
            own = {name: self.signals[name] for name in names}
            machine = {name: _movable(self.rig.joints[name]) for name in names}
            with_chain = chain if names is chained else None
            replayed = replay(machine, own, chain=with_chain, window=self.options.window)
            found |= {name: _joint(name, own[name], replayed) for name in names}
        return {name: found[name] for name in self.signals}

    def recording(self, joints: Mapping[str, JointReplay]) -> Recording:
        """Return measured and simulated: Float64 topics in SI, on the joints' grids."""
        channels: dict[str, Channel] = {}
        for name, joint in joints.items():
            for prefix, values in ((MEASURED, joint.signals.roles), (SIMULATED, joint.simulated)):
                for role, column in values.items():
                    topic = self._topic(prefix, name, role)
                    stamps, unit = joint.signals.stamps, unit_of(role)
                    channels[f"{topic}.data"] = Channel(f"{topic}.data", stamps, column, unit, topic, FLOAT64)
        streams = {c.stream: Stream(c.stream, c.type, int(c.stamps.size), "log") for c in channels.values()}
        return Recording(path=self.files.log, format="simulation", channels=channels, streams=streams)

    def with_rig(self, recording: Recording) -> Recording:
        """Return a recording that carries its rig, as the log that is written of it does."""
        return replace(recording, rig_text=self.rig_text())

    def write(self, recording: Recording) -> None:
        """Write the log, and the rig next to it where the format has no place for it.

        Raises
        ------
        WriteError
            A file cannot be written.
        """
        write_log(recording, self.files, self.rig_text())

    def rig_text(self) -> str:
        """Return the rig with the signals where the new log has them."""
        joints = dict(self.believed.joints)
        for name, signals in self.signals.items():
            known = {
                role: Signal(
                    channel=f"{self._topic(MEASURED, name, role)}.data",
                    unit=unit_of(role),
                    resolution=signals.resolution.get(role) or None,
                )
                for role in signals.roles
            }
            joint = joints[name]
            without_runs = {} if isinstance(joint, RigidJoint) else {"run": ()}
            joints[name] = msgspec.structs.replace(joint, signals=type(joint.signals)(**known), **without_runs)
        return Rig(msgspec.structs.replace(self.believed.file, joint=joints), self.believed.where).to_toml()

    def _topic(self, prefix: str, joint: str, role: str) -> str:
        return f"{prefix}{role}" if len(self.signals) == 1 else f"{prefix}{topic_parts(self.signals)[joint]}/{role}"


def prepare_replay(source: Rig | str | Path | None, log: Path, options: ReplayOptions) -> ReplayJob:
    """Load the rig, read the log, and see that they fit, and that the new log can be written.

    Parameters
    ----------
    source : a rig, its file or a preset's name; the rig in or next to the log when absent
    log : to replay
    options : what is asked for

    Raises
    ------
    VsalogError
        An option names something missing or impossible.
    """
    reader = open_reader(log, options.rate)
    believed = find_rig(log, reader.rig_text, source)
    if believed is None:
        raise SimulationError(
            f"no rig was found in or next to {shown(log.name)}: name one, '{command('simulate', 'RIG', '--replay', log)}'"
        )
    believed = believed.with_settings(options.set)
    actual = believed.with_settings(options.actual, "--actual")
    files = LogFiles.named(options.output if options.output is not None else f"{file_name(log.stem)}-replay.mcap")
    check_inputs([log, *([] if source is None or isinstance(source, Rig) else [Path(source)])], files)
    left_out = {name: why for name, joint in believed.joints.items() if (why := _why_not(joint))}
    movable = {name: joint for name, joint in believed.joints.items() if name not in left_out}
    if not movable:
        reasons = "; ".join(f"joint '{shown(name)}' {why}" for name, why in left_out.items()) or "it has none"
        raise SimulationError(f"{believed.where}: has no joint that can be replayed: {reasons}")
    chained = () if believed.file.chain is None else tuple(link.joint for link in believed.file.chain.link)
    for name in left_out:
        if name in chained:
            raise SimulationError(
                f"{believed.where}: joint '{shown(name)}' of the chain {left_out[name]}; it cannot be replayed"
            )
    known = reader.catalogue().channels
    roles = {name: _roles(joint, log.name, known) for name, joint in movable.items()}
    wanted = set().union(*(wanted_channels(joint, log.name, roles[name]) for name, joint in movable.items()))
    missing = sorted(wanted - set(known) - set(reader.catalogue().unread))
    if missing:
        raise BindingError(
            f"{log.name}: there is no channel '{missing[0]}'{did_you_mean(missing[0], known) or '.'}"
            f" ('{command('inspect', log)}' lists all {len(known)})"
        )
    recording = read(log, wanted, rate=options.rate)
    signals = {name: _bound(recording, name, joint, roles[name]) for name, joint in movable.items()}
    return ReplayJob(log, actual, believed, signals, left_out, files, options)


def _why_not(joint: Joint) -> str | None:
    return "is pneumatic" if isinstance(joint, PneumaticJoint) else None


def _movable(joint: Joint) -> Movable:
    assert not isinstance(joint, PneumaticJoint)
    return joint


def _roles(joint: Joint, log: str, known: Collection[str]) -> list[str]:
    """Return the roles to bind: those that are needed, and those of the others that the log has."""
    return [
        role
        for role in offered_roles(joint)
        if role.removesuffix("_1").removesuffix("_2") in NEEDED or wanted_channels(joint, log, [role]) <= set(known)
    ]


def _bound(recording: Recording, name: str, joint: Joint, roles: Collection[str]) -> JointSignals:
    # The simulation applies the rig's drive to a motor's torque; binding must not have applied it before.
    signals = bind([recording], name, joint, roles, acting=False)
    if len(signals.run_names) > 1:
        raise SimulationError(
            f"{recording.path.name}: holds {len(signals.run_names)} runs of joint '{shown(name)}', but one is replayed at a time:"
            " leave one [[joint.….run]] in the rig"
        )
    return signals


def _joint(name: str, signals: JointSignals, replayed: Replayed) -> JointReplay:
    simulated = dict(replayed.simulated[name])
    for role in signals.roles:
        # A set-point is bound as the lever arm.
        names = ("lever_arm",) if role == "setpoint" else SENSED.get(role, ())
        same = next((known for known in names if known in simulated), None)
        if same is not None:
            simulated[role] = simulated[same]
    return JointReplay(signals, simulated, replayed.driven[name], int(replayed.restarted.sum()))


def position_of(torque_role: str) -> str:
    """Return the role of the position of the motor with this torque."""
    return "setpoint" if torque_role == "secondary_torque" else torque_role.replace("torque", "position")


def unit_of(name: str) -> str | None:
    """Return the SI unit of a role, or of a name of the simulation's."""
    plain = name.removesuffix("_1").removesuffix("_2").removesuffix("_total")
    if plain == "setpoint":
        return UNITS["arm"]
    if plain in ROLE_UNITS:
        return ROLE_UNITS[plain][0]
    return UNITS.get(plain.rpartition("_")[2])
