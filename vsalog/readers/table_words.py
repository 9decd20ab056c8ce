"""Lines of words between the rows of a text table: remarks, and the header once more, where a log was appended to another."""

from __future__ import annotations

from collections.abc import Iterator

import pyarrow as pa
import pyarrow.compute as pc

from vsalog.printable import printable
from vsalog.readers.base import plural
from vsalog.readers.headers import printable_cell, unique_names
from vsalog.readers.table_dialect import Dialect
from vsalog.readers.table_text import is_value
from vsalog.units import split_header

_WORD = r"^\s*[^\s\d.+-]"
_COMMENT = r"^\s*(#|%)"
_MOST_HEADERS = 10_000


class OtherOrderError(Exception):
    """A header names the columns in another order, and not all of them are at hand."""


class WordLines:
    """Leaves out the lines of words that have as many cells as a row; below a header, columns go by the names it gives them.

    Attributes
    ----------
    remarks : int
        How many remarks were left out.
    removed : int
        How many lines were left out in all.
    ended : bool
        A header says that the columns are others from here on; what follows is no row of this table.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.remarks = 0
        self.removed = 0
        self.ended = False
        self._units = dict(zip(dialect.names, dialect.units, strict=True))
        self._comma = {n: w.decimal_comma for n, w in zip(dialect.names, dialect.notations, strict=True)}
        self._places = {
            name: name for name in dialect.names
        }  # of each column, the name that the first header has there
        self._headers = 0
        self._reordered = 0
        self._rows = 0
        self._end = ""

    def without(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Return a batch, the first column's cells among it, without lines of words.

        Raises
        ------
        OtherOrderError
            The columns change places, and not all of them are in the batch.
        """
        words = pc.fill_null(pc.match_substring_regex(batch.column(0), _WORD), False)
        told = pc.any(words).as_py()
        batch = self._below_headers(self._without_remarks(batch)) if told else self._by_name(batch)
        self._rows += batch.num_rows
        return batch

    def _without_remarks(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        remarks = pc.fill_null(pc.match_substring_regex(batch.column(0), _COMMENT), False)
        count = int(pc.sum(remarks).as_py() or 0)
        self.remarks += count
        self.removed += count
        return batch.filter(pc.invert(remarks)) if count else batch

    def _below_headers(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Leave out the header where it stands again, and all that follows one that names other columns."""
        parts: list[pa.RecordBatch] = []
        begin = 0
        for row, header in self._headers_in(batch):
            parts.append(self._by_name(batch.slice(begin, row - begin)))
            begin = row + 1
            places = self._places_by(header)
            if places is None or self._headers == _MOST_HEADERS:
                self.ended = True
                shown = printable_cell(", ".join(header.values()))
                self._end = (
                    f"row {self._rows + sum(part.num_rows for part in parts) + 1} on: a header there ('{shown}') "
                    + (
                        "is one too many of a recording"
                        if places
                        else "names other columns than the first, or other units"
                    )
                )
                break
            self._reordered += places != self._places
            self._places = places
            self._headers += 1
            self.removed += 1
        else:
            parts.append(self._by_name(batch.slice(begin)))
        columns = [pa.concat_arrays([part.column(i) for part in parts]) for i in range(batch.num_columns)]
        return pa.RecordBatch.from_arrays(columns, batch.schema.names)

    def _headers_in(self, batch: pa.RecordBatch) -> Iterator[tuple[int, dict[str, str]]]:
        """Yield the rows that hold names of columns and no values, and their cells by the first header's names."""
        first = batch.column(0)
        named = pa.array([cell for cell in pc.unique(first).to_pylist() if cell and self._is_named(cell)], pa.string())
        for row in pc.indices_nonzero(pc.is_in(first, named)).to_pylist() if len(named) else []:
            cells = {name: batch.column(name)[row].as_py() or "" for name in batch.schema.names}
            if not any(is_value(cell, self._comma[name]) for name, cell in cells.items() if cell):
                yield row, cells

    def _is_named(self, cell: str) -> bool:
        return _name(cell) in self._units

    def _places_by(self, header: dict[str, str]) -> dict[str, str] | None:
        """Return where each column lies below a header, None where these are other columns.

        Raises
        ------
        OtherOrderError
            Only some of its cells are known, and they are others than before.
        """
        if all(self._same(name, header[place]) for name, place in self._places.items() if place in header):
            return self._places
        if len(header) < len(self._units):
            raise OtherOrderError
        names = unique_names([_name(cell) for cell in header.values()])
        places = dict(zip(names, header, strict=True))
        if places.keys() != self._units.keys() or not all(self._same(name, header[at]) for name, at in places.items()):
            return None
        return {name: places[name] for name in self._units}

    def _same(self, name: str, cell: str) -> bool:
        """Tell whether a cell of a header names a column as the first header does, with the same unit."""
        unit = split_header(cell)[1]
        called = _name(cell)
        same = called == name or name.startswith(f"{called}#" if called else "column_")
        return same and (unit is None or unit == self._units[name])

    def _by_name(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Return rows with each column under its own name."""
        if not self._reordered:
            return batch
        names = batch.schema.names
        return pa.RecordBatch.from_arrays([batch.column(self._places[name]) for name in names], names)

    def notes(self) -> list[str]:
        """Return what to tell of headers."""
        notes = []
        if self._headers:
            again = f"{plural(self._headers, 'line')} between the rows skipped as the header once more"
            notes.append(
                again + ("; columns whose order it changes are read by their names" if self._reordered else "")
            )
        if self.ended:
            notes.append(f"left out from {self._end}; put what follows it into a file of its own")
        return notes


def _name(cell: str) -> str:
    return printable(split_header(cell.strip())[0]).strip()
