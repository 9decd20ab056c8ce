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
from vsalog.binding_notes import binding_notes
from vsalog.encoders import TURN, on_the_same_turn, unwrapped
from vsalog.errors import BindingError, UnitError
from vsalog.grid import EVEN, Bound, after_long_silence, common_segments, grid_of, on_grid
from vsalog.neighbours import Neighbours
from vsalog.outliers import ROLES, stand_alone
from vsalog.recording import Channel, Recording
from vsalog.resolution import resolution_of
from vsalog.rig.schema import Joint, Motor, PneumaticJoint, RigidJoint, Run, SerialJoint, Signal, role_units
from vsalog.sensors import seen_by
from vsalog.signals import JointSignals
from vsalog.units import si_factor

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# No position or torque is larger, in SI.
HUGEST = 1e30


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
            motors = {role: _motor(joint, role) for role in bound if acting and is_motor_torque(role)}
            pieces.append(replace(piece, notes=(*piece.notes, *acting_notes(name, motors))))
    return _concatenate(name, pieces, tuple(names))


def _bind_roles(
    recording: Recording, run: Run, roles: Collection[str], joint: Joint, fixed: float | None, acting: bool
) -> dict[str, Bound]:
    offered = offered_roles(joint)
    bound = {role: _bind_role(recording, run, role, offered.get(role, Signal()), joint, fixed) for role in roles}
    if acting:
        bound |= {role: acting_torque(b, _motor(joint, role)) for role, b in bound.items() if is_motor_torque(role)}
    return bound


def _bind_role(recording: Recording, run: Run, role: str, signal: Signal, joint: Joint, fixed: float | None) -> Bound:
    constant: float | str | None = signal.constant
    if role == "setpoint":
        constant = fixed if fixed is not None else run.setpoint if run.setpoint is not None else constant
    if constant is not None and (role != "setpoint" or signal.channel is None or fixed is not None):
        if not np.isfinite(float(constant)):
            raise BindingError(
                f"{recording.path.name}: run '{run.name}' has no set-point; give it one in the rig or with"
                " --set setpoint=VALUE"
            )
        return Bound(np.empty(0, np.int64), np.empty(0), 0, constant=float(constant))
    assert signal.channel is not None
    channel = recording.channel(signal.channel.replace("{run}", run.name))
    _check(recording, channel, role)
    factor = _factor(recording, channel, role, signal, joint)
    # First: a sample that stands alone must not become a turn.
    alone = _alone(channel, signal, role)
    if alone is not None:
        channel = replace(channel, values=np.where(alone, np.nan, channel.values))
    recorded, wrapped = _unwrapped(channel, signal, role)
    # A long log's columns are not copied when there is nothing to change.
    values = recorded if factor == 1.0 else recorded * factor
    if not np.isfinite(values).all():
        values = np.where(np.isfinite(values), values, np.nan)
    values, resolution = seen_by(values, signal, _seconds(recording, channel) if signal.drift else None)
    if role == "setpoint" and isinstance(joint, SerialJoint) and joint.lever is not None and _is_angle(channel, signal):
        values = joint.lever.start - joint.lever.travel * values
        resolution = None if resolution is None else resolution * abs(joint.lever.travel)
    greatest = float(np.fmax.reduce(np.abs(values)))
    if greatest > HUGEST:
        raise BindingError(
            f"{recording.path.name}: channel '{channel.name}' ({role}) reaches {greatest:.3g} in SI: is its unit, its offset or"
            " the gear ratio in the rig right?"
        )
    period = int(np.median(np.diff(channel.stamps)))
    # A turn of the rotor is no turn of the joint.
    wrapped = wrapped and (signal.side == "joint" or role == "link_position" or _motor(joint, role).gear_ratio == 1.0)
    stamps = channel.stamps - round(signal.delay * 1e9) if signal.delay else channel.stamps
    return Bound(stamps, values, period, resolution, wrapped=wrapped, alone=None if alone is None else stamps[alone])


def _seconds(recording: Recording, channel: Channel) -> Array:
    """Return the times of a channel's samples from the log's start [s]."""
    return np.asarray((channel.stamps - _origin(recording)).astype(np.float64) * 1e-9)


def _origin(recording: Recording) -> int:
    """Return the log's first stamp."""
    return min(int(c.stamps[0]) for c in recording.channels.values() if c.stamps.size)


def _turn(channel: Channel, signal: Signal, role: str) -> float | None:
    """Return the turn after which an encoder may begin anew, as it is recorded; None for what is no encoder."""
    unit = _unit(channel, signal) or "rad"
    if not role.startswith(("motor_position", "link_position")) or not _converts(unit, "rad"):
        return None
    return TURN / si_factor(unit, "rad")


def _alone(channel: Channel, signal: Signal, role: str) -> Flags | None:
    """Return where samples of a sensor stand alone; None where none does, or the role may jump."""
    return stand_alone(channel.values, _turn(channel, signal, role)) if role.startswith(ROLES) else None


def _unwrapped(channel: Channel, signal: Signal, role: str) -> tuple[Array, bool]:
    """Return a position without the jumps of an encoder that begins anew after a turn, and whether there were any."""
    turn = _turn(channel, signal, role)
    return (channel.values, False) if turn is None else unwrapped(channel.values, turn)


def _check(recording: Recording, channel: Channel, role: str) -> None:
    where = f"{recording.path.name}: channel '{channel.name}' ({role})"
    stream = recording.streams.get(channel.stream)
    if stream is not None and stream.time_source == "none":
        if stream.time_reason:
            raise BindingError(
                f"{where} has no time: {stream.time_reason}; put the rows in order, or say how fast they were sampled with"
                " --rate HZ"
            )
        raise BindingError(f"{where} has no time column; say how fast it was sampled with --rate HZ")
    if channel.values.size < 2:
        raise BindingError(
            f"{where} has {'one sample' if channel.values.size else 'no samples'}; at least two are needed"
        )
    finite = np.isfinite(channel.values)
    if not finite.any():
        raise BindingError(f"{where} holds no finite number at all")


def _motor(joint: Joint, role: str) -> Motor:
    if isinstance(joint, PneumaticJoint):
        return Motor()
    name = "motor_2" if role.endswith("_2") else "motor_1"
    motor: Motor = getattr(joint, name) if hasattr(joint, name) else joint.motor  # type: ignore[union-attr]
    if role in ("setpoint", "secondary_torque"):
        return getattr(joint, "secondary_motor", None) or Motor()
    return motor


def _unit(channel: Channel, signal: Signal) -> str | None:
    return signal.unit if signal.unit is not None else channel.unit


def _is_angle(channel: Channel, signal: Signal) -> bool:
    unit = _unit(channel, signal)
    return unit is None or _converts(unit, "rad")


def _converts(unit: str, like: str) -> bool:
    try:
        si_factor(unit, like)
    except UnitError:
        return False
    return True


def _factor(recording: Recording, channel: Channel, role: str, signal: Signal, joint: Joint) -> float:
    """What a recorded number is multiplied with to be SI, the right way round, on the joint's side of the gear."""
    base, motor, unit = role.removesuffix("_1").removesuffix("_2"), _motor(joint, role), _unit(channel, signal)
    gear = motor.gear_ratio if signal.side == "rotor" else 1.0
    like = role_units(role)[0]
    factor = float(signal.sign)
    if base in ("motor_torque", "secondary_torque"):
        factor *= gear
        if unit is not None and _converts(unit, "A"):
            if motor.torque_constant is None:
                raise BindingError(
                    f"{recording.path.name}: channel '{channel.name}' ({role}) is a current [{unit}]: give the motor's"
                    " torque_constant in the rig"
                )
            # The torque constant is the rotor's, whichever side the signal is said to be on.
            return float(signal.sign) * si_factor(unit, "A") * motor.torque_constant * motor.gear_ratio
    elif base in ("motor_position", "setpoint"):
        factor /= gear
    if base == "setpoint" and unit is not None and _converts(unit, "m"):
        return float(signal.sign) * si_factor(unit, "m")
    if unit is None:
        return factor
    try:
        return factor * si_factor(unit, like)
    except UnitError as error:
        raise BindingError(
            f"{recording.path.name}: channel '{channel.name}' ({role}): {error}. If the log has the unit wrong, put the"
            ' right one into the rig: { channel = "…", unit = "…" }'
        ) from error


def _on_one_grid(recording: Recording, joint: str, bound: Mapping[str, Bound], run: int) -> JointSignals:
    moving = {role: b for role, b in bound.items() if b.constant is None}
    if not moving:
        raise BindingError(f"joint '{joint}': every role is a constant; there is nothing to estimate from")
    period = min(b.period for b in moving.values())
    if period <= 0:
        raise BindingError(f"{recording.path.name}: the time stamps of joint '{joint}' do not advance")
    origin = _origin(recording)
    segments = common_segments(recording, joint, moving)
    grids = [grid_of(segment, moving, period) for segment in segments]
    stamps = grids[0] if len(grids) == 1 else np.concatenate(grids)
    starts = np.zeros(stamps.size, dtype=np.bool_)
    starts[np.cumsum([0, *[g.size for g in grids[:-1]]])] = True
    roles: dict[str, Array] = {}
    for role, b in bound.items():
        roles[role] = np.full(stamps.size, b.constant) if b.constant is not None else on_grid(b, stamps)
    starts |= after_long_silence(roles)
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
            *binding_notes(joint, segments, moving, origin),
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
