"""Lines of words between the rows of a text table: remarks, and the header once more, where a log was appended to another."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.compute as pc

from vsalog.printable import printable
from vsalog.readers.base import plural
from vsalog.readers.headers import printable_cell
from vsalog.readers.table_dialect import Dialect
from vsalog.readers.table_text import is_value
from vsalog.units import split_header

_WORD = r"^\s*[^\s\d.+-]"
_COMMENT = r"^\s*(#|%)"


class WordLines:
    """Leaves out the lines of words that have as many cells as a row.

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
        self._headers = 0
        self._rows = 0
        self._end = ""

    def without(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Return a batch, the first column's cells among it, without lines of words."""
        words = pc.fill_null(pc.match_substring_regex(batch.column(0), _WORD), False)
        if pc.any(words).as_py():
            batch = self._until_other_header(self._without_remarks(batch))
        self._rows += batch.num_rows
        return batch

    def _without_remarks(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        remarks = pc.fill_null(pc.match_substring_regex(batch.column(0), _COMMENT), False)
        count = int(pc.sum(remarks).as_py() or 0)
        self.remarks += count
        self.removed += count
        return batch.filter(pc.invert(remarks)) if count else batch

    def _until_other_header(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Leave out the header where it stands again, and all that follows one that names other columns."""
        first = batch.column(0)
        named = pa.array([cell for cell in pc.unique(first).to_pylist() if cell and self._is_named(cell)], pa.string())
        again: list[int] = []
        for row in pc.indices_nonzero(pc.is_in(first, named)).to_pylist() if len(named) else []:
            cells = {name: batch.column(name)[row].as_py() or "" for name in batch.schema.names}
            if any(is_value(cell, self._comma[name]) for name, cell in cells.items() if cell):
                continue
            if not all(self._same(name, cell) for name, cell in cells.items()):
                self.ended = True
                self._end = f"row {self._rows + row - len(again) + 1} on: a header there ('{_joined(cells)}')"
                batch = batch.slice(0, row)
                break
            again.append(row)
        self._headers += len(again)
        self.removed += len(again)
        return batch.take(_others(batch.num_rows, again)) if again else batch

    def _is_named(self, cell: str) -> bool:
        return _name(cell) in self._units

    def _same(self, name: str, cell: str) -> bool:
        """Tell whether a cell of a header names a column as the first header does, with the same unit."""
        unit = split_header(cell)[1]
        called = _name(cell)
        same = called == name or name.startswith(f"{called}#" if called else "column_")
        return same and (unit is None or unit == self._units[name])

    def notes(self) -> list[str]:
        """Return what to tell of headers."""
        notes = []
        if self._headers:
            notes.append(f"{plural(self._headers, 'line')} between the rows skipped as the header once more")
        if self.ended:
            notes.append(
                f"left out from {self._end} names the columns in another way than the first; put what follows it into a"
                " file of its own"
            )
        return notes


def _name(cell: str) -> str:
    return printable(split_header(cell.strip())[0]).strip()


def _joined(cells: dict[str, str]) -> str:
    return printable_cell(", ".join(cells.values()))


def _others(count: int, rows: list[int]) -> pa.Array:
    """Return the numbers of all rows but some."""
    left_out = set(rows)
    return pa.array([row for row in range(count) if row not in left_out], pa.int64())
