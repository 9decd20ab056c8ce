"""Parquet files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import printable
from vsalog.core.recording import Stamps, Values
from vsalog.core.units import split_header
from vsalog.readers.base import Block, Catalogue, ChannelInfo, first_of_each
from vsalog.readers.parquet_cells import as_numbers, is_moment, is_number, rising
from vsalog.readers.parquet_cells import rounded as rounded_in
from vsalog.readers.parquet_flat import FlatRows
from vsalog.readers.parquet_opened import missing_footer
from vsalog.readers.parquet_rows import ParquetRows
from vsalog.readers.tables.cells import Cells, numbers_and_words
from vsalog.readers.tables.long_tables import Speakers, find_speakers
from vsalog.readers.tables.merged_tables import Layers, blank, columns_apart, group_by_blanks, stretches
from vsalog.readers.tables.row_times import RowTimes, row_clock
from vsalog.readers.tables.slots import Slots
from vsalog.readers.tables.text import printable_cell, unique_names
from vsalog.readers.tables.time_columns import ClockPlan, find_clocks, looks_like_clock, runs_backwards
from vsalog.readers.tables.time_steps import row_marks

KEYS = ("joint", "transmission")
"""Text columns of vsalog's own traces: their values name the part of the device a row belongs to."""
STREAM, RIG = b"stream", b"vsalog.rig"
"""Metadata of vsalog's own logs: of a column, the stream whose clock it is on; of the table, its rig."""

_INDEX = "__index_level_0__"
"""What pandas calls an index without a name."""


class ParquetReader:
    """Reads a Parquet file; see `vsalog.readers.base.Reader`.

    Parameters
    ----------
    path : Path
        The file.
    rate : float or None
        Samples per second [Hz], for a file without a time column.

    Raises
    ------
    ReadError
        The file cannot be opened, is damaged or holds no rows.
    """

    format = "parquet"

    def __init__(self, path: Path, rate: float | None) -> None:
        self.path = path
        self.rate = rate
        self.findings = Findings()
        self.unread: dict[str, str] = {}
        try:
            rows = ParquetRows(path)
        except (pa.ArrowException, OSError, UnicodeError) as error:  # a column's name may have become no text
            words = printable(str(error).strip())[:200]
            raise ReadError(f"the Parquet file cannot be read: {missing_footer(path) or words}", path) from error
        if not any(rows.sizes):
            raise ReadError("the Parquet file has no rows", path)
        self._rows = FlatRows(rows)
        schema = self._rows.schema
        pairs = [split_header(name) for name in schema.names]
        counted: Counter[str] = Counter()
        self._places = []
        for name in schema.names:
            self._places.append((name, counted[name]))
            counted[name] += 1
        called = [
            "time" if name == _INDEX and is_moment(field.type) else name
            for (name, _), field in zip(pairs, schema, strict=True)
        ]
        self._names = unique_names(called)
        self._units = [_unit(schema.field(i)) or unit for i, (_, unit) in enumerate(pairs)]
        self._sample = self._rows.sample()
        self._plan = self._find_clocks(rate)
        self._rounded: dict[int, str] = {}
        self._written = self._numbers_as_text()
        self._streams = [_text(field.metadata, STREAM) or path.stem for field in schema]
        self._slots = Slots(self._names, self._known_cells())
        keys = self._keys()
        # A trace carries the rig of the log that it was estimated from, whose channels it does not have.
        self.rig_text = None if keys else _text(schema.metadata, RIG)
        self._speakers: Speakers | None
        if keys:
            self._speakers = Speakers(KEYS, keys, self._all_rows(keys))
        else:
            first = self._slots.without_names(self._known_cells())
            self._speakers, perhaps = find_speakers(self._names, first, self._plan, self._all_rows)
            if found := self._speakers.finding() if self._speakers else perhaps:
                self.findings.add(found)
        self._layers = self._merged()
        self._times = RowTimes(self._plan.clocks, (), self._layers)

    def _merged(self) -> Layers:
        """Give columns that leave others' rows blank streams of their own; return which tables were put below one another.

        Columns of a trace, and of logs that say which stream they are of, stay as they are.
        """
        self._sparse: list[list[int]] = []
        schema = self._rows.schema
        columns = [i for i in self._number_columns() if self._sample and self._sample[i] is not None]
        if not columns or not self._plan.clocks or self._keys() or any(_text(f.metadata, STREAM) for f in schema):
            return Layers([], [])
        seen = stretches(self._known_cells(), columns, self._any_rows)
        groups = group_by_blanks(seen, columns)
        layers = Layers(seen, groups)
        self._sparse = groups[1:] if layers.apart else []
        for group in self._sparse:
            for i in group:
                self._streams[i] = f"{self.path.stem} ({self._names[group[0]]} …)"
        return layers

    def _keys(self) -> tuple[int, ...]:
        """Return the columns of a trace that name the part of the device, none for other tables."""
        schema = self._rows.schema
        named = all(schema.names.count(key) == 1 and pa.types.is_string(schema.field(key).type) for key in KEYS)
        return tuple(schema.names.index(key) for key in KEYS) if named else ()

    def _known_cells(self) -> list[pa.Array]:
        """Return the first rows of each column, null where they cannot be read."""
        rows = next((len(cells) for cells in self._sample if cells is not None), 0)
        return [
            pa.nulls(rows, field.type) if cells is None else cells
            for cells, field in zip(self._sample, self._rows.schema, strict=False)
        ]

    def _all_rows(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        """Yield all of some columns, part by part, without rows of which one of them is damaged."""
        names = [self._rows.schema.names[i] for i in columns]
        for _, batch in self._rows.batches(names, names):
            yield self._all_cells(batch, columns)

    def _any_rows(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        """Yield all of some columns, part by part, null where they are damaged."""
        for _, batch in self._rows.batches([self._rows.schema.names[i] for i in columns], ()):
            yield self._all_cells(batch, columns)

    def _find_clocks(self, rate: float | None) -> ClockPlan:
        """Return which columns are the clock.

        Raises
        ------
        ReadError
            One would be it, but none of its rows can be read, and no rate makes up for it.
        """
        sample, known = self._sample, self._known_cells()
        plan = find_clocks(self._names, self._units, known)
        if plan.clocks or rate is not None or all(cells is not None for cells in sample):
            return plan
        likely = [
            rising(len(null), null.type) if cells is None else cells for cells, null in zip(sample, known, strict=True)
        ]
        for i in sorted(find_clocks(self._names, self._units, likely).columns()):
            raise ReadError(
                f"the Parquet file is damaged: time column '{printable_cell(self._names[i])}' cannot be read;"
                " --rate HZ reads the others as evenly sampled",
                self.path,
            )
        return plan

    def catalogue(self) -> Catalogue:
        """Return the columns."""
        channels: dict[str, ChannelInfo] = {}
        for part in self._parts:
            for i in self._number_columns():
                channels[self._names[i] + part] = ChannelInfo(self._stream(part, i), "parquet", self._units[i])
        return Catalogue(channels, self._text_columns())

    def heads(self) -> Iterator[Block]:
        """Yield the first rows."""
        return first_of_each(self.blocks(None))

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield the file's rows, block by block; only the wanted columns are read.

        Raises
        ------
        ReadError
            The file is damaged.
        """
        self.unread.update(self._text_columns())
        self._note_clock()
        self._times = RowTimes(self._plan.clocks, self._parts, self._layers)
        self._written = {i: Cells() for i in self._written}
        parts = self._parts
        columns = [
            i
            for i in self._number_columns()
            if wanted is None or any(self._names[i] + part in wanted for part in parts)
        ]
        schema = self._rows.schema
        streams = [(members, self._tellers(members)) for members in self._by_stream(columns)]
        read = {*columns, *self._not_channels(), *self._layers.columns, *(i for _, tellers in streams for i in tellers)}
        read |= self._slots.begin(columns)
        needed = [schema.names[i] for i in sorted(read)] or schema.names[:1]
        dropped = 0
        for row, stored in self._batches(needed):
            batch = self._slots.in_place(stored, partial(self._at, stored))
            whose = self._whose(batch)
            values = {i: self._values(batch, i) for i in columns}
            named = {self._names[i]: cells for i, cells in values.items()}
            stamps, good = row_clock(row, batch.num_rows, self.rate), np.ones(batch.num_rows, bool)
            if self._plan.clocks:
                cells = partial(self._all_cells, batch)
                stamps, good = self._times.of(cells, whose, partial(row_marks, named, batch.num_rows))
            dropped += int(np.count_nonzero(np.logical_or.reduce([*whose.values()]) & ~good))
            for part, own in whose.items():
                for members, tellers in streams:
                    rows = good & own & self._told(batch, tellers)
                    yield self._block(part, stamps, {i: values[i] for i in members}, rows, wanted)
        if dropped:
            self.findings.add(Finding(code="clock.rows_without_time", part=self.path.stem, value=dropped))
        if self._speakers:
            self.findings.add(*self._speakers.left_out())
        self.findings.add(*self._of_cells(), *self._times.findings(), *self._slots.findings())

    def _batches(self, columns: list[str]) -> Iterator[tuple[int, pa.RecordBatch]]:
        """Yield the number of the first row and the rows; what is damaged is among the findings.

        Raises
        ------
        ReadError
            Nothing of use can be read.
        """
        clocks = {self._rows.schema.names[i] for i in self._not_channels()}
        yield from self._rows.batches(columns, clocks.intersection(columns))
        self.findings.add(*self._rows.findings)

    def _block(
        self,
        part: str,
        stamps: Mapping[str, Stamps],
        columns: Mapping[int, Values],
        rows: NDArray[np.bool_],
        wanted: Collection[str] | None,
    ) -> Block:
        """Return some rows of a batch as a block."""
        values: dict[str, Values] = {}
        units: dict[str, str] = {}
        for i, cells in columns.items():
            name = self._names[i] + part
            if wanted is None or name in wanted:
                values[name] = cells if rows.all() else cells[rows]
                if (unit := self._units[i]) is not None:
                    units[name] = unit
        times = {kind: one if rows.all() else one[rows] for kind, one in stamps.items()}
        stream = self._stream(part, next(iter(columns), None))
        return Block(stream, "parquet", times, values, units, self._timeless())

    def _values(self, batch: pa.RecordBatch, column: int) -> Values:
        """Return a column's numbers; of those that had to be rounded one is kept."""
        cells = self._cells(batch, column)
        values = self._written[column].convert(cells) if column in self._written else as_numbers(cells)
        if column not in self._rounded and (rounded := rounded_in(cells, values)):
            self._rounded[column] = rounded
        return values

    def _told(self, batch: pa.RecordBatch, tellers: list[int]) -> NDArray[np.bool_]:
        """Return which rows any of some columns has a sample in; all, where there are none of these."""
        if not tellers:
            return np.ones(batch.num_rows, bool)
        return np.asarray(np.logical_or.reduce([~blank(self._cells(batch, i)) for i in tellers]), bool)

    def _by_stream(self, columns: list[int]) -> list[list[int]]:
        """Group columns by their stream; without any column there is the clock alone."""
        streams: dict[str, list[int]] = {}
        for i in columns:
            streams.setdefault(self._streams[i], []).append(i)
        return list(streams.values()) or [[]]

    def _tellers(self, columns: list[int]) -> list[int]:
        """Return the columns that tell which rows there are for the stream of some columns; none where all are.

        A row is there for a stream where any of its columns has a sample, whichever of them are wanted.
        """
        sparse = next((group for group in self._sparse if columns and columns[0] in group), None)
        if sparse:
            return sparse
        if (
            not columns
            or not _text(self._rows.schema.field(columns[0]).metadata, STREAM)
            or len(set(self._streams)) < 2
        ):
            return []
        return [i for i in self._number_columns() if self._streams[i] == self._streams[columns[0]]]

    def _all_cells(self, batch: pa.RecordBatch, columns: Sequence[int]) -> list[pa.Array]:
        return [self._cells(batch, i) for i in columns]

    def _cells(self, batch: pa.RecordBatch, column: int) -> pa.Array:
        """Return a column of a batch, by the file's own number: several may have one name."""
        return batch.column(self._at(batch, column))

    def _at(self, batch: pa.RecordBatch, column: int) -> int:
        """Return where in a batch a column is, -1 where it is not."""
        name, which = self._places[column]
        found = batch.schema.get_all_field_indices(name)
        return int(found[which]) if which < len(found) else -1

    def _not_channels(self) -> set[int]:
        """Return the columns that tell when and whose the values of a row are."""
        return {*self._plan.columns(), *(self._speakers.columns if self._speakers else ())}

    def _number_columns(self) -> list[int]:
        schema = self._rows.schema
        clocks = self._not_channels()
        return [i for i in range(len(schema)) if i not in clocks and self._is_signal(i)]

    def _is_signal(self, column: int) -> bool:
        return column in self._written or is_number(self._rows.schema.field(column).type)

    def _numbers_as_text(self) -> dict[int, Cells]:
        """Return what converts the columns of text that holds numbers."""
        found = {}
        for i, cells in enumerate(self._sample):
            if i not in self._plan.columns() and cells is not None and pa.types.is_string(cells.type):
                good, words = numbers_and_words(cells)
                if good > words:
                    found[i] = Cells()
        return found

    def _of_cells(self) -> Iterator[Finding]:
        """Yield what was no number, or is none that floating point can hold."""
        for i, number in self._rounded.items():
            yield Finding(code="table.numbers_rounded", part=self._names[i], evidence={"number": number})
        for i, cells in self._written.items():
            yield from cells.findings(self._names[i])

    def _text_columns(self) -> dict[str, str]:
        """Return the columns that are no signals, with the reason."""
        clocks = self._not_channels()
        return {
            self._names[i]: "text" if pa.types.is_string(field.type) else f"column of type {field.type}"
            for i, field in enumerate(self._rows.schema)
            if i not in clocks and not self._is_signal(i)
        }

    @property
    def _parts(self) -> Collection[str]:
        """What stands behind the names of channels and streams."""
        return self._speakers.parts if self._speakers else ("",)

    def _whose(self, batch: pa.RecordBatch) -> dict[str, NDArray[np.bool_]]:
        """Return which rows are of which part of the device, of those that have some."""
        if self._speakers is None:
            return {"": np.ones(batch.num_rows, bool)}
        parts = self._speakers.rows(self._all_cells(batch, self._speakers.columns))
        return {part: own for part, own in parts.items() if own.any()}

    def _stream(self, part: str, column: int | None) -> str:
        return (self.path.stem if column is None else self._streams[column]) + part

    def _timeless(self) -> Finding | None:
        if self._plan.backwards is None:
            return None
        column, row = self._plan.backwards
        return runs_backwards(self._names[column], f"row {row + 1}")

    def _note_clock(self) -> None:
        self.findings.add(*self._plan.findings, *columns_apart(len(self._sparse), self._layers))
        if not self._plan.clocks and self.rate is None:
            self.findings.add(self._timeless() or Finding(code="clock.missing", part=self.path.stem))
            for name, cells in zip(self._names, self._sample, strict=False):
                if cells is not None and pa.types.is_floating(cells.type) and looks_like_clock(as_numbers(cells)):
                    self.findings.add(Finding(code="clock.perhaps", part=name))
                    break
        elif self._plan.clocks and self.rate is not None:
            self.findings.add(Finding(code="clock.rate_not_used", value=self.rate, unit="Hz"))


def _unit(field: pa.Field) -> str | None:
    """Return the unit in a column's metadata."""
    return (_text(field.metadata, b"unit") or "").strip() or None


def _text(metadata: Mapping[bytes, bytes] | None, key: bytes) -> str | None:
    """Return a text of some metadata, None where there is none or it is empty."""
    raw = (metadata or {}).get(key, b"")
    return raw.decode("utf-8", "replace") or None
