"""The rows of a Parquet file, whatever of it is damaged: a column that is lost somewhere takes no other one along."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import pyarrow as pa

from vsalog.core.column import PART
from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.printable import plural, printable
from vsalog.readers.compression import MAX_RATIO
from vsalog.readers.limits import BLOCK_ROWS, SAMPLE_ROWS
from vsalog.readers.parquet_footer import row_groups
from vsalog.readers.parquet_opened import open_parquet
from vsalog.readers.parquet_pages import trouble_with_pages
from vsalog.readers.tables.text import printable_cell

_UNREADABLE = (pa.ArrowException, OSError)


class ParquetRows:
    """A Parquet file as batches of rows; cells that cannot be read are null, and `findings` tells which.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    ReadError
        Its footer announces more than any recording has.
    ArrowException, OSError, UnicodeError
        It cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file, damage = open_parquet(path)
        self.schema = self.file.schema_arrow
        self.findings = Findings(damage)
        self.groups = row_groups(path)
        if len(self.groups) != self.file.num_row_groups:
            raise OSError("its footer, which tells where everything lies, is damaged")
        self._refuse_bombs()
        self._sizes = [max(group.rows, 0) for group in self.groups]
        self._bad = self._bad_pages()

    @property
    def sound(self) -> bool:
        """Whether the headers of all pages are as they should be; their contents were not looked at."""
        return not self._bad

    def sample(self) -> list[pa.Array | None]:
        """Return the first rows of each column that can be read, None for one of which none can; no columns without rows."""
        names = self.schema.names
        found: list[pa.Array | None] = [None] * len(names)
        for number, rows in enumerate(self._sizes):
            if rows:
                lost = _Lost(rows)
                batch = next(self._column_by_column(number, names, 0, lost, min(rows, SAMPLE_ROWS)))
                for i, name in enumerate(names):
                    if found[i] is None and name not in lost.reasons:
                        found[i] = batch.column(i)
            if all(cells is not None for cells in found):
                break
        shortest = min((len(cells) for cells in found if cells is not None), default=0)
        return [None if cells is None else cells[:shortest] for cells in found] if any(self._sizes) else []

    def batches(self, columns: list[str], required: Collection[str]) -> Iterator[tuple[int, pa.RecordBatch]]:
        """Yield the number of the first row and the rows.

        Parameters
        ----------
        columns : list of str
            Which to read.
        required : collection of str
            Those of them without which a row says nothing: rows in which one of these is lost are left out.

        Raises
        ------
        ReadError
            One of the required columns, or all others, cannot be read at all.
        """
        lost = _Lost(sum(self._sizes))
        begin = missing = 0
        for number, rows in enumerate(self._sizes):
            row, begin = begin, begin + rows
            for batch in self._group(number, columns, lost, row):
                if not lost.any_of(required, row):
                    yield row, batch
                row += batch.num_rows
            missing += begin - row  # where a page has become one of a kind that is passed by
        self._refuse_if_all(lost, columns, required)
        self.findings.add(*(lost.finding(name, name in required) for name in columns if name in lost.reasons))
        if missing > 0:
            self.findings.add(Finding(code="recording.rows_missing", value=missing))

    def _group(self, number: int, columns: list[str], lost: _Lost, begin: int) -> Iterator[pa.RecordBatch]:
        """Yield batches of a row group, of which `begin` is the first row; once one cannot be read, column by column."""
        row = begin
        if not any((number, name) in self._bad for name in columns):
            try:
                for batch in self._read(number, columns, PART):
                    yield batch
                    row += batch.num_rows
            except _UNREADABLE:
                pass  # the columns, one by one, say which it is
            else:
                return
        yield from self._column_by_column(number, columns, begin, lost, BLOCK_ROWS, row - begin)

    def _column_by_column(
        self, number: int, columns: Sequence[str], row: int, lost: _Lost, step: int, done: int = 0
    ) -> Iterator[pa.RecordBatch]:
        """Yield batches of a row group from its row `done` on, null from where a column cannot be read on."""
        rows = self._sizes[number]
        names = list(dict.fromkeys(columns))  # several columns may have one name: they are read together
        pieces = {name: self._pieces(number, name, step) for name in names}
        for begin in range(0, rows, step):
            count = min(step, rows - begin)
            cells: dict[str, Sequence[pa.Array]] = {}
            for name in names:
                try:
                    cells[name] = next(pieces[name])
                except _UNREADABLE as error:
                    lost.add(name, row + begin, row + rows, str(error))
                except StopIteration:
                    pass  # it was lost before
            if begin + count > done:
                yield self._batch(columns, cells, count).slice(max(done - begin, 0))

    def _batch(self, columns: Sequence[str], cells: dict[str, Sequence[pa.Array]], count: int) -> pa.RecordBatch:
        """Return columns side by side, in the file's order, null where there are no cells."""
        fields = [field for field in self.schema if field.name in columns]
        taken = {name: iter(arrays) for name, arrays in cells.items()}
        # A group without members has no cells.
        found = [next(taken.get(field.name, iter(())), None) for field in fields]
        arrays = [pa.nulls(count, f.type) if one is None else one for one, f in zip(found, fields, strict=True)]
        return pa.RecordBatch.from_arrays(arrays, [field.name for field in fields])

    def _pieces(self, number: int, name: str, step: int) -> Iterator[Sequence[pa.Array]]:
        """Yield the columns of a name, so many rows at a time.

        Raises
        ------
        ArrowException, OSError
            What comes next is damaged.
        """
        if (number, name) in self._bad:
            raise pa.ArrowInvalid(self._bad[number, name])
        batches = self._read(number, [name], step)
        left = self._sizes[number]
        while left > 0:
            count, held = min(step, left), list[pa.RecordBatch]()
            while (have := sum(batch.num_rows for batch in held)) < count:
                batch = next(batches, None)
                if batch is None:
                    break
                held.append(batch)
            if have != count:
                raise pa.ArrowInvalid(f"{have} rows where {count} are counted")
            table = pa.Table.from_batches(held)  # asked for 'motor', Arrow gives 'motor.position' too
            yield [table.column(i).combine_chunks() for i in table.schema.get_all_field_indices(name)]
            left -= count

    def _read(self, number: int, columns: list[str], step: int) -> Iterator[pa.RecordBatch]:
        yield from self.file.iter_batches(batch_size=step, row_groups=[number], columns=columns)

    def _refuse_bombs(self) -> None:
        """Refuse a file that would take far more memory than any recording: Arrow decompresses a page as a whole."""
        for chunk in (chunk for group in self.groups for chunk in group.chunks):
            if chunk.uncompressed > max(AT_ONCE_BYTES, MAX_RATIO * chunk.compressed):
                raise ReadError(
                    f"column '{printable_cell(chunk.path)}' announces {chunk.uncompressed} bytes out of"
                    f" {chunk.compressed}: no recording is compressed so much",
                    self.path,
                )

    def _bad_pages(self) -> dict[tuple[int, str], str]:
        """Return the row groups and columns whose pages' headers are absurd or do not add up, and the words for it."""
        found: dict[tuple[int, str], str] = {}
        with self.path.open("rb") as file:
            for number, group in enumerate(self.groups):
                for chunk in group.chunks:
                    trouble = trouble_with_pages(file, chunk)
                    if trouble is not None:
                        found[number, self._owner(chunk.path)] = trouble
        return found

    def _owner(self, path: str) -> str:
        """Return the column of the table that a column of the file belongs to: lists and structures have several."""
        names = self.schema.names
        return path if path in names else next((name for name in names if path.startswith(f"{name}.")), path)

    def _refuse_if_all(self, lost: _Lost, columns: list[str], required: Collection[str]) -> None:
        """Refuse a file of which a required column, or every other one, is lost from beginning to end."""
        whole = [name for name in columns if lost.all_of(name)]
        others = [name for name in columns if name not in required]
        needed = [name for name in whole if name in required]
        if not needed and (not others or set(others) - set(whole)):
            return
        first = (needed or whole)[0]
        raise ReadError(
            f"the Parquet file is damaged: none of the {plural(lost.rows, 'row')} of column"
            f" '{printable_cell(first)}' can be read ({lost.reasons[first]})",
            self.path,
        )


class _Lost:
    """Which rows of which columns cannot be read, and why."""

    def __init__(self, rows: int) -> None:
        self.rows = rows
        self.reasons: dict[str, str] = {}
        self._stretches: dict[str, list[tuple[int, int]]] = {}

    def add(self, name: str, begin: int, end: int, reason: str) -> None:
        """Note that rows from `begin` on, before `end`, are lost."""
        self.reasons.setdefault(name, printable(reason)[:120])
        self._stretches.setdefault(name, []).append((begin, end))

    def any_of(self, names: Collection[str], row: int) -> bool:
        """Tell whether a row is lost in any of some columns."""
        return any(begin <= row < end for name in names for begin, end in self._stretches.get(name, ())[-1:])

    def all_of(self, name: str) -> bool:
        """Tell whether every row of a column is lost."""
        return self.rows > 0 and self._count(name) == self.rows

    def finding(self, name: str, required: bool) -> Finding:
        """Return what is lost of a column."""
        stretches = self._stretches[name]
        (begin, end), more = stretches[0], len(stretches) - 1
        return Finding(
            code="recording.rows_left_out" if required else "recording.column_damaged",
            part=printable_cell(name),
            value=self._count(name),
            evidence={
                "rows": self.rows,
                "begin": begin + 1,
                "end": end,
                "more": more,
                "reason": self.reasons[name],
            },
        )

    def _count(self, name: str) -> int:
        return sum(end - begin for begin, end in self._stretches.get(name, ()))
