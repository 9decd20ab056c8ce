"""Reads text tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import pyarrow as pa
import pyarrow.compute as pc

from vsalog.core.errors import ReadError
from vsalog.core.memory import PIECE_BYTES
from vsalog.core.printable import plural
from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.limits import DECODED_BYTES, SAMPLE_ROWS
from vsalog.readers.tables.cells import Cells, elements_of, numbers_and_words, with_points
from vsalog.readers.tables.columnar import Batch, ColumnarReader
from vsalog.readers.tables.dialect import Dialect, detect
from vsalog.readers.tables.rows import Rows
from vsalog.readers.tables.source import BoundedGzip, open_text, read_beginning
from vsalog.readers.tables.text import NULLS
from vsalog.readers.tables.time_columns import digits_of, find_clocks
from vsalog.readers.tables.time_numbers import is_exact


class TableReader(ColumnarReader):
    """Reads a text table; see `vsalog.readers.base.Reader`.

    Parameters
    ----------
    path : Path
        The file, plain or compressed with gzip.
    rate : float or None
        Samples per second [Hz], for a table without a time column.
    thorough : bool
        Read all of a column where its first rows are ambiguous.
    units : mapping of str to str
        Units of columns whose headers state none.

    Raises
    ------
    ReadError
        The file cannot be opened or has no rows of values.
    """

    format = "csv"

    def __init__(
        self,
        path: Path,
        rate: float | None,
        thorough: bool = True,
        units: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        super().__init__(path, rate, units)
        self._compressed = False
        self._thorough = thorough
        self._dialect = self._detect()
        self._names, self._units = self._dialect.names, self._with_given(self._dialect.names, self._dialect.units)
        self._sample = _sample_columns(self._dialect)
        counts = [numbers_and_words(column) for column in self._sample]
        self._kinds = {i: pa.float64() for i, (good, words) in enumerate(counts) if good > words}
        self._digits: dict[int, int] = {}
        plan = find_clocks(self._names, self._units, self._sample, self._all_cells, by_rise=rate is None)
        clocks = plan.columns()
        lists = {i: elements_of(column) for i, column in enumerate(self._sample) if counts[i][1] and i not in clocks}
        self._lists = {i: [f"{self._names[i]}[{k}]" for k in range(count)] for i, count in lists.items() if count}
        if not self._lists and not any(good and (clocks or good > words) for good, words in counts):
            raise ReadError("contains text, but no table: none of its columns has numbers", path)
        self._interpret(plan, range(len(self._names)))
        taken = self._not_channels()
        self._kinds = {i: kind for i, kind in self._kinds.items() if i not in taken} | self._kinds_of_clocks()

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

    def _batches(self, columns: Sequence[int], required: Collection[int]) -> Iterator[Batch]:
        self.findings.add(*self._dialect.findings)
        rows = Rows(self.path, self._dialect, self._kinds, self._digits)
        row = 0
        for batch in rows.batches(columns):
            yield Batch(row, batch.num_rows, dict(zip(columns, batch.columns, strict=True)), rows.expected)
            row += batch.num_rows
        self.findings.add(*rows.findings)

    def _whole(self, columns: Sequence[int]) -> Iterator[list[pa.Array]]:
        if not self._thorough:
            yield [self._sample[i] for i in columns]
            return
        others = {i: kind for i, kind in self._kinds.items() if i not in columns}
        for batch in Rows(self.path, self._dialect, others).batches(columns):
            yield batch.columns

    def _all_cells(self, column: int) -> Iterator[pa.Array]:
        """Yield all of a column, part by part; nothing where its first rows must suffice."""
        if self._thorough:
            yield from (cells for (cells,) in self._whole([column]))

    def _where(self, row: int) -> str:
        return f"line {self._dialect.lines[row]}"

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
            raise ReadError("contains text, but no table: no row of values was found", self.path)
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
    def dialect(self) -> Dialect:
        """The dialect of the text."""
        return self._dialect

    @property
    def seekable(self) -> bool:
        """Whether lines can be found from anywhere in the file: it is not compressed, and a line's end is one byte."""
        return not self._compressed and not self._dialect.encoding.startswith("utf-16")


def _too_many_columns(head: bytes) -> str:
    """Return how many columns the first lines have, "" where they are not too many: reading all of them takes long."""
    *lines, last = head.split(b"\n")
    lines = [line for line in lines[:SAMPLE_ROWS] if line.strip() and not line.lstrip().startswith((b"#", b"%"))]
    fewest = min(lines, key=len, default=last)
    count = max(len(fewest.split()), *(fewest.count(mark) + 1 for mark in (b",", b";", b"\t", b"|")))
    quotes = 10 if b'"' in fewest else 1  # which may contain such marks
    return "" if count <= quotes * MAX_FIELDS else f"{count}" if lines else f"more than {count}"


def _sample_columns(dialect: Dialect) -> list[pa.Array]:
    """Return the columns' first cells as text, numbers with a decimal point."""
    columns = ([row[i] if row[i] not in NULLS else None for row in dialect.rows] for i in range(len(dialect.names)))
    return [with_points(pa.array(cells, pa.string()), dialect.decimal_comma) for cells in columns]
