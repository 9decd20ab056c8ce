"""Binding of logs that are too long for memory: as `binding` does it, part by part.

What is decided from a whole signal (its period, its resolution, what is usual of it) is decided from the stretches that were
looked at; gaps, an encoder's range and which samples stand alone are those of all samples. Where the stretches are the whole
log, the signals are those of `binding.bind`, bit for bit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.clock_skew import clock_findings
from vsalog.binding.drive_model import acting_findings, acting_torque, is_motor_torque, made_of
from vsalog.binding.findings import Tally, binding_findings
from vsalog.binding.grid import GAP, Bound, after_long_silence, common_segments, is_even, less, on_grid, stamps_where
from vsalog.binding.joint import (
    channels_of,
    each_run,
    least_steps,
    less_series,
    offered_roles,
    refuse_other_rates,
    roles_of_all,
    turned_findings,
)
from vsalog.binding.neighbours import Neighbours
from vsalog.binding.outliers import stand_alone_among, usual_of
from vsalog.binding.role_source import Source, constant_of, motor_of, origin_of, source_of
from vsalog.binding.unwrapping import JUMP, SameTurn, Unwrapping, begins_anew, turnable, turned_on, unwrapped_on
from vsalog.binding.zero_order_hold import MARGIN as AROUND
from vsalog.binding.zero_order_hold import held
from vsalog.core.errors import BindingError
from vsalog.core.finding import Finding
from vsalog.core.long_signals import LongSignals
from vsalog.core.recording import Channel
from vsalog.core.resolution import coarser, resolution_of
from vsalog.core.spool import PART, parts, row_of
from vsalog.readers.long_recording import LongChannel, LongRecording
from vsalog.rig.schema import Joint, Motor, Run, Signal

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]
Segments = list[tuple[int, int]]

# So many samples on either side tell whether one stands alone; so many reach across what is bridged.
MARGIN, BRIDGE = 64, 4


class LongRole:
    """A role of one run whose samples are gone through in order.

    Parameters
    ----------
    source : where the role comes from
    channel : its samples
    seen : the stretches of them that were looked at
    motor : whose torque the role is, where it is to be what acts on the rotor
    """

    def __init__(self, source: Source, channel: LongChannel, seen: Channel, motor: Motor | None) -> None:
        self.source, self.channel, self.motor = source.for_parts(), channel, motor
        self.period = int(np.median(np.diff(seen.stamps)))
        self.usual = usual_of(seen.values, source.turn) if source.may_stand_alone else None
        self.unwraps = self._unwraps()
        self.wrapped = self.unwraps and source.joint_turn
        self.tally = Tally()
        look = self._look(source, seen)
        said = look.resolution
        self.resolution = resolution_of(look.values) if said is None else coarser(said, look.values)
        self.shift = int(look.stamps[0] - seen.stamps[0])

    def parts(self) -> Iterator[Bound]:
        """Yield the role's samples, in SI; the tally is complete at the end."""
        state = Unwrapping()
        for stamps, values, alone, hung in self._recorded():
            if self.unwraps:
                assert self.source.turn is not None
                values, state = unwrapped_on(values, self.source.turn, state)
            bound = self.source.bound(stamps, values, self.period)
            bound = replace(bound, alone=stamps_where(bound, alone), held=stamps_where(bound, hung))
            if self.motor is not None:
                bound = acting_torque(replace(bound, resolution=1.0), self.motor)
            self.tally.add(bound)
            yield bound

    def stretches(self) -> Segments:
        """Return the stretches of time, first and last stamp, in which the role has samples without a gap."""
        found: Segments = []
        first = last = int(self.channel.stamps[0:1][0]) + self.shift
        count = 0
        for begin, end in parts(len(self.channel.stamps)):
            stamps = self.channel.stamps[begin:end] + self.shift
            at = 0
            for gap in np.flatnonzero(np.diff(stamps, prepend=last) > GAP * self.period).tolist():
                if count + gap - at > 1:
                    found.append((first, last if gap == 0 else int(stamps[gap - 1])))
                first, at, count = int(stamps[gap]), gap, 0
            count += stamps.size - at
            last = int(stamps[-1])
        return [*found, (first, last)] if count > 1 else found

    def even(self, segments: Segments, period: int) -> list[bool]:
        """Tell of each segment whether the role's own stamps there are a grid of that period [ns]."""
        firsts, lasts = np.array(segments, dtype=np.int64).T
        least = np.full(len(segments), np.iinfo(np.int64).max)
        greatest = np.full(len(segments), -1)
        before = np.empty(0, np.int64)
        for begin, end in parts(len(self.channel.stamps)):
            stamps = np.concatenate((before, self.channel.stamps[begin:end] + self.shift))
            of = np.searchsorted(firsts, stamps, "right") - 1
            inside = (of >= 0) & (stamps <= lasts[of])
            pair = inside[1:] & inside[:-1] & (of[1:] == of[:-1])
            steps = np.diff(stamps)[pair]
            np.minimum.at(least, of[1:][pair], steps)
            np.maximum.at(greatest, of[1:][pair], steps)
            before = stamps[-1:]
        return [g >= 0 and is_even(int(s), int(g), period) for s, g in zip(least, greatest, strict=True)]

    def rows(self, segment: tuple[int, int]) -> tuple[int, int]:
        """Return the role's first row in a segment, and the first one after it."""
        stamps = self.channel.stamps
        return row_of(stamps, segment[0] - self.shift), row_of(stamps, segment[1] + 1 - self.shift)

    def _recorded(self) -> Iterator[tuple[Stamps, Array, Flags | None, Flags | None]]:
        """Yield stamps, values as recorded without those that stand alone or were held, and where these are."""
        for first, last in parts(len(self.channel.values)):
            if not self.source.may_stand_alone:
                yield self.channel.stamps[first:last], self.channel.values[first:last], None, None
                continue
            begin, end = max(0, first - AROUND), last + AROUND
            stamps, alone = self.channel.stamps[begin:end], self._alone(begin, end)
            values = less(self.channel.values[begin:end], alone)
            hung = held(stamps, values, self.period, self.source.turn)
            here = slice(first - begin, last - begin)
            alone, hung = (None if flags is None else flags[here] for flags in (alone, hung))
            yield stamps[here], less(values[here], hung), alone, hung

    def _alone(self, first: int, last: int) -> Flags | None:
        if self.usual is None:
            return None
        begin = max(0, first - MARGIN)
        found = stand_alone_among(self.channel.values[begin : last + MARGIN], self.usual, self.source.turn)
        return None if found is None else found[first - begin : last - begin]

    def _unwraps(self) -> bool:
        """Tell whether the role is an encoder that begins anew after a turn, as `encoders.unwrapped` does."""
        turn = self.source.turn
        if turn is None:
            return False
        low, high, jump, before = np.inf, -np.inf, 0.0, np.empty(0)
        for _, values, *_ in self._recorded():
            known = np.concatenate((before, values[np.isfinite(values)]))
            if known.size:
                low, high = min(low, float(known.min())), max(high, float(known.max()))
                jump = max(jump, float(np.abs(np.diff(known)).max(initial=0.0)))
                before = known[-1:]
        return jump > JUMP * turn and begins_anew(high - low, turn)

    def _look(self, source: Source, seen: Channel) -> Bound:
        """Return what was looked at, in SI: its jumps from one stretch to the next do not matter."""
        values = seen.values
        alone = None if self.usual is None else stand_alone_among(values, self.usual, source.turn)
        values = less(values, alone)
        if source.may_stand_alone:
            values = less(values, held(seen.stamps, values, self.period, source.turn))
        if self.unwraps and source.turn is not None:
            values, _ = unwrapped_on(values, source.turn, Unwrapping())
        bound = source.bound(seen.stamps, values, self.period)
        return bound if self.motor is None else acting_torque(bound, self.motor)


class _Ahead:
    """The samples of a role around the rows that are wanted next."""

    def __init__(self, role: LongRole) -> None:
        self._parts = role.parts()
        self._held = next(self._parts)

    def around(self, first: int, last: int) -> Bound:
        """Return the samples from some before a stamp to some that are not before another."""
        ours = self._held
        # What is missing at either end is bridged from beyond.
        while ours.stamps[-BRIDGE:][0] < last and (part := next(self._parts, None)) is not None:
            ours = self._from(ours, first)
            ours = replace(
                ours,
                stamps=np.concatenate((ours.stamps, part.stamps)),
                values=np.concatenate((ours.values, part.values)),
            )
        self._held = self._from(ours, first)
        return self._held

    def finish(self) -> None:
        """Go to the end."""
        for _ in self._parts:
            pass

    @staticmethod
    def _from(ours: Bound, first: int) -> Bound:
        begin = max(0, min(int(np.searchsorted(ours.stamps, first)) - BRIDGE, ours.stamps.size - BRIDGE))
        return replace(ours, stamps=ours.stamps[begin:], values=ours.values[begin:])


class _LongRun:
    """The roles of one run, brought onto one grid.

    Parameters
    ----------
    log, joint : their names
    roles : by name, or a constant
    origin : the log's first stamp [ns]

    Raises
    ------
    BindingError
        Nothing moves, or the roles have no time in common.
    """

    def __init__(self, log: str, joint: str, roles: Mapping[str, LongRole | float], origin: int) -> None:
        self.joint, self.roles, self.origin = joint, roles, origin
        self.moving = {name: role for name, role in roles.items() if isinstance(role, LongRole)}
        if not self.moving:
            raise BindingError(f"joint '{joint}': every role is a constant; there is nothing to estimate from")
        self.period = min(role.period for role in self.moving.values())
        if self.period <= 0:
            raise BindingError(f"{log}: the time stamps of joint '{joint}' do not advance")
        self.segments = common_segments(log, joint, (role.stretches() for role in self.moving.values()))
        self.turns: dict[str, SameTurn] = {}

    def blocks(self) -> Iterator[tuple[Stamps, dict[str, Array], Flags]]:
        """Yield stamps, roles and where runs begin, in order; findings are complete at the end."""
        ahead = {name: _Ahead(role) for name, role in self.moving.items()}
        wrapped = [name for name, role in self.moving.items() if role.wrapped]
        self.turns = {name: SameTurn() for name in turnable(self.roles, wrapped)}
        silence = 0
        for stamps, begins in self._grid():
            roles: dict[str, Array] = {}
            for name, role in self.roles.items():
                roles[name] = (
                    on_grid(ahead[name].around(int(stamps[0]), int(stamps[-1])), stamps)
                    if isinstance(role, LongRole)
                    else np.full(stamps.size, role)
                )
            starts, silence = after_long_silence(roles, silence)
            starts[0] |= begins
            for name, state in self.turns.items():
                roles[name] = turned_on(roles["link_position"], roles[name], starts, state)
            yield stamps, roles, starts
        for one in ahead.values():
            one.finish()

    def findings(self) -> tuple[Finding, ...]:
        """Return what a person should know of how the signals came about."""
        tallies = {name: role.tally for name, role in self.moving.items()}
        turned = [name for name, state in self.turns.items() if state.ever]
        return (
            *binding_findings(self.joint, self.segments, tallies, self.origin),
            *turned_findings(self.joint, turned),
        )

    def _grid(self) -> Iterator[tuple[Stamps, bool]]:
        """Yield the grid's stamps, as `grid_of` makes them, piece by piece, and whether a segment begins with them."""
        fastest = min(self.moving.values(), key=lambda role: role.period)
        for segment, even in zip(self.segments, fastest.even(self.segments, self.period), strict=True):
            first, last = fastest.rows(segment) if even else (0, (segment[1] - segment[0]) // self.period + 1)
            for begin in range(first, last, PART):
                end = min(begin + PART, last)
                stamps = (
                    fastest.channel.stamps[begin:end] + fastest.shift
                    if even
                    else segment[0] + self.period * np.arange(begin, end, dtype=np.int64)
                )
                yield stamps, begin == first


def bind_long(
    recordings: Sequence[LongRecording],
    name: str,
    joint: Joint,
    roles: Collection[str],
    setpoints: Sequence[float | None] = (),
    *,
    neighbours: Neighbours = MappingProxyType({}),
) -> LongSignals:
    """Bind the roles of a joint to one or more long recordings; parameters and errors as for `vsalog.binding.joint.bind`."""
    offered = offered_roles(joint)
    wanted = [*roles, *(f"{other}/{role}" for other, (_, its) in neighbours.items() for role in its)]
    out = LongSignals(name, wanted)
    findings: list[Finding] = []
    names: list[str] = []
    runs: list[_LongRun] = []
    for recording, run, fixed, run_name in each_run(recordings, joint, setpoints):
        found = {
            named: _role(recording, run, role, its, constant)
            for named, role, its, constant in roles_of_all(joint, roles, neighbours, fixed)
        }
        channels = channels_of(recording.look, run, roles_of_all(joint, roles, neighbours, fixed))
        findings += clock_findings(recording.look, name, channels)
        one = _LongRun(recording.path.name, name, found, origin_of(recording.look))
        out.begin_run(one.origin)
        for stamps, values, starts in one.blocks():
            out.append(stamps, less_series(recording.path.name, values, offered, wanted), starts)
        motors = {role: motor_of(joint, role) for role in found if is_motor_torque(role)}
        findings += [*one.findings(), *acting_findings(name, motors)]
        names.append(run_name)
        runs.append(one)
    periods = [run.period * 1e-9 for run in runs]
    refuse_other_rates(name, periods)
    out.period, out.run_names, out.findings = periods[0], tuple(names), tuple(findings)
    out.resolution = least_steps([{n: role.resolution for n, role in run.moving.items()} for run in runs], wanted)
    return out


def _role(recording: LongRecording, run: Run, role: str, joint: Joint, fixed: float | None) -> LongRole | float:
    """Return a role of a run, or the constant that it is."""
    signal = offered_roles(joint).get(role, Signal())
    motor = motor_of(joint, role) if is_motor_torque(role) else None
    constant = constant_of(recording.look, run, role, signal, fixed)
    if constant is not None:
        return constant if motor is None else float(made_of(np.array([constant]), motor.reflected)[0])
    source = source_of(recording.look, run, role, signal, joint)
    return LongRole(source, recording.columns[source.channel], recording.look.channels[source.channel], motor)
