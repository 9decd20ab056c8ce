"""A recording and a joint of a rig become the joint's signals: SI, the joint's side of the gear, one uniform grid.

Nothing is interpolated across a gap: where a role that is used has none for more than a few of its own sample times, or a
clock jumps back, the run ends and another begins.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from vsalog.acting import acting_notes, acting_torque, is_motor_torque
from vsalog.binding_notes import binding_notes, tally_of
from vsalog.encoders import on_the_same_turn, unwrapped
from vsalog.errors import BindingError
from vsalog.grid import EVEN, Bound, after_long_silence, common_segments, grid_of, on_grid, own_stretches
from vsalog.neighbours import Neighbours
from vsalog.outliers import stand_alone
from vsalog.recording import Recording
from vsalog.resolution import resolution_of
from vsalog.rig.schema import Joint, RigidJoint, Run, SerialJoint, Signal
from vsalog.role_source import constant_of, motor_of, origin_of, source_of
from vsalog.signals import JointSignals

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


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


def runs_of(joint: Joint, recording: Recording) -> tuple[Run, ...]:
    """Return the runs of a joint that apply to a recording; one without a name when the rig has none.

    Raises
    ------
    BindingError
        The rig has runs, but none is for a file of that name.
    """
    runs = () if isinstance(joint, RigidJoint) else joint.run
    if not runs:
        return (Run(),)
    fitting = tuple(r for r in runs if fnmatchcase(recording.path.name, r.file))
    if not fitting:
        patterns = ", ".join(f"'{r.file}'" for r in runs[:5])
        raise BindingError(
            f"{recording.path.name}: no run of the rig is for a file of that name (there are {patterns})"
        )
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
    neighbours : other joints and their roles, bound on the same grid as ``JOINT/ROLE``

    Raises
    ------
    BindingError
        A channel is not there, is text, is empty or has no clock, its unit does not fit, or the clocks do not overlap.
    """
    offered = offered_roles(joint)
    pieces: list[JointSignals] = []
    names: list[str] = []
    labels = names_of([r.path for r in recordings])
    for i, recording in enumerate(recordings):
        fixed = setpoints[i] if i < len(setpoints) else None
        for run in runs_of(joint, recording):
            others = {
                f"{other}/{role}": b
                for other, (its, of_it) in neighbours.items()
                for role, b in _bind_roles(recording, run, of_it, its, None, acting).items()
            }
            bound = _bind_roles(recording, run, (*roles, *_beside(offered, roles)), joint, fixed, acting) | others
            names.append("/".join(p for p in ((labels[i] if len(recordings) > 1 else ""), run.name) if p))
            signals = _on_one_grid(recording, name, bound, len(names) - 1)
            piece = _less_series(recording, signals, offered, (*roles, *others))
            motors = {role: motor_of(joint, role) for role in bound if acting and is_motor_torque(role)}
            pieces.append(replace(piece, notes=(*piece.notes, *acting_notes(name, motors))))
    return _concatenate(name, pieces, tuple(names))


def _bind_roles(
    recording: Recording, run: Run, roles: Collection[str], joint: Joint, fixed: float | None, acting: bool
) -> dict[str, Bound]:
    offered = offered_roles(joint)
    bound = {role: _bind_role(recording, run, role, offered.get(role, Signal()), joint, fixed) for role in roles}
    if acting:
        bound |= {role: acting_torque(b, motor_of(joint, role)) for role, b in bound.items() if is_motor_torque(role)}
    return bound


def _bind_role(recording: Recording, run: Run, role: str, signal: Signal, joint: Joint, fixed: float | None) -> Bound:
    constant = constant_of(recording, run, role, signal, fixed)
    if constant is not None:
        return Bound(np.empty(0, np.int64), np.empty(0), 0, constant=constant)
    source = source_of(recording, run, role, signal, joint)
    channel = recording.channel(source.channel)
    # First: a sample that stands alone must not become a turn.
    alone = stand_alone(channel.values, source.turn) if source.may_stand_alone else None
    recorded = channel.values if alone is None else np.where(alone, np.nan, channel.values)
    wrapped = False
    if source.turn is not None:
        recorded, wrapped = unwrapped(recorded, source.turn)
    bound = source.bound(channel.stamps, recorded, int(np.median(np.diff(channel.stamps))))
    return replace(bound, wrapped=wrapped and source.joint_turn, alone=None if alone is None else bound.stamps[alone])


def _on_one_grid(recording: Recording, joint: str, bound: Mapping[str, Bound], run: int) -> JointSignals:
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
            role: resolution_of(b.values) if b.resolution is None else b.resolution for role, b in moving.items()
        },
        notes=(
            *binding_notes(joint, segments, {role: tally_of(b) for role, b in moving.items()}, origin),
            *(f"joint '{joint}': {role} was on another turn than link_position and is turned to it" for role in turned),
        ),
    )


def _less_series(
    recording: Recording, signals: JointSignals, offered: Mapping[str, Signal], wanted: Collection[str]
) -> JointSignals:
    """Take off each deflection what a part in series adds to it under the measured torque."""
    roles = dict(signals.roles)
    for role in signals.roles:
        stiffness = offered[role].series_stiffness if role in offered else None
        if stiffness is None:
            continue
        sensor = role.replace("deflection", "torque_sensor")
        if sensor not in roles:
            raise BindingError(
                f"{recording.path.name}: {role} has a series_stiffness, which needs a {sensor} in the rig too"
            )
        roles[role] = roles[role] - roles[sensor] / stiffness
    return replace(signals, roles={role: roles[role] for role in roles if role in wanted})


def _concatenate(name: str, pieces: Sequence[JointSignals], run_names: tuple[str, ...]) -> JointSignals:
    first = pieces[0]
    periods = np.array([p.period for p in pieces])
    if np.ptp(periods) > EVEN * periods[0]:
        raise BindingError(
            f"joint '{name}': the runs were sampled at different rates"
            f" ({1.0 / periods.max():.4g} to {1.0 / periods.min():.4g} Hz); estimate them one by one"
        )
    if len(pieces) == 1:
        return replace(first, run_names=run_names)
    steps = {role: [p.resolution[role] for p in pieces if p.resolution.get(role, 0.0) > 0.0] for role in first.roles}
    return JointSignals(
        name,
        first.period,
        np.concatenate([p.stamps for p in pieces]),
        np.concatenate([p.time for p in pieces]),
        {role: np.concatenate([p.roles[role] for p in pieces]) for role in first.roles},
        np.concatenate([p.starts for p in pieces]),
        np.concatenate([p.run for p in pieces]),
        run_names,
        {role: min(found) for role, found in steps.items() if found},
        tuple(note for p in pieces for note in p.notes),
    )
