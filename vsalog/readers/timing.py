"""Which clock a stream is on."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from vsalog.core.column import Column, is_mapped, parts
from vsalog.core.finding import Finding
from vsalog.core.look import joined, stretches
from vsalog.core.recording import Stamps
from vsalog.core.resolution import STRETCHES
from vsalog.readers.bad_stamps import MOST_BAD_STAMPS, are_few, bad_rows, looked_at
from vsalog.readers.base import CLOCKS
from vsalog.readers.clock_steps import ClockSteps
from vsalog.readers.limits import BLOCK_ROWS
from vsalog.readers.reach import Nanoseconds, Stamp
from vsalog.readers.table_stamps import stamps_that_are_none

STANDING = Finding(code="clock.log_stands")
"""Why a stream is on another clock than the log's, which stands still."""

MANY_BAD = Finding(code="clock.many_stamps_far", limit=round(1 / MOST_BAD_STAMPS))

Number = TypeVar("Number", np.int64, np.float64)

_NONE = np.empty(0, np.int64)


@dataclass(frozen=True, slots=True)
class Clock:
    """The time stamps a stream is put on.

    Attributes
    ----------
    source : str
        One of `vsalog.readers.base.CLOCKS`.
    stamps : int64 array, shape (n,)
        Nanoseconds, in the order of the log.
    reason : Finding or None
        Why not the first choice, or what to doubt of it where it was asked for.
    delay_median, delay_spread : float
        Log time minus header stamp [s]: median and 5–95 % range; NaN where there is one clock only.
    bad : int64 array
        The log's samples that have a stamp that is none and are left out, in order.
    """

    source: str
    stamps: Stamps
    reason: Finding | None
    delay_median: float
    delay_spread: float
    bad: Stamps = field(default_factory=lambda: _NONE)


def choose_clock(clocks: Mapping[str, Stamps], time: str) -> Clock:
    """Choose the clock of a stream, for all of its samples but those few whose stamp is none.

    Parameters
    ----------
    clocks : mapping of str to int64 array, shape (n,)
        The stamps [ns] the log has, by kind.
    time : str
        ``auto`` for the header's stamps unless they make no sense, or the kind that is asked for: ``header``, ``log``,
        ``publish``.
    """
    running = running_clocks(clocks, time)
    if len(running) < len(clocks):
        return replace(_chosen(running, time), reason=STANDING)
    if looked_at(clocks, time):
        bad = bad_rows(clocks["header"], clocks["log"])
        if not are_few(bad.size, len(clocks["log"])):
            return _chosen(clocks, time, MANY_BAD if bad.size else None)
        clock = _chosen({kind: without(bad, stamps) for kind, stamps in clocks.items()}, time)
        return replace(clock, bad=bad) if clock.source == "header" else _chosen(clocks, time, clock.reason)
    if "column" in clocks and (bad := stamps_that_are_none(clocks["column"])).size:
        return replace(_chosen({kind: without(bad, stamps) for kind, stamps in clocks.items()}, time), bad=bad)
    return _chosen(clocks, time)


def without(rows: Stamps, column: NDArray[Number]) -> NDArray[Number]:
    """Return a column without some rows, given in order."""
    if not rows.size:
        return column
    out = Column(column.dtype.type, len(column) - rows.size, in_file=is_mapped(column))
    for first, last in parts(column):
        own = rows[slice(*np.searchsorted(rows, (first, last)))]
        out.append(np.delete(column[first:last], own - first))
    return out.whole(len(out))


def running_clocks(clocks: Mapping[str, Stamps], time: str) -> dict[str, Stamps]:
    """Return the clocks of a stream; where the log's stands still and is not asked for, those that go on, if any does."""
    if time not in ("auto", "header") or "log" not in clocks or not _stands(clocks["log"]):
        return dict(clocks)
    return {kind: stamps for kind, stamps in clocks.items() if not _stands(stamps)} or dict(clocks)


def _stands(stamps: Stamps) -> bool:
    """Tell whether all stamps of a stream are the same."""
    return len(stamps) > 2 and all(bool((stamps[a:b] == stamps[0]).all()) for a, b in parts(stamps))


def _chosen(clocks: Mapping[str, Stamps], time: str, otherwise: Finding | None = None) -> Clock:
    """Choose a clock for all samples; `otherwise` is the doubt that there is where the stamps show none by themselves."""
    source, reason = choose_source(clocks, time, lambda: implausible(clocks["header"], clocks["log"]) or otherwise)
    median, spread = delay_of(clocks, source)
    return Clock(source, clocks[source], reason, median, spread)


def choose_source(kinds: Collection[str], time: str, doubt: Callable[[], Finding | None]) -> tuple[str, Finding | None]:
    """Choose a kind of clock, and tell why it is not the first choice, or what to doubt of it where it was asked for.

    Parameters
    ----------
    kinds : collection of str
        The clocks the stream has.
    time : str
        As for `choose_clock`.
    doubt : callable
        Tells why header stamps cannot be the time of their samples; asked only where that matters.
    """
    available = [kind for kind in CLOCKS if kind in kinds]
    source, reason = available[0], None
    if time == "auto":
        if source == "header" and "log" in kinds:
            reason = doubt()
            source = "log" if reason else "header"
    elif time in kinds:
        source = time
        reason = doubt() if time == "header" and "log" in kinds else None
    elif source in ("header", "log", "publish"):
        source = "log" if "log" in kinds else source
        reason = Finding(code="clock.not_recorded", evidence={"asked": time})
    return source, reason


def of_stream(reason: Finding | None, stream: str, source: str) -> Finding | None:
    """Return why a stream is on a clock, with its name and the kind of the clock."""
    if reason is None or source == "none":
        return reason
    return structs.replace(reason, part=stream, evidence={**reason.evidence, "used": source})


def implausible(header: Stamps, log: Stamps) -> Finding | None:
    """Return why header stamps cannot be the time of their samples, None where they can.

    Parameters
    ----------
    header, log : int64 array, shape (n,)
        Header stamps and log times [ns].
    """
    seen = HeaderStamps()
    for first, last in parts(header, log):
        seen.add(header[first:last], log[first:last])
    return seen.doubt()


@dataclass(slots=True)
class HeaderStamps:
    """What there is to say of a stream's header stamps beside the log's times, gathered block by block."""

    count: int = 0
    zero: int = 0
    first: tuple[int, int] = (0, 0)
    all_same: bool = True
    log_same: bool = True
    far: tuple[int, int] | None = None
    distant: int = 0
    steps: ClockSteps = field(default_factory=ClockSteps)

    def add(self, header: Stamps, log: Stamps) -> None:
        """Take a block of header stamps and log times [ns], shape (n,), into account."""
        if not len(header):
            return
        if not self.count:
            self.first = int(header[0]), int(log[0])
        self.count += len(header)
        self.zero += int(np.count_nonzero(header == 0))
        self.all_same = self.all_same and bool(np.all(header == self.first[0]))
        self.log_same = self.log_same and bool(np.all(log == self.first[1]))
        far = np.abs(header - log) > Nanoseconds.DAY
        self.distant += int(np.count_nonzero(far))
        self.steps.add(header, log)
        if self.far is None and far.any():
            worst = int(np.argmax(far))
            self.far = int(header[worst]), int(log[worst])

    def doubt(self) -> Finding | None:
        """Return why the stamps cannot be the time of their samples, None where they can."""
        if self.far is None:
            if self.count > 2 and self.all_same and not self.log_same:
                return Finding(code="clock.stamps_all_same")
            return self._stepped()
        if self.zero:
            return Finding(code="clock.stamps_zero", value=self.zero, evidence={"stamps": self.count})
        if self.distant == self.count and self.far[0] < Stamp.YEAR_2000 <= self.far[1]:
            return Finding(code="clock.stamps_before_2000")
        return Finding(code="clock.stamps_far", value=self.distant, evidence={"stamps": self.count})

    def _stepped(self) -> Finding | None:
        self.steps.end()
        for way, size in ("back", self.steps.back), ("ahead", self.steps.ahead):
            if size:
                return Finding(code="clock.stamps_step", value=size * 1e-9, unit="s", evidence={"way": way})
        return None


def delay_of(clocks: Mapping[str, Stamps], source: str) -> tuple[float, float]:
    """Return log time minus header stamp [s], median and 5-95 % range; NaN where the stream is not on header stamps."""
    if source != "header" or "log" not in clocks or not len(clocks["log"]):
        return float("nan"), float("nan")
    header, log = clocks["header"], clocks["log"]
    if is_mapped(log):
        some = stretches(len(log), STRETCHES * BLOCK_ROWS)
        header, log = joined(header, some), joined(log, some)
    delay = (log - header) * 1e-9
    low, median, high = np.percentile(delay, (5, 50, 95))
    return float(median), float(high - low)
