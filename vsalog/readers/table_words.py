"""Lines of words between the rows of a text table: remarks, and headers, where a log was appended to another."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vsalog.core.finding import Finding, Findings
from vsalog.readers.headers import printable_cell
from vsalog.readers.limits import BLOCK_ROWS, FIRST_ROWS
from vsalog.readers.repeated_header import FirstHeader, Line, Order, goes_on, listed_columns, rescaled
from vsalog.readers.table_dialect import Dialect
from vsalog.readers.table_header import is_clock

_WORD = r"^\s*([^\s\d.+-]|\d+_)"
_NO_NUMBER = r"^\s*(?i:nan|inf|infinity)\s*$"
_DIGITS = b"0123456789.+-"
_NO_TIME = re.compile(r"\D*$")
_COMMENT = r"^\s*(#|%)"


class OtherOrderError(Exception):
    """A line may be a header that names the columns in another order, and not all of them are at hand."""


class _Found(NamedTuple):
    """A line of words or a remark: the row ahead of which it stands, or which it is itself."""

    row: int
    inside: bool
    line: Line | None
    remark: bool


class WordLines:
    """Leaves out remarks and headers; below a header, columns go by the names and units it gives them.

    Parameters
    ----------
    dialect : Dialect
        How the table is written.
    known : set of int
        Rows, as they were parsed, that are the header once more; those that are found to be so are added.

    Attributes
    ----------
    remarks : int
        How many remarks were left out.
    removed : int
        How many rows were left out in all.
    odd : int
        How many of the lines given to `odd_line` were headers.
    odd_remarks : int
        How many of them were in remarks.
    ended : bool
        There are too many headers; what follows is no row of this table.
    """

    def __init__(self, dialect: Dialect, known: set[int]) -> None:
        self.remarks = self.removed = self.odd = self.odd_remarks = 0
        self.ended = False
        self._known = known
        self._notations = dict(zip(dialect.names, dialect.notations, strict=True))
        self._first = FirstHeader(dialect)
        self._clock = next((name for name in self._first.values if is_clock(name)), "")
        self._ahead: list[str] = []  # its last cells so far
        self._order: Order | None = self._first.as_above
        self._odd: list[tuple[int, Line]] = []
        self._held: pa.RecordBatch | None = None
        self._parsed = self._rows = self._lines = self._headers = 0
        self._reordered = False
        self._scaled: dict[str, None] = {}
        self._findings = Findings()
        self._ends: Finding | None = None

    @property
    def needed(self) -> tuple[str, ...]:
        """Names of columns without which no header is found."""
        return (*self._first.values[:1], *([self._clock] if self._clock else []))

    def odd_line(self, text: str, parsed: int) -> None:
        """Heed a line that has not as many cells as a row, behind so many rows parsed."""
        line = self._first.line(text)
        if line is not None and len(self._odd) <= BLOCK_ROWS:
            self._odd.append((parsed, line))

    def without(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Return a batch, the first column's cells among it, without lines of words.

        Those at its end are held back, for whether they are a header those tell that follow.

        Raises
        ------
        OtherOrderError
            The columns may change places, and not all of them are in the batch.
        """
        if self._held is not None:
            batch, self._held = _joined([self._held, batch]), None
        return self._sorted_out(batch, True)

    def rest(self) -> list[pa.RecordBatch]:
        """Return what was held back of the last batch, once there is no other."""
        return [] if self._held is None or self.ended else [self._sorted_out(self._held, False)]

    def _sorted_out(self, batch: pa.RecordBatch, more: bool) -> pa.RecordBatch:
        parts: list[pa.RecordBatch] = []
        begin, end = 0, batch.num_rows
        for run in _runs(self._found(batch)):
            first, last = run[0].row, run[-1].row + run[-1].inside
            if more and last == end and len(run) < FIRST_ROWS:
                self._odd = [
                    (self._parsed + one.row, one.line) for one in run if one.line and not one.inside
                ] + self._odd
                self._held, end = batch.slice(first), first
                break
            parts += self._ordered(batch.slice(begin, first - begin))
            parts += self._settled(batch, run)
            begin = last
            if self.ended:
                end = begin
                break
        parts += self._ordered(batch.slice(begin, end - begin))
        self._parsed += end
        return _joined(parts) if parts else batch.slice(0, 0)

    def _found(self, batch: pa.RecordBatch) -> list[_Found]:
        """Return the lines of words and the remarks of a batch in order, those that are no rows among them."""
        end = self._parsed + batch.num_rows
        found = [_Found(at - self._parsed, False, line, line.remark) for at, line in self._odd if at < end]
        self._odd = [(at, line) for at, line in self._odd if at >= end]
        first = batch.column(0)
        words = not _all_digits(first) and pc.any(pc.match_substring_regex(first, _WORD)).as_py()
        if words or first.null_count or batch.schema.names[0] not in self._first.values:
            remarks = pc.fill_null(pc.match_substring_regex(first, _COMMENT), False)
            for row in pc.indices_nonzero(pc.or_(remarks, self._wordy(batch))).to_pylist():
                remark = remarks[row].as_py()
                line = self._line(batch, row, remark)
                if remark or line is not None:
                    found.append(_Found(row, True, line, remark))
        return sorted(found, key=lambda one: (one.row, one.inside))

    def _wordy(self, batch: pa.RecordBatch) -> pa.Array:
        """Return which rows have no value in any column of values."""
        at_hand = [name for name in self._first.values if name in batch.schema.names]
        wordy = pa.array(np.full(batch.num_rows, bool(at_hand)))
        for name in at_hand:
            cells = batch.column(name)
            wordy = pc.and_(wordy, pc.fill_null(pc.match_substring_regex(cells, _WORD), True))
            if not pc.any(wordy).as_py():
                break
            wordy = pc.and_not(wordy, pc.fill_null(pc.match_substring_regex(cells, _NO_NUMBER), False))
        return wordy

    def _line(self, batch: pa.RecordBatch, row: int, remark: bool) -> Line | None:
        """Return a row as a header may be, None where it can be none."""
        return self._first.row(
            {
                i: (batch.column(n)[row].as_py() or "").strip()
                for i, n in enumerate(self._notations)
                if n in batch.schema.names
            },
            remark,
        )

    def _settled(self, batch: pa.RecordBatch, run: list[_Found]) -> list[pa.RecordBatch]:
        """Go by what lines that follow one another say; return those that are rows after all."""
        lines = [one.line for one in run if one.line is not None][-FIRST_ROWS:]
        inside = [one for one in run if one.inside]
        again = self._order_of(run, lines)
        further = self._goes_on(batch, run[-1].row + run[-1].inside)
        if again is None and not self._first.names_others(lines, further):
            self._leave(sum(one.remark for one in inside), 0)
            return [part for one in inside if not one.remark for part in self._ordered(batch.slice(one.row, 1))]
        self._leave(sum(one.remark and one.line is None for one in inside), sum(one.line is not None for one in inside))
        odd = [one for one in run if one.line is not None and not (one.inside or one.line.behind)]
        self.odd += sum(not one.remark for one in odd)
        self.odd_remarks += sum(one.remark for one in odd)
        self._lines += len(run)
        self.ended = self._lines > BLOCK_ROWS
        self._go_by(None if self.ended else again, lines)
        return []

    def _goes_on(self, batch: pa.RecordBatch, row: int) -> bool | None:
        """Tell whether the clock goes on in a row as in those ahead; None where nobody knows."""
        if self._order is None or not self._clock or len(self._ahead) < 2 or row >= batch.num_rows:
            return None
        earlier, before = self._ahead
        cells = batch.column(self._order.places[self._clock])[row : row + FIRST_ROWS].to_pylist()
        after = next((cell for cell in cells if cell and not _NO_TIME.match(cell)), None)
        return None if after is None else goes_on(earlier, before, after)

    def _leave(self, remarks: int, others: int) -> None:
        self.remarks += remarks
        self.removed += remarks + others

    def _order_of(self, run: list[_Found], lines: list[Line]) -> Order | None:
        """Return what the header among lines that follow one another says, None where there is none.

        Raises
        ------
        OtherOrderError
            Not all of its cells are at hand, or not all of the columns whose places it changes.
        """
        inside = [one for one in run if one.inside and one.line is not None]
        if any(self._parsed + one.row in self._known for one in inside):
            return self._first.as_above
        if all(self._first.whole(line) for line in lines):
            return self._first.order(lines)
        if len(lines) > 1 or lines[0].remark or not self._first.same(lines[0]):
            raise OtherOrderError
        self._known.add(self._parsed + inside[0].row)
        return self._first.as_above

    def _go_by(self, order: Order | None, lines: list[Line]) -> None:
        """Read what follows by what a header says of it, or leave it out."""
        self._order = order
        if order is None:
            shown = next((line for line in lines if self._first.names_others([line], False)), lines[-1])
            self._ends = self._ends or Finding(
                code="table.too_many_headers" if self.ended else "table.other_table",
                value=self._rows + 1,
                evidence={"header": printable_cell(", ".join(shown.texts))},
            )
            return
        self._headers += 1
        self._reordered |= order.places != self._first.as_above.places
        self._findings.add(*order.findings)
        self._scaled |= dict.fromkeys(order.factors)

    def _ordered(self, batch: pa.RecordBatch) -> list[pa.RecordBatch]:
        """Return rows with each column under its own name and in its own unit, none where they are of another table."""
        self._rows += batch.num_rows
        if self._order is None:
            self.removed += batch.num_rows
            return []
        if not batch.num_rows:
            return [batch]
        if self._order != self._first.as_above:
            batch = self._by_name(batch, self._order)
        if self._clock:
            last = batch.column(self._clock)[-FIRST_ROWS:].to_pylist()
            self._ahead = [*self._ahead, *(cell for cell in last if cell and not _NO_TIME.match(cell))][-2:]
        return [batch]

    def _by_name(self, batch: pa.RecordBatch, order: Order) -> pa.RecordBatch:
        names = batch.schema.names
        places, factors, _ = order
        if any(places[name] not in names for name in names):
            raise OtherOrderError
        columns = [batch.column(places[name]) for name in names]
        columns = [
            rescaled(cells, factors[name], self._notations[name]) if name in factors else cells
            for name, cells in zip(names, columns, strict=True)
        ]
        return pa.RecordBatch.from_arrays(columns, names)

    def findings(self) -> list[Finding]:
        """Return what to tell of headers."""
        found = []
        if self._headers:
            found.append(Finding(code="table.header_again", value=self._headers))
        if self._reordered:
            found.append(Finding(code="table.columns_reordered"))
        if self._scaled:
            evidence = {"columns": listed_columns(self._scaled)}
            found.append(Finding(code="table.units_converted", value=len(self._scaled), evidence=evidence))
        return [*found, *self._findings, *([self._ends] if self._ends else [])]


def _all_digits(cells: pa.Array) -> bool:
    """Tell whether there is nothing in cells but numbers without exponents; many times as fast as regular expressions."""
    text = cells.buffers()[2]
    return text is None or not text.to_pybytes().translate(None, _DIGITS)


def _runs(found: Iterable[_Found]) -> Iterator[list[_Found]]:
    """Yield lines that follow one another, with no row between them."""
    run: list[_Found] = []
    for one in found:
        if run and one.row > run[-1].row + run[-1].inside:
            yield run
            run = []
        run.append(one)
    if run:
        yield run


def _joined(parts: list[pa.RecordBatch]) -> pa.RecordBatch:
    """Return parts of one table as one."""
    if len(parts) == 1:
        return parts[0]
    names = parts[0].schema.names
    return pa.RecordBatch.from_arrays([pa.concat_arrays([part.column(n) for part in parts]) for n in names], names)
