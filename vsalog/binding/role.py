"""A role of a joint whose samples are read in order, part by part.

Properties of a whole signal (its period, its usual values) are taken from the part of it that was read first; gaps, an encoder's
range and outliers are those of all samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.drive_model import acting_torque, shift_of
from vsalog.binding.findings import Tally
from vsalog.binding.grid import LONGEST_GAP, Bound, is_even, less, stamps_where
from vsalog.binding.role_source import Source
from vsalog.binding.zero_order_hold import LONGEST_HOLD, held
from vsalog.core.column import parts
from vsalog.core.look import stretches
from vsalog.core.recording import Channel
from vsalog.core.resolution import ENOUGH, LONGEST_OUTLIER, coarser, resolution_of
from vsalog.filters.outliers import Outliers
from vsalog.filters.unwrapping import WRAP_JUMP, Unwrapping, unwrapped_on, wraps_around
from vsalog.rig.schema import Motor

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]
Segments = list[tuple[int, int]]


class Role:
    """A role of one run.

    Parameters
    ----------
    source : where the role comes from
    channel : its samples
    seen : the part of them that was read first
    motor : whose torque the role is, where the torque on the rotor is wanted
    """

    def __init__(self, source: Source, channel: Channel, seen: Channel, motor: Motor | None) -> None:
        self.source, self.channel, self.motor = source, channel, motor
        self.period = int(np.median(np.diff(seen.stamps)))
        self.shift = source.shift + (0 if motor is None else shift_of(motor))
        whole = seen.values.size == channel.values.size
        self.outliers = Outliers(seen.values, source.turn, whole=whole) if source.may_stand_alone else None
        self.unwraps = self._unwraps()
        self.wrapped = self.unwraps and source.joint_turn
        self.tally = Tally()
        self._kept: list[tuple[Stamps, Array]] = []

    def parts(self) -> Iterator[Bound]:
        """Yield the role's samples, in SI; at the end the tally is complete, and `look` can be called."""
        source, state, at = self.source.for_parts(), Unwrapping(), 0
        wanted = stretches(len(self.channel.values), ENOUGH)
        for stamps, values, alone, stuck in self._recorded():
            if self.unwraps:
                assert self.source.turn is not None
                values, state = unwrapped_on(values, self.source.turn, state)
            for first, last in wanted:
                here = slice(max(0, first - at), max(0, last - at))
                if values[here].size:
                    self._kept.append((stamps[here], values[here]))
            at += values.size
            bound = self._bound(source, stamps, values)
            bound = replace(bound, alone=stamps_where(bound, alone), held=stamps_where(bound, stuck))
            self.tally.add(bound)
            yield bound

    def look(self) -> Bound:
        """Return stretches of the role's samples, spread evenly, for its noise and its sensor's least step; once."""
        stamps, values = (np.concatenate(kept) for kept in zip(*self._kept, strict=True))
        self._kept.clear()
        look = self._bound(self.source, stamps, values)
        step = look.resolution
        return replace(look, resolution=resolution_of(look.values) if step is None else coarser(step, look.values))

    def stretches(self) -> Segments:
        """Return the stretches of time, first and last stamp, in which the role has samples without a gap."""
        found: Segments = []
        first = last = int(self.channel.stamps[0]) + self.shift
        count = 0
        for begin, end in parts(self.channel.stamps):
            stamps = self.channel.stamps[begin:end] + self.shift
            at = 0
            for gap in np.flatnonzero(np.diff(stamps, prepend=last) > LONGEST_GAP * self.period).tolist():
                if count + gap - at > 1:
                    found.append((first, last if gap == 0 else int(stamps[gap - 1])))
                first, at, count = int(stamps[gap]), gap, 0
            count += stamps.size - at
            last = int(stamps[-1])
        return [*found, (first, last)] if count > 1 else found

    def even(self, segments: Segments, period: int) -> list[bool]:
        """Return for each segment whether the role's own stamps there are a grid of that period [ns]."""
        firsts, lasts = np.array(segments, dtype=np.int64).T
        least = np.full(len(segments), np.iinfo(np.int64).max)
        greatest = np.full(len(segments), -1)
        before = np.empty(0, np.int64)
        for begin, end in parts(self.channel.stamps):
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
        first, last = np.searchsorted(self.channel.stamps, (segment[0] - self.shift, segment[1] + 1 - self.shift))
        return int(first), int(last)

    def _bound(self, source: Source, stamps: Stamps, values: Array) -> Bound:
        bound = source.bound(stamps, values, self.period)
        return bound if self.motor is None else acting_torque(bound, self.motor)

    def _recorded(self) -> Iterator[tuple[Stamps, Array, Flags | None, Flags | None]]:
        """Yield stamps, values as recorded without outliers and held ones, and where these are."""
        for first, last in parts(self.channel.stamps, self.channel.values):
            if self.outliers is None:
                yield self.channel.stamps[first:last], self.channel.values[first:last], None, None
                continue
            # A hold, and twice as much around it, on either side of a part; an outlier at its ends is in the next part.
            begin, end = max(0, first - 4 * LONGEST_HOLD), min(last + 4 * LONGEST_HOLD, len(self.channel.values))
            stamps, alone = self.channel.stamps[begin:end], self.outliers.among(self.channel.values[begin:end])
            values = less(self.channel.values[begin:end], alone)
            stuck = held(stamps, values, self.period, self.source.turn)
            here = slice(first - begin, last - begin)
            alone, stuck = (None if flags is None else flags[here] for flags in (alone, stuck))
            yield stamps[here], less(values[here], stuck), alone, stuck

    def _unwraps(self) -> bool:
        """Return whether the role is an encoder that wraps after a turn: it jumps, and stays within one."""
        turn = self.source.turn
        if turn is None:
            return False
        values = (self.channel.values[first:last] for first, last in parts(self.channel.values))
        # Where samples are left out a jump may be cut in as many pieces, and one more.
        if _span_and_jump(values)[1] * (LONGEST_OUTLIER + 1) <= WRAP_JUMP * turn:
            return False
        span, jump = _span_and_jump(values for _, values, *_ in self._recorded())
        return jump > WRAP_JUMP * turn and wraps_around(span, turn)


def _span_and_jump(parts_of: Iterable[Array]) -> tuple[float, float]:
    """Return the range of a signal's numbers, and the greatest step from one to the next."""
    low, high, jump, before = np.inf, -np.inf, 0.0, np.empty(0)
    for values in parts_of:
        known = np.concatenate((before, values[np.isfinite(values)]))
        if known.size:
            low, high = min(low, float(known.min())), max(high, float(known.max()))
            jump = max(jump, float(np.abs(np.diff(known)).max(initial=0.0)))
            before = known[-1:]
    return high - low, jump


class Ahead:
    """The samples of a role around the rows that are wanted next.

    Parameters
    ----------
    role : its parts are gone through
    """

    def __init__(self, role: Role) -> None:
        self._parts = role.parts()
        # Samples that reach across what is bridged, and the next on either side.
        self._bridge = 2 * math.ceil(LONGEST_GAP) + 1
        self._held = next(self._parts)

    def around(self, first: int, last: int) -> Bound:
        """Return the samples from some before a stamp to some that are not before another."""
        ours = self._held
        # What is missing at either end is bridged from beyond.
        while ours.stamps[-self._bridge :][0] < last and (part := next(self._parts, None)) is not None:
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

    def _from(self, ours: Bound, first: int) -> Bound:
        begin = max(0, min(int(np.searchsorted(ours.stamps, first)) - self._bridge, ours.stamps.size - self._bridge))
        return replace(ours, stamps=ours.stamps[begin:], values=ours.values[begin:])
