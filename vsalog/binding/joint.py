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
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.clock_skew import clock_findings
from vsalog.binding.drive_model import acting_findings, acting_torque, is_motor_torque
from vsalog.binding.findings import binding_findings, tally_of
from vsalog.binding.grid import (
    EVEN,
    Bound,
    after_long_silence,
    common_segments,
    grid_of,
    interpolated_noise,
    less,
    on_grid,
    own_stretches,
    stamps_where,
)
from vsalog.binding.neighbours import Neighbours
from vsalog.binding.outliers import stand_alone
from vsalog.binding.role_source import constant_of, motor_of, origin_of, source_of
from vsalog.binding.unwrapping import on_the_same_turn, unwrapped
from vsalog.binding.zero_order_hold import held
from vsalog.core.errors import BindingError
from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.core.resolution import coarser, resolution_of
from vsalog.core.signals import Interpolated, JointSignals
from vsalog.rig.schema import Joint, RigidJoint, Run, SerialJoint, Signal

Array = NDArray[np.float64]


class _Log(Protocol):
    @property
    def path(self) -> Path: ...


Log = TypeVar("Log", bound=_Log)


def signal_of(spec: str | float | Signal) -> Signal:
    """Write out a role given in short: a channel's name, or a constant."""
    if isinstance(spec, Signal):
        return spec
    return Signal(channel=spec) if isinstance(spec, str) else Signal(constant=float(spec))


def offered_roles(joint: Joint) -> dict[str, Signal]:
    """Return the roles a joint's rig names, written out; a run's set-point counts as one."""
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
    """Return the torque sensors that have to be read too, because parts in series give way under their torque."""
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
    setpoints : a fixed set-point per recording that goes before what the rig says, SI; None for none
    acting : False binds motor torques as they were recorded, for a simulation that plays gain, offset, delay and step itself
    noise : True tells the noise of roles that have to be interpolated, see `JointSignals.interpolated`
    neighbours : other joints and their roles, bound on the same grid as ``JOINT/ROLE``

    Raises
    ------
    BindingError
        A channel is not there, is text, is empty or has no clock, its unit does not fit, or the clocks do not overlap.
    """
    offered = offered_roles(joint)
    pieces: list[JointSignals] = []
    names: list[str] = []
    wanted = [*roles, *(f"{other}/{role}" for other, (_, its) in neighbours.items() for role in its)]
    for recording, run, fixed, run_name in each_run(recordings, joint, setpoints):
        bound = {
            named: _bind_role(recording, run, role, its, constant, acting)
            for named, role, its, constant in roles_of_all(joint, roles, neighbours, fixed)
        }
        channels = channels_of(recording, run, roles_of_all(joint, roles, neighbours, fixed))
        clocks = clock_findings(recording, name, channels)
        signals = _on_one_grid(recording, name, bound, len(names), noise)
        kept = less_series(recording.path.name, signals.roles, offered, wanted)
        motors = {role: motor_of(joint, role) for role in bound if acting and is_motor_torque(role)}
        pieces.append(
            replace(signals, roles=kept, findings=(*clocks, *signals.findings, *acting_findings(name, motors)))
        )
        names.append(run_name)
    return _concatenate(name, pieces, tuple(names))


def each_run(
    recordings: Sequence[Log], joint: Joint, setpoints: Sequence[float | None]
) -> Iterator[tuple[Log, Run, float | None, str]]:
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


def roles_of_all(
    joint: Joint, roles: Collection[str], neighbours: Neighbours, fixed: float | None
) -> Iterator[tuple[str, str, Joint, float | None]]:
    """Yield each role to bind: as it is named among the joint's signals, in its own joint, that joint, and a fixed set-point."""
    for role in (*roles, *_beside(offered_roles(joint), roles)):
        yield role, role, joint, fixed
    for other, (its, of_it) in neighbours.items():
        for role in of_it:
            yield f"{other}/{role}", role, its, None


def channels_of(recording: Recording, run: Run, roles: Iterable[tuple[str, str, Joint, float | None]]) -> Iterator[str]:
    """Yield the channels of those of a run's roles that are no constants."""
    for _, role, joint, fixed in roles:
        signal = offered_roles(joint).get(role, Signal())
        if signal.channel is not None and constant_of(recording, run, role, signal, fixed) is None:
            yield signal.channel.replace("{run}", run.name)


def _bind_role(recording: Recording, run: Run, role: str, joint: Joint, fixed: float | None, acting: bool) -> Bound:
    signal = offered_roles(joint).get(role, Signal())
    motor = motor_of(joint, role) if acting and is_motor_torque(role) else None
    constant = constant_of(recording, run, role, signal, fixed)
    if constant is not None:
        bound = Bound(np.empty(0, np.int64), np.empty(0), 0, constant=constant)
        return bound if motor is None else acting_torque(bound, motor)
    source = source_of(recording, run, role, signal, joint)
    channel = recording.channel(source.channel)
    # First: a sample that stands alone must not become a turn.
    alone = stand_alone(channel.values, source.turn) if source.may_stand_alone else None
    recorded = less(channel.values, alone)
    period = int(np.median(np.diff(channel.stamps)))
    hung = held(channel.stamps, recorded, period, source.turn) if source.may_stand_alone else None
    recorded, wrapped = less(recorded, hung), False
    if source.turn is not None:
        recorded, wrapped = unwrapped(recorded, source.turn)
    bound = source.bound(channel.stamps, recorded, period)
    bound = replace(
        bound, wrapped=wrapped and source.joint_turn, alone=stamps_where(bound, alone), held=stamps_where(bound, hung)
    )
    return bound if motor is None else acting_torque(bound, motor)


def _on_one_grid(recording: Recording, joint: str, bound: Mapping[str, Bound], run: int, noise: bool) -> JointSignals:
    moving = {role: b for role, b in bound.items() if b.constant is None}
    if not moving:
        raise BindingError(f"joint '{joint}': every role is a constant; there is nothing to estimate from")
    period = min(b.period for b in moving.values())
    if period <= 0:
        raise BindingError(f"{recording.path.name}: the time stamps of joint '{joint}' do not advance")
    origin = origin_of(recording)
    segments = common_segments(recording.path.name, joint, (own_stretches(b) for b in moving.values()))
    grids = [grid_of(segment, moving, period) for segment in segments]
    stamps = grids[0] if len(grids) == 1 else np.concatenate(grids)
    starts = np.zeros(stamps.size, dtype=np.bool_)
    starts[np.cumsum([0, *[g.size for g in grids[:-1]]])] = True
    roles: dict[str, Array] = {}
    for role, b in bound.items():
        roles[role] = np.full(stamps.size, b.constant) if b.constant is not None else on_grid(b, stamps)
    starts |= after_long_silence(roles)[0]
    turned = on_the_same_turn(roles, starts, [role for role, b in moving.items() if b.wrapped])
    roles |= turned
    return JointSignals(
        joint,
        period * 1e-9,
        stamps,
        (stamps - origin).astype(np.float64) * 1e-9,
        roles,
        starts,
        np.full(stamps.size, run, dtype=np.int32),
        resolution={
            role: resolution_of(b.values) if b.resolution is None else coarser(b.resolution, b.values)
            for role, b in moving.items()
        },
        findings=(
            *binding_findings(joint, segments, {role: tally_of(b) for role, b in moving.items()}, origin),
            *turned_findings(joint, turned),
        ),
        interpolated={
            role: own
            for role, b in (moving.items() if noise else ())
            if (own := interpolated_noise(b, stamps, period)) is not None
        },
    )


def turned_findings(joint: str, turned: Collection[str]) -> Iterator[Finding]:
    """Yield of roles that they were turned by whole turns."""
    for role in turned:
        yield Finding(code="encoder.other_turn", joint=joint, part=role, severity="info")


def less_series(
    log: str, recorded: Mapping[str, Array], offered: Mapping[str, Signal], wanted: Collection[str]
) -> dict[str, Array]:
    """Take off each deflection what a part in series adds to it under the measured torque, and keep the wanted roles.

    Raises
    ------
    BindingError
        There is no torque sensor to tell.
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


def refuse_other_rates(name: str, runs: Sequence[float]) -> None:
    """Refuse runs whose periods [s] differ.

    Raises
    ------
    BindingError
        They do.
    """
    periods = np.array(runs)
    if np.ptp(periods) > EVEN * periods[0]:
        raise BindingError(
            f"joint '{name}': the runs were sampled at different rates"
            f" ({1.0 / periods.max():.4g} to {1.0 / periods.min():.4g} Hz); estimate them one by one"
        )


def least_steps(runs: Sequence[Mapping[str, float]], roles: Collection[str]) -> dict[str, float]:
    """Return role → resolution over all runs: the least that could be told."""
    if len(runs) == 1:
        return dict(runs[0])
    steps = {role: [run[role] for run in runs if run.get(role, 0.0) > 0.0] for role in roles}
    return {role: min(found) for role, found in steps.items() if found}


def _concatenate(name: str, pieces: Sequence[JointSignals], run_names: tuple[str, ...]) -> JointSignals:
    first = pieces[0]
    refuse_other_rates(name, [p.period for p in pieces])
    if len(pieces) == 1:
        return replace(first, run_names=run_names)
    return JointSignals(
        name,
        first.period,
        np.concatenate([p.stamps for p in pieces]),
        np.concatenate([p.time for p in pieces]),
        {role: np.concatenate([p.roles[role] for p in pieces]) for role in first.roles},
        np.concatenate([p.starts for p in pieces]),
        np.concatenate([p.run for p in pieces]),
        run_names,
        least_steps([p.resolution for p in pieces], first.roles),
        tuple(finding for p in pieces for finding in p.findings),
        noisiest([p.interpolated for p in pieces]),
    )


def noisiest(runs: Sequence[Mapping[str, Interpolated]]) -> dict[str, Interpolated]:
    """Return role → the noise of the run that has most of it, of roles that were interpolated in any."""
    every = sorted((item for run in runs for item in run.items()), key=lambda item: item[1].deviation)
    return dict(every)
