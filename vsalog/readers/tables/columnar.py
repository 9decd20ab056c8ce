"""Tables of text or of Parquet: the columns of clocks, of keys that name a row's owner, and the streams of the others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.finding import Finding, Findings
from vsalog.core.recording import Stamps, Values
from vsalog.readers.base import Block, Catalogue, ChannelInfo, first_of_each
from vsalog.readers.tables.cells import Cells, split_lists
from vsalog.readers.tables.long_tables import Speakers, find_speakers
from vsalog.readers.tables.row_times import RowTimes, row_clock
from vsalog.readers.tables.sections import find_sections, group_by_blanks
from vsalog.readers.tables.slots import Slots
from vsalog.readers.tables.time_columns import ClockPlan, looks_like_clock, nanoseconds, runs_backwards
from vsalog.readers.tables.time_numbers import floats
from vsalog.readers.tables.time_units import COUNTED, epoch_unit, stated_unit


class Batch(NamedTuple):
    """Rows of a table that follow one another.

    Attributes
    ----------
    row, size : int
        The number of the first one, and how many there are.
    cells : mapping of int to pyarrow array
        Columns, by their numbers.
    expected : int
        How many rows the table has in all, 0 where it is unknown.
    """

    row: int
    size: int
    cells: Mapping[int, pa.Array]
    expected: int = 0

    def of(self, columns: Iterable[int]) -> list[pa.Array]:
        """Return some columns."""
        return [self.cells[i] for i in columns]


class CountedClock(NamedTuple):
    """A clock's name, its unit, and the usual step of its numbers."""

    name: str
    unit: str
    step: float


class ColumnarReader(ABC):
    """Reads a table in any storage format; see `vsalog.readers.base.Reader`.

    A subclass finds names, units and first rows of the columns and calls `_interpret`; `_batches` yields its rows.

    Parameters
    ----------
    path : Path
        The file.
    rate : float or None
        Samples per second [Hz], for a table without a time column.
    units : mapping of str to str
        Units of columns whose headers state none.
    """

    format: str
    rig_text: str | None = None

    def __init__(self, path: Path, rate: float | None, units: Mapping[str, str] = MappingProxyType({})) -> None:
        self.path, self.rate, self._given_units = path, rate, units
        self.findings = Findings()
        self.unread: dict[str, str] = {}
        self._names: Sequence[str] = ()
        self._units: Sequence[str | None] = ()
        self._sample: Sequence[pa.Array] = ()
        self._lists: Mapping[int, Sequence[str]] = {}

    @abstractmethod
    def _batches(self, columns: Sequence[int], required: Collection[int]) -> Iterator[Batch]:
        """Yield the rows of some columns; a row needs all of those that are required.

        Raises
        ------
        ReadError
            The table is damaged.
        """

    @abstractmethod
    def _whole(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        """Yield all of some columns, part by part."""

    @abstractmethod
    def _where(self, row: int) -> str:
        """Return the position of one of the first rows in the file, in words."""

    def _with_given(self, names: Sequence[str], units: Sequence[str | None]) -> list[str | None]:
        """Return the columns' units, those that were given where the file states none."""
        return [unit or self._given_units.get(name) for name, unit in zip(names, units, strict=True)]

    def _interpret(
        self,
        plan: ClockPlan,
        columns: Sequence[int],
        keys: tuple[int, ...] = (),
        streams: Mapping[int, str] | None = None,
    ) -> None:
        """Determine the roles of the columns.

        Parameters
        ----------
        plan : ClockPlan
            Which are the clock.
        columns : sequence of int
            Those of which all but clocks and keys may be channels.
        keys : tuple of int
            Columns that are known to name together the owner of a row's values.
        streams : mapping of int to str, optional
            The stream of each column, where the file states it.
        """
        self._plan = plan
        self._slots = Slots(self._names, self._sample)
        self._long: Finding | None = None
        if keys:
            self._speakers: Speakers | None = Speakers([self._names[i] for i in keys], keys, self._whole(keys))
        else:
            first = self._slots.without_names(self._sample)
            self._speakers, self._long = find_speakers(self._names, first, plan, self._whole)
        taken = self._not_channels()
        own = [i for i in columns if i not in taken]
        self._sections = find_sections(self._names, self._sample, plan, own)
        self._channels = [i for section in self._sections for i in section.columns]
        everywhere, *apart = (section.columns for section in self._sections)
        self._streams = streams or {}
        self._sparse = set(self._streams.values()) if len({*self._streams.values()}) > 1 else set()
        self._apart = 0
        if streams is None:
            groups = group_by_blanks(self._sample, everywhere) if plan.clocks and not keys else [everywhere]
            named = {f"{self.path.stem} ({self._names[group[0]]} …)": group for group in (*groups[1:], *apart)}
            named[self.path.stem] = groups[0]
            self._sparse, self._apart = {*named} - {self.path.stem}, len(groups) - 1
            self._streams = {i: stream for stream, group in named.items() for i in group}

    @property
    def has_clock(self) -> bool:
        """Whether columns contain the time."""
        return bool(self._plan.clocks)

    def first_stamps(self) -> Stamps:
        """Return the times of the first rows [ns], shape (n,); none where there is no clock."""
        clock = self._plan.clocks.get("column")
        if clock is None:
            return np.empty(0, np.int64)
        stamps, good = nanoseconds([self._sample[i] for i in clock.columns], clock.form)
        return stamps[good]

    def clock_by_steps(self) -> CountedClock | None:
        """Return the clock if it counts from some start in a unit guessed from its steps; else None."""
        clock = self._plan.clocks.get("column")
        if clock is None or len(clock.columns) > 1 or clock.form not in COUNTED:
            return None
        (i,) = clock.columns
        cells = self._sample[i]
        if pa.types.is_temporal(cells.type) or stated_unit(self._names[i], self._units[i]) is not None:
            return None
        values = floats(cells)
        values = values[np.isfinite(values)]
        steps = np.diff(np.unique(values))
        if not steps.size or epoch_unit(float(np.median(np.abs(values)))) == clock.form:
            return None
        return CountedClock(self._names[i], clock.form, float(np.median(steps)))

    def catalogue(self) -> Catalogue:
        """Return the columns; those whose first cells are all text are listed as unread."""
        channels: dict[str, ChannelInfo] = {}
        unread = self._no_signals()
        for i in self._channels:
            cells = Cells()
            if i not in self._lists:
                cells.convert(self._sample[i])
            for name in self._named(i):
                if cells.bad and cells.text:
                    unread[name] = cells.text
                    continue
                for part in self._parts:
                    channels[name + part] = ChannelInfo(self._streams[i] + part, self.format, self._units[i])
        return Catalogue(channels, unread)

    def heads(self) -> Iterator[Block]:
        """Yield the first rows."""
        return first_of_each(self.blocks(None))

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield the table's rows, block by block; only the columns that are needed are read.

        Raises
        ------
        ReadError
            The table is damaged.
        """
        self._note()
        texts = self.catalogue().unread if self._speakers else self._no_signals()  # which would be unread for each
        self.unread |= texts
        asked = [i for i in self._channels if self._names[i] not in texts and self._is_wanted(i, wanted)]
        # A sparse stream has a row where any of its columns has a sample, whichever of them are wanted.
        sparse = self._sparse & {self._streams[i] for i in asked}
        taken = {*asked}
        columns = [i for i in self._channels if i in taken or self._streams[i] in sparse]
        counts = {name: Cells() for i in columns for name in self._named(i)}
        times = [RowTimes(section.clocks, self._parts) for section in self._sections]
        needed = {*columns}
        sections = [(clocks, [i for i in own if i in needed]) for clocks, own in self._sections]
        clocks = {i for section in self._sections for clock in section.clocks.values() for i in clock.columns}
        needed |= {*self._not_channels(), *clocks, *self._slots.begin(columns)}
        untimed = 0
        for stored in self._batches(sorted(needed), needed & {*self._not_channels(), *clocks}):
            batch = stored._replace(cells=self._slots.in_place(stored.cells))
            every = np.ones(batch.size, bool)
            parts = self._speakers.rows(batch.of(self._speakers.columns)) if self._speakers else {"": every}
            values = self._values(batch, columns, counts)
            for (own_clocks, own), time in zip(sections, times, strict=True):
                stamps, good = row_clock(batch.row, batch.size, self.rate), every
                if own_clocks:
                    stamps, good = time.of(batch.of, parts)
                    untimed += self._untimed(batch, own_clocks["column"].columns if len(sections) > 1 else (), good)
                if own or len(sections) == 1:
                    for part, theirs in parts.items():
                        for block in self._by_stream(own, part, good & theirs, stamps, values, wanted):
                            yield replace(block, expected=0 if self._speakers else batch.expected)
        if untimed:
            self.findings.append(Finding(code="clock.rows_without_time", part=self.path.stem, value=untimed))
        if self._speakers:
            self.findings.add(*self._speakers.left_out())
        self.findings.add(*self._slots.findings(), *(one for time in times for one in time.findings()))
        for i in asked:
            for name in self._named(i):
                if counts[name].text:
                    self.unread |= dict.fromkeys((name + part for part in self._parts), counts[name].text)
                self.findings.add(*counts[name].findings(name))

    def _values(self, batch: Batch, columns: Sequence[int], counts: Mapping[str, Cells]) -> dict[str, Values]:
        """Return the channels' numbers in a batch by name, those of lists apart."""
        values = {}
        for i in columns:
            cells = batch.cells[i]
            elements = split_lists(cells, len(self._lists[i])) if i in self._lists else [cells]
            for name, one in zip(self._named(i), elements, strict=True):
                values[name] = counts[name].convert(one)
        return values

    def _by_stream(
        self,
        columns: Sequence[int],
        part: str,
        rows: NDArray[np.bool_],
        stamps: Mapping[str, Stamps],
        values: Mapping[str, Values],
        wanted: Collection[str] | None,
    ) -> Iterator[Block]:
        """Yield a block of some rows per stream, the sparse ones without their blank rows; `part` is appended to all names."""
        for stream in dict.fromkeys(self._streams[i] for i in columns) or [self.path.stem]:
            own = {name: i for i in columns if self._streams[i] == stream for name in self._named(i)}
            kept = rows
            if stream in self._sparse:
                kept = rows & ~np.all([np.isnan(values[name]) for name in own], axis=0)
            whole = bool(kept.all())
            asked = {name: name + part for name in own if wanted is None or name + part in wanted}
            units = {full: self._units[own[name]] for name, full in asked.items()}
            yield Block(
                stream + part,
                self.format,
                {kind: times if whole else times[kept] for kind, times in stamps.items()},
                {full: values[name] if whole else values[name][kept] for name, full in asked.items()},
                {full: unit for full, unit in units.items() if unit is not None},
                self._timeless(),
            )

    def _named(self, column: int) -> Sequence[str]:
        """Return the names of a column's channels: its own, or those of the elements of its lists."""
        return self._lists.get(column) or (self._names[column],)

    def _is_wanted(self, column: int, wanted: Collection[str] | None) -> bool:
        names = self._named(column)
        return wanted is None or any(name + part in wanted for name in names for part in self._parts)

    @property
    def _parts(self) -> Collection[str]:
        """The suffix of the names of channels and streams."""
        return self._speakers.parts if self._speakers else ("",)

    def _not_channels(self) -> set[int]:
        """Return the columns of the time and the owner of a row's values."""
        return {*self._plan.columns(), *(self._speakers.columns if self._speakers else ())}

    def _no_signals(self) -> dict[str, str]:
        """Return the columns that are no signal by their type, with the reason."""
        return {}

    def _untimed(self, batch: Batch, column: Sequence[int], good: NDArray[np.bool_]) -> int:
        """Return how many rows have no time, without those at which one of several logs side by side had ended."""
        for cells in batch.of(column):
            good = good | cells.is_null().to_numpy(zero_copy_only=False)
        return int(np.count_nonzero(~good))

    def _timeless(self) -> Finding | None:
        if self._plan.backwards is None:
            return None
        column, row = self._plan.backwards
        return runs_backwards(self._names[column], self._where(row))

    def _note(self) -> None:
        """Record the findings that are known before the rows."""
        self.findings.add(*self._plan.findings)
        if self._long:
            self.findings.add(self._long)
        others = len(self._sections) - 1
        if others:
            self.findings.add(Finding(code="table.several_clocks", value=others + 1))
        if self._apart:
            self.findings.add(Finding(code="table.columns_apart", value=self._apart))
        if self._plan.clocks and self.rate is not None:
            self.findings.add(Finding(code="clock.rate_not_used", value=self.rate, unit="Hz"))
        if self._plan.clocks or self.rate is not None:
            return
        self.findings.add(self._timeless() or Finding(code="clock.missing", part=self.path.stem))
        for i in self._channels:
            if looks_like_clock(Cells().convert(self._sample[i])):
                self.findings.add(Finding(code="clock.perhaps", part=self._names[i]))
                break
