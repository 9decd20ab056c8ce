"""CSV, TSV and other text tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import PIECE_BYTES
from vsalog.core.printable import plural
from vsalog.core.recording import Stamps, Values
from vsalog.readers.base import Block, Catalogue, ChannelInfo, first_of_each
from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.limits import DECODED_BYTES, SAMPLE_ROWS
from vsalog.readers.long_tables import find_speakers
from vsalog.readers.merged_tables import Layers, columns_apart, group_by_blanks, stretches
from vsalog.readers.row_clock import row_clock
from vsalog.readers.row_times import RowTimes
from vsalog.readers.table_cells import Cells, numbers_and_words
from vsalog.readers.table_damage import Damage
from vsalog.readers.table_detection import detect
from vsalog.readers.table_dialect import Dialect
from vsalog.readers.table_rows import Rows
from vsalog.readers.table_sections import find_sections
from vsalog.readers.table_slots import Slots
from vsalog.readers.table_text import NULLS
from vsalog.readers.text_source import BoundedGzip, open_text, read_beginning
from vsalog.readers.time_columns import ClockColumn, ClockPlan, find_clocks, looks_like_clock, runs_backwards
from vsalog.readers.time_names import UNITS
from vsalog.readers.time_steps import row_marks


class TableReader:
    """Reads a text table; see `vsalog.readers.base.Reader`.

    Parameters
    ----------
    path : Path
        The file, plain or compressed with gzip.
    rate : float or None
        Samples per second [Hz], for a table without a time column.
    thorough : bool
        Read all of a column of dates where its first rows leave open which number is the month.

    Raises
    ------
    ReadError
        The file cannot be opened or has no rows of values.
    """

    format = "csv"
    rig_text: str | None = None

    def __init__(self, path: Path, rate: float | None, thorough: bool = True) -> None:
        self.path = path
        self.rate = rate
        self.findings = Findings()
        self.unread: dict[str, str] = {}
        self._compressed = False
        self._dialect = self._detect()
        self._sample = _sample_columns(self._dialect)
        self._plan = find_clocks(
            self._dialect.names, self._dialect.units, self._sample, self._all_cells if thorough else None
        )
        self._dialect = _with_unit_of_time(self._dialect, self._plan)
        self._counts: dict[str, Cells] = {}
        self._times: list[RowTimes] = []
        clocks = self._plan.columns()
        numbers = [numbers_and_words(column) for column in self._sample]
        if not any(good and (clocks or good > words) for good, words in numbers):
            raise ReadError("holds text, but no table: none of its columns holds numbers", path)
        self._numbers = [i for i, (good, words) in enumerate(numbers) if good > words]
        whole = self._all_rows if thorough else self._first_rows
        self._slots = Slots(self._dialect.names, self._sample)
        first = self._slots.without_names(self._sample)
        self._speakers, self._perhaps = find_speakers(self._dialect.names, first, self._plan, whole)
        taken = {*clocks, *(self._speakers.columns if self._speakers else ())}
        names = self._dialect.names
        self._sections = find_sections(
            names, self._sample, self._plan, [i for i in range(len(names)) if i not in taken]
        )
        self._channels = [i for section in self._sections for i in section.columns]
        whole_rows, *apart = self._sections
        named = [i for i in whole_rows.columns if names[i] != f"column_{i}"]
        self._seen = stretches(self._sample, named if clocks and not apart else (), whole)
        groups = group_by_blanks(self._seen, whole_rows.columns) if clocks else [whole_rows.columns]
        self._layers = Layers(self._seen, groups)
        groups += [section.columns for section in apart]
        self._streams = {i: self._stream_name(k, group) for k, group in enumerate(groups) for i in group}

    def catalogue(self) -> Catalogue:
        """Return the columns; those whose first cells are all text are listed as unread."""
        channels: dict[str, ChannelInfo] = {}
        unread: dict[str, str] = {}
        for i in self._channels:
            name, unit = self._dialect.names[i], self._dialect.units[i]
            cells = Cells()
            for rows in self._seen:
                cells.convert(rows[i])
            if cells.text:
                unread[name] = self._why_unread(name, cells)
            else:
                for part in self._parts:
                    channels[name + part] = ChannelInfo(self._streams[i] + part, "csv", unit)
        return Catalogue(channels, unread)

    def heads(self) -> Iterator[Block]:
        """Yield the first rows."""
        return first_of_each(self.blocks(None))

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield the table's rows, block by block.

        Raises
        ------
        ReadError
            The table cannot be parsed.
        """
        self._note_dialect()
        names = self._dialect.names
        texts = self.catalogue().unread if self._speakers else {}  # whose text would be unread for each
        self.unread |= texts
        columns = [
            i
            for i in self._channels
            if names[i] not in texts and (wanted is None or any(names[i] + part in wanted for part in self._parts))
        ]
        self._counts = {names[i]: Cells() for i in columns}
        self._times = [RowTimes(section.clocks, self._parts, self._layers) for section in self._sections]
        speaker = self._speakers.columns if self._speakers else ()
        row, dropped = 0, 0
        damage = Damage(self.path) if self._compressed else None
        rows = Rows(self.path, self._dialect, self._numbers)
        sections = [(clocks, [i for i in own if names[i] in self._counts]) for clocks, own in self._sections]
        needed = {*columns, *speaker, *self._layers.columns, *(i for clocks, _ in sections for i in _columns(clocks))}
        needed |= self._slots.begin(columns)
        for parsed in rows.batches(sorted(needed)):
            batch = self._slots.in_place(parsed, partial(self._at, parsed))
            everyones = {"": np.ones(batch.num_rows, bool)}
            parts = self._speakers.rows(self._cells(batch, speaker)) if self._speakers else everyones
            values = {names[i]: self._counts[names[i]].convert(batch.column(names[i])) for i in columns}
            marks = partial(row_marks, values, batch.num_rows)
            timed = [
                times.of(partial(self._cells, batch), parts, marks)
                if clocks
                else (row_clock(row, batch.num_rows, self.rate), np.ones(batch.num_rows, bool))
                for times, (clocks, _) in zip(self._times, sections, strict=True)
            ]
            told = np.logical_or.reduce([good for _, good in timed])
            sound = damage.sound_rows(row, told, self._counts.values(), rows.first_odd) if damage else None
            if sound is None:
                dropped += sum(
                    self._untimed(clocks, batch, g) for (clocks, _), (_, g) in zip(sections, timed, strict=True)
                )
            row += batch.num_rows
            for (_, own), (stamps, good) in zip(sections, timed, strict=True):
                if sound is not None:
                    good[sound:] = False
                if own or len(sections) == 1:
                    for part, theirs in parts.items():
                        chosen = _chosen(good & theirs, stamps, {names[i]: values[names[i]] for i in own})
                        yield from self._by_stream(own, part, *chosen, wanted)
            if damage and sound is not None:  # what is told of cells would be of those that were left out
                self.findings.append(damage.finding())
                self._note_text()
                return
        self.findings.add(*rows.findings)
        self._report(dropped)

    def _by_stream(
        self,
        columns: list[int],
        part: str,
        stamps: dict[str, Stamps],
        values: dict[str, Values],
        wanted: Collection[str] | None,
    ) -> Iterator[Block]:
        """Yield a block per stream, the sparse ones without their blank rows; `part` stands behind all names."""
        names, units = self._dialect.names, self._dialect.units
        for stream in dict.fromkeys(self._streams[i] for i in columns) or [self.path.stem]:
            own = [i for i in columns if self._streams[i] == stream]
            cells = {names[i]: values[names[i]] for i in own}
            times = stamps
            if stream != self.path.stem:
                filled = ~np.all([np.isnan(column) for column in cells.values()], axis=0)
                cells = {name: column[filled] for name, column in cells.items()}
                times = {kind: time[filled] for kind, time in stamps.items()}
            cells = {name + part: column for name, column in cells.items() if wanted is None or name + part in wanted}
            stated = {names[i] + part: unit for i in own if (unit := units[i]) is not None}
            yield Block(stream + part, "csv", times, cells, stated, self._timeless())

    @property
    def _parts(self) -> Collection[str]:
        """What stands behind the names of channels and streams."""
        return self._speakers.parts if self._speakers else ("",)

    def _all_cells(self, column: int) -> Iterator[pa.Array]:
        """Yield all of a column, part by part."""
        return (cells for (cells,) in self._all_rows([column]))

    def _all_rows(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        """Yield all of some columns, part by part."""
        for batch in Rows(self.path, self._dialect, ()).batches(columns):
            yield self._cells(batch, columns)

    def _first_rows(self, columns: Sequence[int]) -> list[list[pa.Array]]:
        return [[self._sample[i] for i in columns]]

    def _cells(self, batch: pa.RecordBatch, columns: Sequence[int]) -> list[pa.Array]:
        return [batch.column(self._dialect.names[i]) for i in columns]

    def _at(self, batch: pa.RecordBatch, column: int) -> int:
        """Return where in a batch a column is, -1 where it is not."""
        return int(batch.schema.get_field_index(self._dialect.names[column]))

    def _stream_name(self, number: int, group: list[int]) -> str:
        return self.path.stem if number == 0 else f"{self.path.stem} ({self._dialect.names[group[0]]} …)"

    def _detect(self) -> Dialect:
        try:
            with open_text(self.path) as source:
                self._compressed = isinstance(source, BoundedGzip)
                head = read_beginning(source, PIECE_BYTES)
                if head.count(b"\n") < SAMPLE_ROWS:  # a header of thousands of columns
                    head += read_beginning(source, DECODED_BYTES - len(head))
                    whole = len(head) < DECODED_BYTES
                else:
                    whole = len(head) < PIECE_BYTES
        except OSError as error:
            raise ReadError(f"cannot be read: {error.strerror or error}", self.path) from error
        if columns := _too_many_columns(head):
            raise ReadError(f"has {columns} columns; more than {MAX_FIELDS} are no log of a machine", self.path)
        dialect = detect(head, whole)
        if not dialect.names or not dialect.rows:
            raise ReadError("holds text, but no table: no row of values was found", self.path)
        if dialect.torn:
            raise ReadError(
                f"the header has {plural(dialect.torn, 'name')}, but rows have {len(dialect.names)} cells: its"
                " numbers seem to have decimal commas while commas separate its columns too; export it with semicolons"
                " between columns, or with decimal points",
                self.path,
            )
        if len(dialect.names) > MAX_FIELDS:
            raise ReadError(
                f"has {len(dialect.names)} columns; more than {MAX_FIELDS} are no log of a machine", self.path
            )
        return dialect

    @property
    def has_clock(self) -> bool:
        """Whether columns tell the time."""
        return bool(self._plan.clocks)

    @property
    def dialect(self) -> Dialect:
        """How the text is written."""
        return self._dialect

    @property
    def seekable(self) -> bool:
        """Whether lines can be found from anywhere in the file: it is not compressed, and a line's end is one byte."""
        return not self._compressed and not self._dialect.encoding.startswith("utf-16")

    def _untimed(self, clocks: Mapping[str, ClockColumn], batch: pa.RecordBatch, good: NDArray[np.bool_]) -> int:
        """Return how many rows have no time, without those at which one of several logs side by side had ended."""
        if len(self._sections) > 1:
            (at,) = _columns(clocks)
            good = good | self._cells(batch, [at])[0].is_null().to_numpy(zero_copy_only=False)
        return int(np.count_nonzero(~good))

    def _timeless(self) -> Finding | None:
        if self._plan.backwards is None:
            return None
        column, row = self._plan.backwards
        return runs_backwards(self._dialect.names[column], f"line {self._dialect.lines[row]}")

    def _note_dialect(self) -> None:
        self.findings.add(*self._dialect.findings, *self._plan.findings)
        if self._dialect.separator == "," and any(n.decimal_comma for n in self._dialect.notations):
            self.findings.add(Finding(code="table.decimal_commas"))
        if self._speakers:
            self.findings.add(self._speakers.finding())
        if self._perhaps:
            self.findings.add(self._perhaps)
        if self.rate is not None and self._plan.clocks:
            self.findings.add(Finding(code="clock.rate_not_used", value=self.rate, unit="Hz"))
        others = self._sections[1:]
        if others:
            self.findings.add(Finding(code="table.several_clocks", value=len(others) + 1))
        sparse = len(set(self._streams.values())) - (self.path.stem in self._streams.values()) - len(others)
        self.findings.add(*columns_apart(sparse, self._layers))
        if self._plan.clocks or self.rate is not None:
            return
        self.findings.add(self._timeless() or Finding(code="clock.missing", part=self.path.stem))
        for name, cells in zip(self._dialect.names, self._sample, strict=True):
            if looks_like_clock(Cells().convert(cells)):
                self.findings.add(Finding(code="clock.perhaps", part=name))
                break

    def _why_unread(self, name: str, cells: Cells) -> str:
        notation = self._dialect.notations[self._dialect.names.index(name)]
        if notation.hexadecimal:
            return "hexadecimal numbers"
        mixed = notation.mixed
        return f"its numbers have units that are not all the same: {mixed}" if mixed else cells.text

    def _report(self, dropped: int) -> None:
        """Tell what was wrong with the cells."""
        if dropped:
            self.findings.add(Finding(code="clock.rows_without_time", part=self.path.stem, value=dropped))
        if self._speakers:
            self.findings.add(*self._speakers.left_out())
        self.findings.add(*self._slots.findings(), *(one for times in self._times for one in times.findings()))
        self._note_text()
        self.findings.add(*(one for name, cells in self._counts.items() for one in cells.findings(name)))

    def _note_text(self) -> None:
        """Say which columns are no signals after all."""
        for name, cells in self._counts.items():
            if cells.text:
                self.unread |= dict.fromkeys((name + part for part in self._parts), self._why_unread(name, cells))


def _columns(clocks: Mapping[str, ClockColumn]) -> set[int]:
    return {column for clock in clocks.values() for column in clock.columns}


def _chosen(
    own: NDArray[np.bool_], stamps: dict[str, Stamps], values: dict[str, Values]
) -> tuple[dict[str, Stamps], dict[str, Values]]:
    """Return some of a batch's rows."""
    if own.all():
        return stamps, values
    return {kind: times[own] for kind, times in stamps.items()}, {name: cells[own] for name, cells in values.items()}


def _too_many_columns(head: bytes) -> str:
    """Return how many columns the first lines have, "" where they are not too many: to look at all of them takes long."""
    *lines, last = head.split(b"\n")
    lines = [line for line in lines[:SAMPLE_ROWS] if line.strip() and not line.lstrip().startswith((b"#", b"%"))]
    fewest = min(lines, key=len, default=last)
    count = max(len(fewest.split()), *(fewest.count(mark) + 1 for mark in (b",", b";", b"\t", b"|")))
    quotes = 10 if b'"' in fewest else 1  # which may hold such marks
    return "" if count <= quotes * MAX_FIELDS else f"{count}" if lines else f"more than {count}"


def _with_unit_of_time(dialect: Dialect, plan: ClockPlan) -> Dialect:
    """Return a dialect with the unit that a clock was found to have, for headers further down that state theirs."""
    units = {clock.columns[0]: clock.form for clock in plan.clocks.values() if clock.form in UNITS}
    return replace(dialect, units=tuple(units.get(i, unit) for i, unit in enumerate(dialect.units)))


def _sample_columns(dialect: Dialect) -> list[pa.Array]:
    """Return the columns' first cells, as `Rows` would give them."""
    columns = ([row[i] if row[i] not in NULLS else None for row in dialect.rows] for i in range(len(dialect.names)))
    return [
        notation.plain(pa.array(cells, pa.string()))[0]
        for notation, cells in zip(dialect.notations, columns, strict=True)
    ]
