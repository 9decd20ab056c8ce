"""The rows of a text table, parsed into columns of text, and what of it is no row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv

from vsalog.core.errors import ReadError
from vsalog.core.finding import Evidence, Finding, Findings
from vsalog.readers.headers import printable_cell
from vsalog.readers.last_line import cut_off
from vsalog.readers.limits import DECODED_BYTES
from vsalog.readers.opened import is_text
from vsalog.readers.table_dialect import Dialect
from vsalog.readers.table_labels import without_labels
from vsalog.readers.table_notation import Notation
from vsalog.readers.table_quotes import heeding_quotes
from vsalog.readers.table_text import NULLS, WHITESPACE, is_comment, split
from vsalog.readers.table_words import OtherOrderError, WordLines
from vsalog.readers.text_source import BoundedGzip, TextSource, is_utf8, open_text


class Rows:
    """Parses a text table.

    Parameters
    ----------
    path : Path
        The file.
    dialect : Dialect
        How it is written.
    numbers : sequence of int
        Columns of numbers: a line's end in one of their cells is not meant.

    Attributes
    ----------
    findings : Findings
        What was left out; complete once all batches are read.
    """

    def __init__(self, path: Path, dialect: Dialect, numbers: Sequence[int]) -> None:
        self.findings = Findings()
        self._path = path
        self._dialect = dialect
        self._numbers = {dialect.names[i] for i in numbers}
        self._notations: dict[str, Notation] = {}
        self._grouped: dict[str, str] = {}
        self._known: set[int] = set()
        self._words = WordLines(dialect, self._known)
        self._odd = _OddLines(dialect, self._words)
        self._left_out: list[tuple[int, int]] = []  # at the end of each batch: rows parsed, and left out of them

    def batches(self, columns: Sequence[int]) -> Iterator[pa.RecordBatch]:
        """Yield the rows as text, numbers with a decimal point, some columns only.

        Raises
        ------
        ReadError
            The table cannot be parsed.
        """
        done = 0
        try:
            for batch in self._read(columns):
                yield batch
                done += batch.num_rows
            return
        except OtherOrderError:
            pass  # below a header all columns are needed to find some
        self._numbers &= self._chosen(columns)  # so that the rows are the same once more
        for batch in self._read(range(len(self._dialect.names))):
            yield batch.slice(min(done, batch.num_rows))
            done -= min(done, batch.num_rows)

    def _read(self, columns: Sequence[int]) -> Iterator[pa.RecordBatch]:
        """Yield the rows as `batches` does, of whatever was read before nothing is known.

        Raises
        ------
        OtherOrderError
            The columns change places, and not all of them are asked for.
        """
        self.findings.clear()
        self._grouped.clear()
        self._left_out.clear()
        self._words = WordLines(self._dialect, self._known)
        self._odd = _OddLines(self._dialect, self._words)
        names = self._dialect.names
        known = self._chosen(columns)
        chosen = [name for name in names if name in known]
        with open_text(self._path) as file:
            if not isinstance(file, BoundedGzip):  # a look at all of it would take long
                self._dialect = heeding_quotes(self._path, self._dialect)
            written = zip(names, self._dialect.notations, strict=True)
            self._notations = {name: notation for name, notation in written if notation != Notation()}
            text = TextSource(file, self._dialect.encoding, self._dialect.separator)
            try:
                with self._open(file, text, chosen) as reader:
                    parsed = 0
                    for batch in reader:
                        rows = self._without_run_on(self._words.without(self._without_labels(batch)))
                        parsed += batch.num_rows
                        self._left_out.append((parsed, self._words.removed + self._odd.run_on))
                        yield self._plain(rows)
                        if self._words.ended:
                            break
                    for rows in self._words.rest():
                        yield self._plain(self._without_run_on(rows))
            except pa.ArrowInvalid as error:
                raise ReadError(f"cannot be parsed as a table: {error}", self._path) from error
            except OSError as error:
                raise ReadError(f"cannot be read: {error.strerror or error}", self._path) from error
            if text.damage:
                self.findings.add(text.damage)
            if text.cut:
                self.findings.add(_cut(text.cut))
        self.findings.add(*self._marks())
        self._odd.remarks += self._words.remarks - self._words.odd_remarks
        self._odd.count -= self._words.odd
        self.findings.add(*self._words.findings(), *self._odd.findings())

    def _chosen(self, columns: Sequence[int]) -> set[str]:
        """Return the names of columns, of the first that tells which rows are remarks, and of what tells words from values."""
        return {*(self._dialect.names[i] for i in (0, *columns)), *self._words.needed}

    @property
    def first_odd(self) -> int | None:
        """How many rows at least are ahead of the first line with too many or too few cells; None without one so far."""
        first = self._odd.first
        return None if first is None else first - max((left for end, left in self._left_out if end <= first), default=0)

    def _open(self, file: IO[bytes], text: TextSource, chosen: list[str]) -> pacsv.CSVStreamingReader:
        dialect = self._dialect
        plain = dialect.encoding == "utf-8" and dialect.separator != WHITESPACE and not isinstance(file, BoundedGzip)
        source: Any = text
        if plain and is_utf8(file):  # else Arrow could not tell of a line that it is no row
            # Arrow reads ahead in a thread of its own. It must not need the interpreter, which may be gone by then at exit.
            source = self._without_cut_line() if is_text(self._path) else file
        return pacsv.open_csv(
            source,
            read_options=pacsv.ReadOptions(
                use_threads=False,
                block_size=DECODED_BYTES,
                skip_rows=dialect.skip_lines,
                column_names=list(dialect.names),
            ),
            parse_options=pacsv.ParseOptions(
                delimiter=dialect.separator,
                # In a table without quotes one is damage, and would swallow the lines up to the next.
                quote_char='"' if dialect.quoted else False,
                invalid_row_handler=self._odd.handle,
            ),
            convert_options=pacsv.ConvertOptions(
                include_columns=chosen,
                column_types=dict.fromkeys(chosen, pa.string()),
                strings_can_be_null=True,
                quoted_strings_can_be_null=True,
                null_values=list(NULLS),
                check_utf8=False,
            ),
        )

    def _without_cut_line(self) -> pa.NativeFile:
        """Return the file, without a last line that is not whole.

        It is read rather than mapped: another process may make it shorter, which ends one that has mapped it.
        """
        file = pa.OSFile(str(self._path))
        last = cut_off(self._path, self._dialect.separator)
        if not last:
            return file
        self.findings.add(_cut(last.decode("utf-8", "replace")))
        return file.get_stream(0, file.size() - len(last))

    def _without_labels(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Leave out what stands ahead of the number in every cell."""
        if not self._dialect.labels:
            return batch
        labels = dict(zip(self._dialect.names, self._dialect.labels, strict=True))
        names = batch.schema.names
        return pa.RecordBatch.from_arrays([without_labels(batch.column(name), labels[name]) for name in names], names)

    def _without_run_on(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Leave out rows that a stray quote runs into one another."""
        if not self._dialect.quoted:
            return batch
        run_on = np.zeros(batch.num_rows, dtype=np.bool_)
        for name in self._numbers.intersection(batch.schema.names):
            found = pc.fill_null(pc.match_substring(batch.column(name), "\n"), False)
            run_on |= np.asarray(found.to_numpy(zero_copy_only=False), np.bool_)
        self._odd.run_on += int(np.count_nonzero(run_on))
        return batch.filter(pa.array(~run_on)) if run_on.any() else batch

    def _plain(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """Write numbers as programs do."""
        columns = []
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            notation = self._notations.get(name)
            if notation is not None:
                column, grouped = notation.plain(column)
                if grouped and name not in self._grouped:
                    self._grouped[name] = grouped
            columns.append(column)
        return pa.RecordBatch.from_arrays(columns, batch.schema.names) if self._notations else batch

    def _marks(self) -> Iterator[Finding]:
        """Yield what commas and points in numbers were taken for, where they may be something else."""
        for name, cell in self._grouped.items():
            notation = self._notations[name]
            mark = "." if notation.decimal_comma else ","
            if notation.fraction and "," not in cell:
                use = "a decimal mark, for every number ahead has one"
            else:
                use = "setting thousands apart"
            evidence = {"mark": mark, "cell": printable_cell(cell), "read_as": use}
            yield Finding(code="table.marks_in_numbers", part=name, evidence=evidence)


def _cut(line: str) -> Finding:
    return Finding(code="table.last_line_left_out", evidence={"line": printable_cell(line)})


class _OddLines:
    """Counts lines that are no rows: with too many or too few cells, and remarks.

    Attributes
    ----------
    first : int or None
        How many rows were parsed ahead of the first that has too many or too few cells.
    """

    def __init__(self, dialect: Dialect, words: WordLines) -> None:
        self._words = words
        self.first: int | None = None
        self._lines = dialect.skip_lines + 1
        self._separator = dialect.separator
        self._width = len(dialect.names)
        self.count = 0
        self.remarks = 0
        self.run_on = 0
        self.quoted = 0
        self.example = ""

    def handle(self, row: Any) -> str:
        """Skip a line."""
        text = str(row.text or "")
        if row.number is not None:
            self._words.odd_line(text, int(row.number) - self._lines)
        if is_comment(text):
            self.remarks += 1
        else:
            self.count += 1
            self.quoted += '"' in text and len(split(text, self._separator)) == self._width
            self.example = self.example or text
            if self.first is None and row.number is not None:
                self.first = int(row.number) - self._lines
        self._lines += 1
        return "skip"

    def findings(self) -> list[Finding]:
        """Return what was skipped."""
        lines: Evidence = {"cells": self._width, "first": printable_cell(self.example)}
        found = (
            Finding(code="table.remarks", value=self.remarks),
            Finding(code="table.stray_quotes", value=self.run_on),
            Finding(code="table.quoted_lines_skipped", value=self.quoted),
            Finding(code="table.lines_skipped", value=self.count - self.quoted, evidence=lines),
        )
        return [one for one in found if one.value and one.value > 0]
