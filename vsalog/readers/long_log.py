"""Blocks → a recording in memory, or one in a temporary file where it would be too large."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.core.spool import Column, Spool, SpooledColumn, Values, parts
from vsalog.readers.bad_stamps import FEW, REACH, are_few, bad_stamps, looked_at
from vsalog.readers.base import Reader
from vsalog.readers.collect import Placed, assembled, gather, recording_of, summary
from vsalog.readers.gathered import Gathered
from vsalog.readers.long_recording import STRETCHES, LongChannel, LongRecording
from vsalog.readers.table_stamps import stamps_that_are_none
from vsalog.readers.timing import (
    MANY_BAD,
    STANDING,
    Clock,
    HeaderStamps,
    Order,
    choose_source,
    delay_of,
    put_in_order,
    running_clocks,
)

# So many samples of a stream may wait for others that are late before the log is sorted in memory.
MOST_WAITING = 2**22
# Samples of a stretch that tells how much later the log's time is than the header's.
DELAY_ROWS = 4096

_NONE = np.empty(0, np.int64)


class _TooLateError(Exception):
    """Samples are so much out of order that most of a stream would have to wait for them; `finding` tells which."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(finding)
        self.finding = finding


def collect_within(
    path: Path, reader: Reader, wanted: Collection[str] | None, time: str, room: int
) -> Recording | LongRecording:
    """Read a log's blocks into a recording, a long one where its samples take more than `room` bytes.

    Parameters and errors as for `vsalog.readers.collect.gather` and `vsalog.readers.collect.collect`.
    """
    gathered, spool = gather(path, reader, wanted, room)
    if spool is None:
        return recording_of(path, reader, gathered, time)
    try:
        return _long(path, reader, gathered, spool, time)
    except _TooLateError as late:
        recording = recording_of(path, reader, gathered, time)
        return replace(recording, findings=(*recording.findings, late.finding))


def _long(path: Path, reader: Reader, gathered: Mapping[str, Gathered], spool: Spool, time: str) -> LongRecording:
    clocks = {name: _clock(one, time, spool) for name, one in gathered.items()}
    disorder = {name: _Disorder.of(stamps) for name, (_, stamps, _) in clocks.items()}
    for name, found in disorder.items():
        found.refuse(name)

    def placed(name: str, one: Gathered) -> Placed:
        clock, recorded, bad = clocks[name]
        columns = {column: _without(bad, one.take_column(column), spool) for column in list(one.columns)}
        stamps, columns, order = disorder[name].put_right(recorded, columns, spool)
        return Placed(summary(name, one.type, len(stamps), clock, order), stamps, columns, bad.size)

    outline, samples = assembled(path, reader, gathered, placed)
    return LongRecording.of(outline, {name: LongChannel(*columns) for name, columns in samples.items()})


def _clock(one: Gathered, time: str, spool: Spool) -> tuple[Clock, Column, Values]:
    """Choose the clock of a stream; what a `Clock` says of it, without stamps, its stamps, and the rows that are left out."""
    known = one.joined_clocks()
    clocks = running_clocks(known, time)
    if len(clocks) < len(known):
        clock, stamps = _chosen(clocks, one.timeless, time)
        return replace(clock, reason=STANDING), stamps, _NONE
    if looked_at(clocks, time):
        bad = _bad_rows(clocks["header"], clocks["log"])
        doubt = MANY_BAD if bad.size else None
        if are_few(bad.size, one.count):
            clock, stamps = _chosen({kind: _without(bad, c, spool) for kind, c in clocks.items()}, one.timeless, time)
            if clock.source == "header":
                return clock, stamps, bad
            doubt = clock.reason
        return *_chosen(clocks, one.timeless, time, doubt), _NONE
    if "column" in clocks and (bad := stamps_that_are_none(clocks["column"])).size:
        return *_chosen({kind: _without(bad, c, spool) for kind, c in clocks.items()}, one.timeless, time), bad
    return *_chosen(clocks, one.timeless, time), _NONE


def _bad_rows(header: Column, log: Column) -> Values:
    """Return the rows whose header stamp is none, no more than are needed to see that they are not few."""
    found, count = [_NONE], 0
    for first, last in parts(len(header)):
        if FEW * count > len(header):
            break
        # With the rows beside them that those at the ends are held against.
        begin, end = max(0, first - REACH), min(len(header), last + REACH)
        bad = bad_stamps(header[begin:end], log[begin:end])[first - begin : last - begin]
        found.append(np.flatnonzero(bad) + first)
        count += found[-1].size
    return np.concatenate(found)


def _without(rows: Values, column: Column, spool: Spool) -> Column:
    """Return a column without some rows, given in order."""
    if not rows.size:
        return column
    out = SpooledColumn(spool, column[:1].dtype.type)
    for first, last in parts(len(column)):
        own = rows[slice(*np.searchsorted(rows, (first, last)))]
        out.add(len(out), np.delete(column[first:last], own - first))
    return out


def _chosen(
    clocks: Mapping[str, Column], timeless: Finding | None, time: str, otherwise: Finding | None = None
) -> tuple[Clock, Column]:
    count = len(next(iter(clocks.values())))

    def doubt() -> Finding | None:
        seen = HeaderStamps()
        for first, last in parts(count):
            seen.add(clocks["header"][first:last], clocks["log"][first:last])
        return seen.doubt() or otherwise

    source, reason = choose_source(clocks, time, doubt)
    begins = np.unique(np.linspace(0, max(0, count - DELAY_ROWS), STRETCHES).astype(np.int64)).tolist()
    some = {k: np.concatenate([stamps[i : i + DELAY_ROWS] for i in begins]) for k, stamps in clocks.items()}
    if source == "none":
        reason = timeless
    return Clock(source, np.empty(0, np.int64), reason, *delay_of(some, source)), clocks[source]


class _Disorder:
    """How far a stream's stamps are from strictly increasing.

    Attributes
    ----------
    inversions : samples earlier than one before them
    late : how much a sample is earlier than the latest one before it, at most [ns]
    waiting : so many samples are at most less than `late` apart
    increasing : no stamp comes twice or out of order
    """

    def __init__(self) -> None:
        self.inversions, self.late, self.waiting, self.increasing = 0, 0, 0, True

    @classmethod
    def of(cls, stamps: Column) -> _Disorder:
        """Go through a stream's stamps."""
        found = cls()
        latest: int | None = None
        before: int | None = None
        for first, last in parts(len(stamps)):
            now = stamps[first:last]
            steps = np.diff(now, prepend=now[0] - 1 if before is None else before)
            found.increasing = found.increasing and bool(steps.min() > 0)
            so_far = np.maximum.accumulate(now if latest is None else np.maximum(now, latest))
            found.inversions += int(np.count_nonzero(now < so_far))
            found.late = max(found.late, int((so_far - now).max()))
            latest, before = int(so_far[-1]), int(now[-1])
        if found.late:
            found.waiting = found._most_waiting(stamps)
        return found

    def _most_waiting(self, stamps: Column) -> int:
        """Return how many samples have to be kept at most, until none can come that belongs before them."""
        most = 0
        waiting = np.empty(0, np.int64)
        for first, last in parts(len(stamps)):
            waiting = np.concatenate((waiting, stamps[first:last]))
            most = max(most, waiting.size)
            if most > MOST_WAITING:
                break
            waiting = waiting[waiting >= waiting.max() - self.late]
        return most

    def refuse(self, name: str) -> None:
        """Refuse a stream that would have to wait for too long."""
        if self.waiting > MOST_WAITING:
            late = self.late * 1e-9
            raise _TooLateError(Finding(code="recording.held_in_memory", part=name, value=late, unit="s"))

    def put_right(
        self, stamps: Column, columns: dict[str, Column], spool: Spool
    ) -> tuple[Column, dict[str, Column], Order]:
        """Return stamps and columns in order and without copies, and what was done; see `put_in_order`."""
        if self.increasing or not columns:
            return stamps, columns, Order(None, self.inversions, 0, 0)
        sorted_stamps = SpooledColumn(spool, np.int64)
        sorted_columns = {name: SpooledColumn(spool, np.float64) for name in columns}
        duplicates = conflicts = 0
        waiting = _Rows(np.empty(0, np.int64), {name: np.empty(0) for name in columns})
        for first, last in (*parts(len(stamps)), (len(stamps), len(stamps))):
            waiting = waiting.joined(stamps[first:last], {name: c[first:last] for name, c in columns.items()})
            # Nothing that is still to come is earlier than this.
            sure = waiting.stamps < waiting.stamps.max() - self.late
            if first == len(stamps):
                sure[:] = True
            done, waiting = waiting.chosen(sure), waiting.chosen(~sure)
            if not done.stamps.size:
                continue
            order = put_in_order(done.stamps, list(done.columns.values()))
            sorted_stamps.add(len(sorted_stamps), order.kept(done.stamps))
            for name, column in sorted_columns.items():
                column.add(len(column), order.kept(done.columns[name]))
            duplicates, conflicts = duplicates + order.duplicates, conflicts + order.conflicts
        return sorted_stamps, {**sorted_columns}, Order(None, self.inversions, duplicates, conflicts)


class _Rows:
    """Samples of a stream that wait for others, in the order of the log."""

    def __init__(self, stamps: Values, columns: dict[str, Values]) -> None:
        self.stamps, self.columns = stamps, columns

    def joined(self, stamps: Values, columns: dict[str, Values]) -> _Rows:
        """Return these and those that follow them."""
        return _Rows(
            np.concatenate((self.stamps, stamps)),
            {name: np.concatenate((self.columns[name], values)) for name, values in columns.items()},
        )

    def chosen(self, which: Values) -> _Rows:
        """Return some of them."""
        return _Rows(self.stamps[which], {name: values[which] for name, values in self.columns.items()})
