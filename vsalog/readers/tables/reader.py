"""Reads text tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import PIECE_BYTES
from vsalog.core.printable import plural
from vsalog.core.recording import Stamps, Values
from vsalog.readers.base import Block, Catalogue, ChannelInfo, first_of_each
from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.limits import DECODED_BYTES, SAMPLE_ROWS
from vsalog.readers.tables.cells import Cells, element_names, elements_of, numbers_and_words, split_lists, with_points
from vsalog.readers.tables.dialect import Dialect, detect
from vsalog.readers.tables.long_tables import find_speakers
from vsalog.readers.tables.merged_tables import Layers, columns_apart, group_by_blanks, stretches
from vsalog.readers.tables.row_times import RowTimes, row_clock
from vsalog.readers.tables.rows import Rows
from vsalog.readers.tables.sections import find_sections
from vsalog.readers.tables.slots import Slots
from vsalog.readers.tables.source import BoundedGzip, open_text, read_beginning
from vsalog.readers.tables.text import NULLS
from vsalog.readers.tables.time_columns import (
    ClockColumn,
    digits_of,
    find_clocks,
    looks_like_clock,
    runs_backwards,
)
from vsalog.readers.tables.time_numbers import is_exact
from vsalog.readers.tables.time_steps import row_marks


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
        self._names = names = self._dialect.names
        self._sample = _sample_columns(self._dialect)
        counts = [numbers_and_words(column) for column in self._sample]
        self._kinds = {i: pa.float64() for i, (good, words) in enumerate(counts) if good > words}
        self._digits: dict[int, int] = {}
        self._plan = find_clocks(names, self._dialect.units, self._sample, self._all_cells if thorough else None)
        clocks = self._plan.columns()
        lists = {i: elements_of(column) for i, column in enumerate(self._sample) if counts[i][1] and i not in clocks}
        self._lists = {i: element_names(names[i], count) for i, count in lists.items() if count}
        if not self._lists and not any(good and (clocks or good > words) for good, words in counts):
            raise ReadError("holds text, but no table: none of its columns holds numbers", path)
        whole = self._all_rows if thorough else self._first_rows
        self._slots = Slots(names, self._sample)
        first = self._slots.without_names(self._sample)
        self._speakers, self._perhaps = find_speakers(names, first, self._plan, whole)
        taken = {*clocks, *(self._speakers.columns if self._speakers else ())}
        self._kinds = {i: kind for i, kind in self._kinds.items() if i not in taken} | self._kinds_of_clocks()
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

    def _kinds_of_clocks(self) -> dict[int, pa.DataType]:
        """Return how columns of clocks are parsed, unless as text: as whole numbers, or as decimal ones where these are exact."""
        kinds = {}
        for clock in self._plan.clocks.values():
            for column, digits in zip(clock.columns, digits_of(clock.form), strict=False):
                cells = self._sample[column]
                if not pc.any(pc.match_substring_regex(cells, "[.eE]")).as_py():
                    kinds[column] = pa.int64()
                elif is_exact(pa.array(Cells().convert(cells), from_pandas=True), digits):
                    kinds[column], self._digits[column] = pa.float64(), digits
        return kinds

    def catalogue(self) -> Catalogue:
        """Return the columns; those whose first cells are all text are listed as unread."""
        channels: dict[str, ChannelInfo] = {}
        unread: dict[str, str] = {}
        for i in self._channels:
            cells = Cells()
            for rows in () if i in self._lists else self._seen:
                cells.convert(rows[i])
            for name in self._named(i):
                if cells.text and i not in self._lists:
                    unread[name] = cells.text
                    continue
                for part in self._parts:
                    channels[name + part] = ChannelInfo(self._streams[i] + part, "csv", self._dialect.units[i])
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
        texts = self.catalogue().unread if self._speakers else {}  # whose text would be unread for each
        self.unread |= texts
        columns = [
            i
            for i in self._channels
            if self._names[i] not in texts
            and (wanted is None or any(name + part in wanted for name in self._named(i) for part in self._parts))
        ]
        counts = {name: Cells() for i in columns for name in self._named(i)}
        times = [RowTimes(section.clocks, self._parts, self._layers) for section in self._sections]
        speaker = self._speakers.columns if self._speakers else ()
        row, untimed = 0, 0
        rows = Rows(self.path, self._dialect, self._kinds, self._digits)
        chosen = {*columns}
        sections = [(clocks, [i for i in own if i in chosen]) for clocks, own in self._sections]
        needed = {*columns, *speaker, *self._layers.columns, *(i for clocks, _ in sections for i in _columns(clocks))}
        needed |= self._slots.begin(columns)
        for parsed in rows.batches(sorted(needed)):
            batch = self._slots.in_place(parsed, partial(self._at, parsed))
            everyones = {"": np.ones(batch.num_rows, bool)}
            parts = self._speakers.rows(self._cells(batch, speaker)) if self._speakers else everyones
            values = self._values(batch, columns, counts)
            marks = partial(row_marks, values, batch.num_rows)
            for (clocks, own), time in zip(sections, times, strict=True):
                if clocks:
                    stamps, good = time.of(partial(self._cells, batch), parts, marks)
                    untimed += self._untimed(clocks, batch, good)
                else:
                    stamps, good = row_clock(row, batch.num_rows, self.rate), np.ones(batch.num_rows, bool)
                if own or len(sections) == 1:
                    for part, theirs in parts.items():
                        for block in self._by_stream(own, part, good & theirs, stamps, values, wanted):
                            yield replace(block, expected=0 if self._speakers else rows.expected)
            row += batch.num_rows
        self.findings.add(*rows.findings)
        if untimed:
            self.findings.append(Finding(code="clock.rows_without_time", part=self.path.stem, value=untimed))
        if self._speakers:
            self.findings.add(*self._speakers.left_out())
        self.findings.add(*self._slots.findings(), *(one for time in times for one in time.findings()))
        for name, cells in counts.items():
            if cells.text:
                self.unread |= dict.fromkeys((name + part for part in self._parts), cells.text)
            self.findings.add(*cells.findings(name))

    def _values(self, batch: pa.RecordBatch, columns: Sequence[int], counts: Mapping[str, Cells]) -> dict[str, Values]:
        """Return the channels' numbers in a batch by name, those of lists apart."""
        values = {}
        for i in columns:
            cells = batch.column(self._names[i])
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
        """Yield a block of some rows per stream, the sparse ones without their blank rows; `part` stands behind all names."""
        units = self._dialect.units
        every = bool(rows.all())
        for stream in dict.fromkeys(self._streams[i] for i in columns) or [self.path.stem]:
            own = {name: units[i] for i in columns if self._streams[i] == stream for name in self._named(i)}
            kept = rows
            if stream != self.path.stem:
                kept = rows & ~np.all([np.isnan(values[name]) for name in own], axis=0)
            whole = every and kept is rows
            asked = {name: name + part for name in own if wanted is None or name + part in wanted}
            yield Block(
                stream + part,
                "csv",
                {kind: times if whole else times[kept] for kind, times in stamps.items()},
                {full: values[name] if whole else values[name][kept] for name, full in asked.items()},
                {name + part: unit for name, unit in own.items() if unit is not None},
                self._timeless(),
            )

    def _named(self, column: int) -> Sequence[str]:
        """Return the names of a column's channels: its own, or those of the elements of its lists."""
        return self._lists.get(column) or (self._names[column],)

    @property
    def _parts(self) -> Collection[str]:
        """What stands behind the names of channels and streams."""
        return self._speakers.parts if self._speakers else ("",)

    def _all_cells(self, column: int) -> Iterator[pa.Array]:
        """Yield all of a column, part by part."""
        return (cells for (cells,) in self._all_rows([column]))

    def _all_rows(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        """Yield all of some columns as text, part by part."""
        others = {i: kind for i, kind in self._kinds.items() if i not in columns}
        for batch in Rows(self.path, self._dialect, others).batches(columns):
            yield self._cells(batch, columns)

    def _first_rows(self, columns: Sequence[int]) -> list[list[pa.Array]]:
        return [[self._sample[i] for i in columns]]

    def _cells(self, batch: pa.RecordBatch, columns: Sequence[int]) -> list[pa.Array]:
        return [batch.column(self._names[i]) for i in columns]

    def _at(self, batch: pa.RecordBatch, column: int) -> int:
        """Return where in a batch a column is, -1 where it is not."""
        return int(batch.schema.get_field_index(self._names[column]))

    def _stream_name(self, number: int, group: list[int]) -> str:
        return self.path.stem if number == 0 else f"{self.path.stem} ({self._names[group[0]]} …)"

    def _detect(self) -> Dialect:
        try:
            with open_text(self.path) as source:
                self._compressed = isinstance(source, BoundedGzip)
                head, whole = read_beginning(source, PIECE_BYTES), False
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
        return runs_backwards(self._names[column], f"line {self._dialect.lines[row]}")

    def _note_dialect(self) -> None:
        self.findings.add(*self._dialect.findings, *self._plan.findings)
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
        for name, cells in zip(self._names, self._sample, strict=True):
            if looks_like_clock(Cells().convert(cells)):
                self.findings.add(Finding(code="clock.perhaps", part=name))
                break


def _columns(clocks: Mapping[str, ClockColumn]) -> set[int]:
    return {column for clock in clocks.values() for column in clock.columns}


def _too_many_columns(head: bytes) -> str:
    """Return how many columns the first lines have, "" where they are not too many: to look at all of them takes long."""
    *lines, last = head.split(b"\n")
    lines = [line for line in lines[:SAMPLE_ROWS] if line.strip() and not line.lstrip().startswith((b"#", b"%"))]
    fewest = min(lines, key=len, default=last)
    count = max(len(fewest.split()), *(fewest.count(mark) + 1 for mark in (b",", b";", b"\t", b"|")))
    quotes = 10 if b'"' in fewest else 1  # which may hold such marks
    return "" if count <= quotes * MAX_FIELDS else f"{count}" if lines else f"more than {count}"


def _sample_columns(dialect: Dialect) -> list[pa.Array]:
    """Return the columns' first cells as text, numbers with a decimal point."""
    columns = ([row[i] if row[i] not in NULLS else None for row in dialect.rows] for i in range(len(dialect.names)))
    return [with_points(pa.array(cells, pa.string()), dialect.decimal_comma) for cells in columns]
