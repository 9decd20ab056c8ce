"""The rows of a text table, block by block: numbers as numbers, and lines that are no rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
from numpy.typing import NDArray

from vsalog.core.errors import ReadError
from vsalog.core.finding import Evidence, Finding, Findings
from vsalog.core.memory import PIECE_BYTES
from vsalog.readers.limits import BLOCK_ROWS, SAMPLE_ROWS
from vsalog.readers.tables.cells import numbers_in, too_large, with_points
from vsalog.readers.tables.dialect import Dialect
from vsalog.readers.tables.header import names_a_clock
from vsalog.readers.tables.source import BoundedGzip, Lines, open_text, trouble_at_end
from vsalog.readers.tables.text import NULLS, has_quotes, is_comment, printable_cell, split
from vsalog.readers.tables.time_numbers import is_exact

_COMMENT = r"^\s*(#|%)"


class Rows:
    """Parses a text table.

    A block whose cells all have the types of their columns is parsed into numbers at once. Of any other, all columns
    are parsed as text, to separate remarks, repeated headers and lines that are no rows from bad cells.

    Parameters
    ----------
    path : Path
        The file.
    dialect : Dialect
        Its dialect.
    kinds : mapping of int to pyarrow type
        Of the columns of numbers; the others are text.
    digits : mapping of int to int
        Column → number of decimals, for columns of decimal numbers that must be exact.

    Attributes
    ----------
    findings : Findings
        Findings about what was left out; complete once all batches are read.
    expected : int
        The number of rows, estimated from the first block; 0 where the file is compressed.
    """

    def __init__(
        self, path: Path, dialect: Dialect, kinds: Mapping[int, pa.DataType], digits: Mapping[int, int] | None = None
    ) -> None:
        self.findings = Findings()
        self._path = path
        self._dialect = dialect
        self._kinds = kinds
        self._header = [_bare(row) for row in dialect.header]
        self._digits = digits or {}
        self.expected = 0
        self._quoted = dialect.quoted
        # Searching words for "no number" takes as long as parsing the numbers.
        words = any(cell and cell in NULLS for row in dialect.rows for cell in row)
        self._nulls = [*NULLS] if words else [""]
        self._whole = {i for i in kinds if any(row[i].lstrip("+-").isdigit() for row in dialect.rows)}
        self._packed = False
        self._count: dict[str, int] = {}
        self._example = ""
        self._rows = 0
        self._elsewhere = False  # below the header of another table
        self._other: Finding | None = None
        self._ended = False

    def batches(self, columns: Sequence[int]) -> Iterator[pa.RecordBatch]:
        """Yield the rows of some columns; numbers that came as text are written with a decimal point.

        Raises
        ------
        ReadError
            The table cannot be parsed.
        """
        dialect = self._dialect
        skip = dialect.skip_lines
        try:
            with open_text(self._path) as file:
                self._packed = isinstance(file, BoundedGzip)
                lines = Lines(file, dialect.encoding, dialect.separator, dialect.labels)
                for block, quotes in lines.blocks():
                    self._quoted = self._quoted or (quotes and self._has_quotes(block, skip))
                    batch = None if self._elsewhere else self._at_once(block, columns, skip)
                    if batch is None:
                        batch = self._carefully(block, columns, skip)
                    skip = 0
                    if not self._packed and not self.expected:
                        self.expected = batch.num_rows * self._path.stat().st_size // max(block.size, 1)
                    self._rows += batch.num_rows
                    yield batch
                    if self._ended:
                        return
                self.findings.add(*lines.findings)
        except pa.ArrowInvalid as error:
            raise ReadError(f"cannot be parsed as a table: {error}", self._path) from error
        except OSError as error:
            raise ReadError(f"cannot be read: {error.strerror or error}", self._path) from error
        self._note()

    def _has_quotes(self, block: pa.Buffer, skip: int) -> bool:
        """Return whether quotes enclose cells: in a table without them one is damage, and would join lines."""
        lines = [line.decode() for line in block.to_pybytes().splitlines()[skip:] if b'"' in line][:SAMPLE_ROWS]
        width = len(self._dialect.names)
        fitting = sum(has_quotes(line) and len(split(line, self._dialect.separator)) == width for line in lines)
        return 2 * fitting > len(lines)

    def _at_once(self, block: pa.Buffer, columns: Sequence[int], skip: int) -> pa.RecordBatch | None:
        """Return a block as numbers, None where a cell is none, a line is no row, or floating point would round."""
        looked_at = {0, *columns, *([] if self._kinds.keys() & {*columns} else [*self._kinds][:1])}
        try:
            batch = self._table(block, {i: self._kinds.get(i, pa.string()) for i in looked_at}, skip)
        except pa.ArrowInvalid:
            return None
        names = self._dialect.names
        if 0 not in self._kinds and pc.any(pc.match_substring_regex(batch.column(names[0]), _COMMENT)).as_py():
            return None
        for i, kind in self._kinds.items():
            if not pa.types.is_floating(kind) or names[i] not in batch.schema.names:
                continue
            cells = batch.column(names[i])
            if i in self._digits:
                if not is_exact(cells, self._digits[i]):
                    return None
            elif i in self._whole and not _whole_numbers_hold(cells):
                return None
        return batch.select([names[i] for i in columns])

    def _table(
        self, block: pa.Buffer, kinds: Mapping[int, pa.DataType], skip: int, odd: list[tuple[int, str]] | None = None
    ) -> pa.RecordBatch:
        """Parse a block; lines that are no rows are appended to `odd`, or refused where it is not given."""
        names = self._dialect.names

        def handle(row: Any) -> str:
            assert odd is not None
            odd.append((int(row.number) - 1 - skip - len(odd), str(row.text or "")))
            return "skip"

        included = [names[i] for i in sorted(kinds)]
        table = pacsv.read_csv(
            pa.BufferReader(block),
            read_options=pacsv.ReadOptions(
                # Pieces are parsed in threads, of which odd lines would have no numbers; a line longer than one is no number's.
                use_threads=odd is None,
                block_size=PIECE_BYTES if odd is None else block.size + 1,
                skip_rows=skip,
                column_names=list(names),
            ),
            parse_options=pacsv.ParseOptions(
                delimiter=self._dialect.separator,
                quote_char='"' if self._quoted else False,
                newlines_in_values=self._quoted,
                invalid_row_handler=None if odd is None else handle,
            ),
            convert_options=pacsv.ConvertOptions(
                include_columns=included,
                column_types={names[i]: kind for i, kind in kinds.items()},
                strings_can_be_null=True,
                quoted_strings_can_be_null=True,
                null_values=self._nulls if odd is None else [*NULLS],
                decimal_point="," if self._dialect.decimal_comma else ".",
                check_utf8=False,
            ),
        )
        return _one_batch(table)

    def _carefully(self, block: pa.Buffer, columns: Sequence[int], skip: int) -> pa.RecordBatch:
        """Return the rows of a block as text, without those that are none."""
        odd: list[tuple[int, str]] = []
        names = self._dialect.names
        batch = self._table(block, dict.fromkeys(range(len(names)), pa.string()), skip, odd)
        kept = np.ones(batch.num_rows, bool)
        remarks = _true(pc.match_substring_regex(batch.column(0), _COMMENT))
        kept &= ~remarks
        numbers = {i: batch.column(i) for i in self._kinds}
        if self._quoted:
            run_on = np.zeros(batch.num_rows, bool)
            for cells in numbers.values():
                run_on |= _true(pc.match_substring(cells, "\n"))
            self._add("table.stray_quotes", int(np.count_nonzero(run_on & kept)))
            kept &= ~run_on
        numbers = {i: with_points(cells, self._dialect.decimal_comma) for i, cells in numbers.items()}
        for i, cells in numbers.items():
            batch = batch.set_column(i, names[i], cells)
        wrong, wordy = _wrong(numbers, batch.num_rows)
        lines = np.flatnonzero((wordy & kept) | remarks)
        self._add("table.remarks", int(np.count_nonzero(remarks[lines[BLOCK_ROWS:]])))
        kept &= self._without_headers(batch, lines[:BLOCK_ROWS], odd)
        if self._packed:
            kept &= self._without_damage(wrong & kept, [at for at, text in odd if not is_comment(text)], batch.num_rows)
        return batch.select([names[i] for i in columns]).filter(pa.array(kept))

    def _without_headers(
        self, batch: pa.RecordBatch, wordy: NDArray[np.intp], odd: Sequence[tuple[int, str]]
    ) -> NDArray[np.bool_]:
        """Return which rows are of this table: no header, nor below that of another; count lines that are no rows.

        Parameters
        ----------
        batch : RecordBatch
            All columns.
        wordy : int array
            Rows without a number.
        odd : sequence of (int, str)
            Lines that are no rows, and how many rows are ahead of each.
        """
        lines = [(at, 0, text, split(text, self._dialect.separator)) for at, text in odd]
        for at in wordy.tolist():
            cells = [(column[at].as_py() or "").strip() for column in batch.columns]
            lines.append((at, 1, cells[0], cells))
        kept = np.ones(batch.num_rows, bool)
        begin = 0
        for at, inside, text, cells in sorted(lines, key=lambda line: line[:2]):
            remark = is_comment(text)
            bare = _bare(cells)
            own = bare in self._header
            other = not own and (sorted(bare) in map(sorted, self._header) if remark else names_a_clock(cells))
            other = other and not self._dialect.labels  # such a table has no header
            if own or remark:
                self._add("table.header_again" if own else "table.remarks", 1)
            elif not other and not inside:
                self._add("table.lines_skipped", 1)
                self._example = self._example or text
            if not own and not other:
                continue
            if self._elsewhere:
                kept[begin:at] = False
            kept[at : at + inside] = False
            begin, self._elsewhere = at + inside, other
            if other and self._other is None:
                header = printable_cell(", ".join(cell for cell in cells if cell))
                row = self._rows + int(np.count_nonzero(kept[:at])) + 1
                self._other = Finding(code="table.other_table", value=row, evidence={"header": header})
        if self._elsewhere:
            kept[begin:] = False
        return kept

    def _without_damage(self, wrong: NDArray[np.bool_], odd: Sequence[int], rows: int) -> NDArray[np.bool_]:
        """Return which rows are before damage: after a changed byte, the decompressed data of a file are invalid.

        Only the checksum at its end shows whether bytes have changed; without the end this is unknown.
        """
        first = min([*odd, *np.flatnonzero(wrong)[:1].tolist()], default=None)
        kept = np.ones(rows, bool)
        if first is None or not (trouble := trouble_at_end(self._path)):
            return kept
        code = "compressed.rows_doubtful" if trouble == "missing" else "compressed.rows_left_out"
        self.findings.clear()
        self.findings.append(Finding(code=code, value=self._rows + first + 1))
        self._ended = True
        kept[first:] = False
        return kept

    def _add(self, code: str, count: int) -> None:
        self._count[code] = self._count.get(code, 0) + count

    def _note(self) -> None:
        """Record the findings about what was left out."""
        lines: Evidence = {"cells": len(self._dialect.names), "first": printable_cell(self._example)}
        for code in ("table.remarks", "table.stray_quotes", "table.lines_skipped", "table.header_again"):
            if count := self._count.get(code):
                evidence = lines if code == "table.lines_skipped" else {}
                self.findings.append(Finding(code=code, value=count, evidence=evidence))
        if self._other is not None:
            self.findings.append(self._other)


def _whole_numbers_hold(cells: pa.Array) -> bool:
    """Return whether floating point holds all whole numbers of the cells' size."""
    ends = np.array([one for one in pc.min_max(cells).as_py().values() if one is not None])
    return not (too_large(ends) & np.isfinite(ends)).any()


def _wrong(numbers: Mapping[int, pa.Array], rows: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which rows have a word where a number belongs, and which of them have no number at all."""
    some, none = np.zeros(rows, bool), np.ones(rows, bool)
    for cells in numbers.values():
        found, wrong = numbers_in(cells)
        none &= _true(pc.is_null(found))
        some |= False if wrong is None else wrong
    return some, none & some


def _true(found: pa.Array) -> NDArray[np.bool_]:
    return np.array(pc.fill_null(found, False).to_numpy(zero_copy_only=False), bool)


def _bare(cells: Sequence[str]) -> list[str]:
    """Return cells without quotes, the sign of a remark, and blank ones at the end."""
    found = [cell.strip('" ') for cell in cells]
    found[0] = found[0].lstrip("#% ") if is_comment(found[0]) else found[0]
    while found and not found[-1]:
        found.pop()
    return found


def _one_batch(table: pa.Table) -> pa.RecordBatch:
    columns = [column.combine_chunks() for column in table.columns]
    return pa.RecordBatch.from_arrays(columns, table.schema.names)
