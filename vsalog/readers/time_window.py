"""The requested part of a log: from one moment to another."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.column import is_mapped
from vsalog.core.errors import ReadError, UnitError
from vsalog.core.recording import Channel, Recording, Stamps, Stream
from vsalog.core.units import parse_quantity, shown
from vsalog.readers.base import Reader
from vsalog.readers.reach import Stamp, within_reach
from vsalog.readers.stream_clock import choose_clock
from vsalog.readers.tables.time_columns import nanoseconds
from vsalog.readers.tables.time_units import epoch_unit

HOW = (
    "give seconds from the log's beginning, a number with a unit such as '2 min', a date such as 2026-01-31T12:00:05.5Z,"
    " or a time since the epoch"
)

NO_SAMPLE = "no sample is between the given start and end"


@dataclass(frozen=True, slots=True)
class Moment:
    """A point of time.

    Attributes
    ----------
    time : int
        Nanoseconds since the epoch, or since the log's beginning.
    dated : bool
        It is since the epoch.
    """

    time: int
    dated: bool

    @classmethod
    def parse(cls, value: str | float, name: str) -> Moment:
        """Read a moment as people write it.

        Parameters
        ----------
        value : str or float
            Seconds, a number with a unit, an ISO 8601 date (UTC where it has no zone), or a number that can only be a time since
            the epoch: in seconds, or in ms, us or ns by its size.
        name : str
            Its name in messages.

        Raises
        ------
        ReadError
            It is none of these.
        """
        text, scale = str(value).strip(), None
        try:
            number = Decimal(text)
        except InvalidOperation:
            if (stamp := _dated(text)) is not None:
                return cls(stamp, True)
            number = _with_unit(text, name)
        else:
            scale = epoch_unit(abs(float(number))) if number.is_finite() else None
        digits = {"s": 9, "ms": 6, "us": 3, "ns": 0}[scale or "s"]
        if not number.is_finite() or not 0 <= number <= Stamp.FARTHEST // 10**digits:
            raise ReadError(f"{name} '{shown(text)}' is no time within any log: {HOW}")
        return cls(int((number * 10**digits).to_integral_value()), scale is not None)


@dataclass(frozen=True, slots=True)
class Window:
    """From a moment to another, both included; None is the log's own beginning or end."""

    start: Moment | None
    end: Moment | None

    @classmethod
    def parse(cls, start: str | float | None, end: str | float | None) -> Window:
        """Return the window between two moments as people write them.

        Raises
        ------
        ReadError
            A moment cannot be read, or the end is not after the start.
        """
        first = None if start is None else Moment.parse(start, "start")
        last = None if end is None else Moment.parse(end, "end")
        if first and last and first.dated == last.dated and last.time <= first.time:
            raise ReadError(f"the end, '{shown(str(end))}', is not after the start, '{shown(str(start))}'")
        return cls(first, last)

    def bounds(self, reader: Reader, path: Path, time: str) -> tuple[int, int]:
        """Return the first and the last stamp that are in the window [ns], on the log's clock.

        Parameters
        ----------
        reader : Reader
            The log, opened for this: its first samples are read.
        path : Path
            Of the log, for messages.
        time : str
            Which clock; see `vsalog.readers.read`.

        Raises
        ------
        ReadError
            The log has no time, or dates are requested and it has none.
        """
        moments = [moment for moment in (self.start, self.end) if moment is not None]
        begin = _beginning(reader, time)
        if begin is None:
            raise ReadError(
                "has no time, so there is no start and no end in it; give the sample rate with --rate", path
            )
        if begin < Stamp.YEAR_2000 and any(moment.dated for moment in moments):
            raise ReadError("its times are no dates; give start and end in seconds from its beginning", path)
        low, high = (
            None if moment is None else moment.time + (0 if moment.dated else begin)
            for moment in (self.start, self.end)
        )
        if low is not None and high is not None and high <= low:
            raise ReadError(f"the end, {stamp_text(high)}, is not after the start, {stamp_text(low)}", path)
        return -Stamp.FARTHEST if low is None else low, Stamp.FARTHEST if high is None else high


def cut(recording: Recording, low: int, high: int, known: Collection[str] = ()) -> Recording:
    """Return the part of a recording from one stamp to another [ns], both included.

    Channels without a sample there, or without a time, are listed as unread, and so are those of `known`, which the log has
    elsewhere.

    Raises
    ------
    ReadError
        There is no sample.
    """
    channels: dict[str, Channel] = {}
    unread = dict(recording.unread)
    streams: dict[str, Stream] = {}
    shared: dict[int, Stamps] = {}  # channels of a stream share their stamps, before and after
    for name, channel in recording.channels.items():
        stream = recording.streams[channel.stream]
        first, last = np.searchsorted(channel.stamps, (low, high + 1))
        if stream.time_source == "none":
            unread[name] = "it has no time, so that start and end do not apply to it"
        elif first == last:
            unread[name] = NO_SAMPLE
        else:
            stamps = shared.setdefault(id(channel.stamps), _alone(channel.stamps[first:last]))
            channels[name] = replace(channel, stamps=stamps, values=_alone(channel.values[first:last]))
            streams[channel.stream] = replace(stream, count=int(last - first))
    unread |= {name: NO_SAMPLE for name in known if name not in channels}
    if (recording.channels or known) and not channels:
        raise ReadError(_nothing(recording, low, high), recording.path)
    return replace(recording, channels=channels, streams=streams, unread=unread)


def _alone(part: NDArray[Any]) -> NDArray[Any]:
    """Return a part of an array that does not keep all of it in memory."""
    return part if is_mapped(part) else part.copy()


def _nothing(recording: Recording, low: int, high: int) -> str:
    """Return the requested times and those of the samples, in words."""
    stamps = [c.stamps for c in recording.channels.values() if c.stamps.size]
    first, last = min((int(s[0]) for s in stamps), default=0), max((int(s[-1]) for s in stamps), default=0)
    there = f"; its samples are from {stamp_text(first)} to {stamp_text(last)}"
    since = f" from {stamp_text(low)}" if low > -Stamp.FARTHEST else ""
    until = f" to {stamp_text(high)}" if high < Stamp.FARTHEST else ""
    return f"has no sample{since}{until}{there if stamps else ''}"


def stamp_text(stamp: int) -> str:
    """Write a stamp in words: a date, or seconds where it cannot be one."""
    if stamp < Stamp.YEAR_2000:
        return f"{stamp / 1e9:g} s"
    return str(np.datetime_as_string(np.datetime64(stamp, "ns"), unit="us", timezone="UTC"))


def _beginning(reader: Reader, time: str) -> int | None:
    """Return the earliest stamp of any stream's first samples; None where none has a time."""
    stamps: list[int] = []
    for block in reader.heads():
        clocks = within_reach(block)[0].clocks
        clock = choose_clock(clocks, time)
        placed = np.delete(clocks[clock.source], clock.off)
        stamps += [int(placed.min())] if clock.source != "none" and placed.size else []
    return min(stamps, default=None)


def _dated(text: str) -> int | None:
    """Return the stamp [ns] of a date of ISO 8601; None where it is none."""
    if not text.isprintable():
        return None
    stamps, good = nanoseconds([pa.array([text], pa.string())], "date")
    return int(stamps[0]) if good[0] else None


def _with_unit(text: str, name: str) -> Decimal:
    """Return a time [s] with a unit."""
    try:
        return Decimal(repr(parse_quantity(text, "s")))
    except UnitError as error:
        raise ReadError(f"{name} '{shown(text)}' is no time: {HOW} ({error})") from error
