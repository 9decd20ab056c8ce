"""Parquet files."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import pyarrow as pa

from vsalog.core.errors import ReadError
from vsalog.core.printable import printable
from vsalog.core.units import split_header
from vsalog.readers.parquet_cells import is_moment, is_number, rising
from vsalog.readers.parquet_flat import FlatRows
from vsalog.readers.parquet_opened import missing_footer
from vsalog.readers.parquet_rows import ParquetRows
from vsalog.readers.tables.cells import numbers_and_words
from vsalog.readers.tables.columnar import Batch, ColumnarReader
from vsalog.readers.tables.text import printable_cell, unique_names
from vsalog.readers.tables.time_columns import ClockPlan, find_clocks

KEYS = ("joint", "transmission")
"""Text columns of vsalog's own traces: their values name the part of the device a row belongs to."""
STREAM, RIG = b"stream", b"vsalog.rig"
"""Metadata of vsalog's own logs: of a column, the stream whose clock it is on; of the table, its rig."""

_INDEX = "__index_level_0__"
"""The name that pandas gives to an index without one."""


class ParquetReader(ColumnarReader):
    """Reads a Parquet file; see `vsalog.readers.base.Reader`.

    Parameters
    ----------
    path : Path
        The file.
    rate : float or None
        Samples per second [Hz], for a file without a time column.
    units : mapping of str to str
        Units of columns for which the file states none.

    Raises
    ------
    ReadError
        The file cannot be opened, is damaged or contains no rows.
    """

    format = "parquet"

    def __init__(self, path: Path, rate: float | None, units: Mapping[str, str] = MappingProxyType({})) -> None:
        super().__init__(path, rate, units)
        try:
            rows = ParquetRows(path)
        except (pa.ArrowException, OSError, UnicodeError) as error:  # a damaged column name may be no text
            words = printable(str(error).strip())[:200]
            raise ReadError(f"the Parquet file cannot be read: {missing_footer(path) or words}", path) from error
        if not any(rows.sizes):
            raise ReadError("the Parquet file has no rows", path)
        self._rows = FlatRows(rows)
        schema = self._rows.schema
        pairs = [split_header(name) for name in schema.names]
        self._names = unique_names(
            [
                "time" if name == _INDEX and is_moment(field.type) else name
                for (name, _), field in zip(pairs, schema, strict=True)
            ]
        )
        stated_units = [_unit(schema.field(i)) or unit for i, (_, unit) in enumerate(pairs)]
        self._units = self._with_given(self._names, stated_units)
        sample = self._rows.sample()
        count = next((len(cells) for cells in sample if cells is not None), 0)
        self._sample = [pa.nulls(count, f.type) if one is None else one for one, f in zip(sample, schema, strict=True)]
        plan = self._find_clocks([i for i, cells in enumerate(sample) if cells is None])
        keys = self._keys()
        # A trace carries the rig of the log that it was estimated from, whose channels it does not have.
        self.rig_text = None if keys else _text(schema.metadata, RIG)
        stated = [_text(field.metadata, STREAM) for field in schema]
        streams = {i: stream or path.stem for i, stream in enumerate(stated)} if any(stated) else None
        self._interpret(plan, [i for i in range(len(schema)) if self._is_signal(i)], keys, streams)

    def _find_clocks(self, lost: Sequence[int]) -> ClockPlan:
        """Return which columns are the clock; lost ones have no readable row.

        Raises
        ------
        ReadError
            A lost column would be the clock, and no rate is given.
        """
        plan = find_clocks(self._names, self._units, self._sample, by_rise=self.rate is None and not lost)
        if plan.clocks or self.rate is not None or not lost:
            return plan
        likely = [rising(len(one), one.type) if i in lost else one for i, one in enumerate(self._sample)]
        for i in sorted(find_clocks(self._names, self._units, likely).columns()):
            raise ReadError(
                f"the Parquet file is damaged: time column '{printable_cell(self._names[i])}' cannot be read;"
                " --rate HZ reads the others as evenly sampled",
                self.path,
            )
        return plan

    def _keys(self) -> tuple[int, ...]:
        """Return the columns of a trace that name the part of the device, none for other tables."""
        schema = self._rows.schema
        named = all(schema.names.count(key) == 1 and pa.types.is_string(schema.field(key).type) for key in KEYS)
        return tuple(schema.names.index(key) for key in KEYS) if named else ()

    def _is_signal(self, column: int) -> bool:
        kind = self._rows.schema.field(column).type
        if pa.types.is_string(kind):
            good, words = numbers_and_words(self._sample[column])
            return good > words
        return is_number(kind)

    def _no_signals(self) -> dict[str, str]:
        others = {*range(len(self._names))} - {*self._channels} - self._not_channels()
        kinds = self._rows.schema.types
        return {
            self._names[i]: "text" if pa.types.is_string(kinds[i]) else f"column of type {kinds[i]}"
            for i in sorted(others)
        }

    def _batches(self, columns: Sequence[int], required: Collection[int]) -> Iterator[Batch]:
        for row, count, cells in self._rows.batches(columns or [0], required):
            yield Batch(row, count, cells)
        self.findings.add(*self._rows.findings)

    def _whole(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        """Yield all of some columns, part by part, without rows of which one of them is damaged."""
        for _, _, cells in self._rows.batches(columns, columns):
            yield [cells[i] for i in columns]

    def _where(self, row: int) -> str:
        return f"row {row + 1}"


def _unit(field: pa.Field) -> str | None:
    """Return the unit in a column's metadata."""
    return (_text(field.metadata, b"unit") or "").strip() or None


def _text(metadata: Mapping[bytes, bytes] | None, key: bytes) -> str | None:
    """Return a text of some metadata, None where there is none or it is empty."""
    raw = (metadata or {}).get(key, b"")
    return raw.decode("utf-8", "replace") or None
