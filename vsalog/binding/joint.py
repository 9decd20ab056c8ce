"""A recording and a joint of a rig become the joint's signals: SI, the joint's side of the gear, one uniform grid.

Nothing is interpolated across a gap: where a role that is used has none for more than a few of its own sample times, or a
clock jumps back, the run ends and another begins.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.clock_skew import clock_findings
from vsalog.binding.drive_model import acting_findings, is_motor_torque, made_of
from vsalog.binding.grid import MOST_RATE_ERROR
from vsalog.binding.neighbours import Neighbours
from vsalog.binding.role import Role
from vsalog.binding.role_source import constant_of, motor_of, origin_of, source_of
from vsalog.binding.run import BoundRun
from vsalog.core.column import Column
from vsalog.core.errors import BindingError
from vsalog.core.finding import Finding
from vsalog.core.look import of_recording
from vsalog.core.recording import Recording
from vsalog.core.signals import Interpolated, JointSignals
from vsalog.rig.schema import Joint, RigidJoint, Run, SerialJoint, Signal

Array = NDArray[np.float64]


def signal_of(spec: str | float | Signal) -> Signal:
    """Expand a role given in short: a channel's name, or a constant."""
    if isinstance(spec, Signal):
        return spec
    return Signal(channel=spec) if isinstance(spec, str) else Signal(constant=float(spec))


def offered_roles(joint: Joint) -> dict[str, Signal]:
    """Return the roles that a joint's rig names, expanded; a run's set-point counts as one."""
    signals = joint.signals
    roles = {
        role: signal_of(spec) for role in signals.__struct_fields__ if (spec := getattr(signals, role)) is not None
    }
    runs = () if isinstance(joint, RigidJoint) else joint.run
    if "setpoint" not in roles and isinstance(joint, SerialJoint) and any(r.setpoint is not None for r in runs):
        roles["setpoint"] = Signal(constant=float("nan"))
    return roles


def names_of(paths: Sequence[Path]) -> list[str]:
    """Return the names of logs as text, with their folder in front where two logs have the same name."""
    names = [p.name for p in paths]
    shown = (f"{p.resolve().parent.name}/{p.name}" if names.count(p.name) > 1 else p.name for p in paths)
    return [name.encode("utf-8", "replace").decode() for name in shown]


def runs_of(joint: Joint, log: str) -> tuple[Run, ...]:
    """Return the runs of a joint that apply to a log of that name; one without a name when the rig has none.

    Raises
    ------
    BindingError
        The rig has runs, but none is for a file of that name.
    """
    runs = () if isinstance(joint, RigidJoint) else joint.run
    if not runs:
        return (Run(),)
    fitting = tuple(r for r in runs if fnmatchcase(log, r.file))
    if not fitting:
        patterns = ", ".join(f"'{r.file}'" for r in runs[:5])
        raise BindingError(f"{log}: no run of the rig is for a file of that name (there are {patterns})")
    return fitting


def wanted_channels(joint: Joint, recording_name: str, roles: Collection[str] | None = None) -> set[str]:
    """Return the names of the channels that the roles of a joint are found in, for reading no more than these."""
    runs = () if isinstance(joint, RigidJoint) else joint.run
    names = [r.name for r in runs if fnmatchcase(recording_name, r.file)] or [""]
    offered = offered_roles(joint)
    read = set(offered if roles is None else roles)
    read |= set(_beside(offered, read))
    return {
        signal.channel.replace("{run}", name)
        for role, signal in offered.items()
        if signal.channel is not None and role in read
        for name in names
    }


def _beside(offered: Mapping[str, Signal], roles: Collection[str]) -> list[str]:
    """Return the torque sensors that have to be read too, because parts in series deflect under their torque."""
    deflections = [role for role in roles if role in offered and offered[role].series_stiffness is not None]
    sensors = (role.replace("deflection", "torque_sensor") for role in deflections)
    return [role for role in sensors if role in offered and role not in roles]


def bind(
    recordings: Sequence[Recording],
    name: str,
    joint: Joint,
    roles: Collection[str],
    setpoints: Sequence[float | None] = (),
    *,
    acting: bool = True,
    noise: bool = False,
    neighbours: Neighbours = MappingProxyType({}),
) -> JointSignals:
    """Bind the roles of a joint to one or more recordings.

    A motor's torque is bound as what acts on the rotor: torque_gain · τ(t − torque_delay) + torque_offset, with the recorded τ
    rounded to torque_step.

    Parameters
    ----------
    recordings : in the order their runs shall have
    name, joint : of the rig
    roles : the roles to bind, each offered by the rig
    setpoints : a fixed set-point per recording that overrides the rig's, SI; None for none
    acting : False binds motor torques as they were recorded, for a simulation that applies gain, offset, delay and step itself
    noise : True estimates the noise of roles that have to be interpolated, see `JointSignals.interpolated`
    neighbours : other joints and their roles, bound on the same grid as ``JOINT/ROLE``

    Raises
    ------
    BindingError
        A channel is missing, is text, is empty or has no clock, its unit does not fit, or the clocks do not overlap.
    """
    offered = offered_roles(joint)
    wanted = [*roles, *(f"{other}/{role}" for other, (_, its) in neighbours.items() for role in its)]
    names: list[str] = []
    bounds: list[tuple[str, str, dict[str, Role | float], int]] = []
    clocks: list[Iterable[Finding]] = []
    drives: list[Iterable[Finding]] = []
    for recording, run, fixed, run_name in _each_run(recordings, joint, setpoints):
        look = of_recording(recording)
        every = [*_roles_of_all(joint, roles, neighbours, fixed)]
        found = {
            named: _role(recording, look, run, role, its, its_fixed, acting) for named, role, its, its_fixed in every
        }
        names.append(run_name)
        clocks.append(clock_findings(recording, name, _channels_of(recording, run, every)))
        bounds.append((recording.path.name, name, found, origin_of(recording)))
        motors = {role: motor_of(joint, role) for role in found if acting and is_motor_torque(role)}
        drives.append(acting_findings(name, motors))
    runs = _at_one_rate([BoundRun(*bound, noise=noise) for bound in bounds], bounds, noise)
    out = _Rows(sum(run.rows for run in runs), in_file=any(recording.in_file for recording in recordings))
    resolutions, noises = [], []
    for number, one in enumerate(runs):
        for stamps, values, starts in one.blocks():
            out.add(number, stamps, one.origin, _less_series(one.log, values, offered, wanted), starts)
        resolution, interpolated = one.told()
        resolutions.append(resolution)
        noises.append(interpolated)
    findings = (
        f for clock, run, drive in zip(clocks, runs, drives, strict=True) for f in (*clock, *run.findings(), *drive)
    )
    signals = out.signals(
        name, runs[0].period * 1e-9, tuple(names), _least_steps(resolutions, wanted), tuple(findings), _noisiest(noises)
    )
    return replace(signals, periods=tuple(run.sampled * 1e-9 for run in runs)) if len(runs) > 1 else signals


class _Rows:
    """The rows of a joint's signals, gathered block by block.

    Parameters
    ----------
    room : rows that are expected
    in_file : whether they are too long for memory
    """

    def __init__(self, room: int, *, in_file: bool) -> None:
        self._room, self._in_file = room, in_file
        self._stamps, self._time = Column(np.int64, room, in_file=in_file), Column(np.float64, room, in_file=in_file)
        self._starts, self._run = Column(np.bool_, room, in_file=in_file), Column(np.int32, room, in_file=in_file)
        self._roles: dict[str, Column[np.float64]] = {}

    def add(
        self, run: int, stamps: NDArray[np.int64], origin: int, roles: Mapping[str, Array], starts: NDArray[np.bool_]
    ) -> None:
        """Append a block of a run's rows; `origin` is its log's first stamp [ns]."""
        self._stamps.append(stamps)
        self._time.append((stamps - origin).astype(np.float64) * 1e-9)
        self._starts.append(starts)
        self._run.append(np.full(stamps.size, run, dtype=np.int32))
        for role, values in roles.items():
            if role not in self._roles:
                self._roles[role] = Column(np.float64, self._room, in_file=self._in_file)
            self._roles[role].append(values)

    def signals(
        self,
        joint: str,
        period: float,
        run_names: tuple[str, ...],
        resolution: Mapping[str, float],
        findings: tuple[Finding, ...],
        interpolated: Mapping[str, Interpolated],
    ) -> JointSignals:
        """Return all rows, with the findings about them."""
        count = len(self._stamps)
        return JointSignals(
            joint,
            period,
            self._stamps.whole(count),
            self._time.whole(count),
            {role: column.whole(count) for role, column in self._roles.items()},
            self._starts.whole(count),
            self._run.whole(count),
            run_names,
            resolution,
            findings,
            interpolated,
        )


def _each_run(
    recordings: Sequence[Recording], joint: Joint, setpoints: Sequence[float | None]
) -> Iterator[tuple[Recording, Run, float | None, str]]:
    """Yield each run of a joint in the logs, with its log, the set-point that is fixed for it and its name.

    Raises
    ------
    BindingError
        The rig has runs, but none is for a file of that name.
    """
    labels = names_of([r.path for r in recordings])
    for i, recording in enumerate(recordings):
        fixed = setpoints[i] if i < len(setpoints) else None
        for run in runs_of(joint, recording.path.name):
            parts = ((labels[i] if len(recordings) > 1 else ""), run.name)
            yield recording, run, fixed, "/".join(part for part in parts if part)


def _roles_of_all(
    joint: Joint, roles: Collection[str], neighbours: Neighbours, fixed: float | None
) -> Iterator[tuple[str, str, Joint, float | None]]:
    """Yield each role to bind: as it is named among the joint's signals, in its own joint, that joint, and a fixed set-point."""
    for role in (*roles, *_beside(offered_roles(joint), roles)):
        yield role, role, joint, fixed
    for other, (its, of_it) in neighbours.items():
        for role in of_it:
            yield f"{other}/{role}", role, its, None


def _channels_of(
    recording: Recording, run: Run, roles: Iterable[tuple[str, str, Joint, float | None]]
) -> Iterator[str]:
    """Yield the channels of those of a run's roles that are no constants."""
    for _, role, joint, fixed in roles:
        signal = offered_roles(joint).get(role, Signal())
        if signal.channel is not None and constant_of(recording, run, role, signal, fixed) is None:
            yield signal.channel.replace("{run}", run.name)


def _role(
    recording: Recording, look: Recording, run: Run, role: str, joint: Joint, fixed: float | None, acting: bool
) -> Role | float:
    """Return a role of a run, or the constant that it is; `look` is the part of the recording that was read."""
    signal = offered_roles(joint).get(role, Signal())
    motor = motor_of(joint, role) if acting and is_motor_torque(role) else None
    constant = constant_of(recording, run, role, signal, fixed)
    if constant is not None:
        return constant if motor is None else float(made_of(np.array([constant]), motor.reflected)[0])
    source = source_of(look, run, role, signal, joint)
    return Role(source, recording.channel(source.channel), look.channel(source.channel), motor)


def _less_series(
    log: str, recorded: Mapping[str, Array], offered: Mapping[str, Signal], wanted: Collection[str]
) -> dict[str, Array]:
    """Subtract from each deflection that of a part in series under the measured torque, and keep the wanted roles.

    Raises
    ------
    BindingError
        There is no torque sensor to compute it from.
    """
    roles = dict(recorded)
    for role in recorded:
        stiffness = offered[role].series_stiffness if role in offered else None
        if stiffness is None:
            continue
        sensor = role.replace("deflection", "torque_sensor")
        if sensor not in roles:
            raise BindingError(f"{log}: {role} has a series_stiffness, which needs a {sensor} in the rig too")
        roles[role] = roles[role] - roles[sensor] / stiffness
    return {role: roles[role] for role in roles if role in wanted}


def _at_one_rate(
    runs: list[BoundRun], bounds: Sequence[tuple[str, str, dict[str, Role | float], int]], noise: bool
) -> list[BoundRun]:
    """Return runs on grids of one period: their own where these agree, else the longest, for which no sample is invented."""
    periods = np.array([run.period for run in runs])
    if np.ptp(periods) <= MOST_RATE_ERROR * periods.max():
        return runs
    return [BoundRun(*bound, noise=noise, period=int(periods.max())) for bound in bounds]


def _least_steps(runs: Sequence[Mapping[str, float]], roles: Collection[str]) -> dict[str, float]:
    """Return role → resolution over all runs: the least that was found."""
    if len(runs) == 1:
        return dict(runs[0])
    steps = {role: [run[role] for run in runs if run.get(role, 0.0) > 0.0] for role in roles}
    return {role: min(found) for role, found in steps.items() if found}


def _noisiest(runs: Sequence[Mapping[str, Interpolated]]) -> dict[str, Interpolated]:
    """Return role → the noise of the run that has most of it, of roles that were interpolated in any."""
    every = sorted((item for run in runs for item in run.items()), key=lambda item: item[1].deviation)
    return dict(every)
