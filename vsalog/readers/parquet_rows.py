"""The readable rows of a damaged Parquet file: damage in one column does not affect the others."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import pyarrow as pa

from vsalog.core.column import PART
from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import AT_ONCE_BYTES, PIECE_BYTES
from vsalog.core.printable import plural, printable
from vsalog.readers.compression import MAX_RATIO
from vsalog.readers.limits import BLOCK_ROWS, SAMPLE_ROWS
from vsalog.readers.parquet_opened import open_parquet
from vsalog.readers.sandbox import TOO_MUCH, SandboxError, sandboxed
from vsalog.readers.tables.text import printable_cell

_UNREADABLE = (pa.ArrowException, OSError)


class ParquetRows:
    """A Parquet file as batches of rows; cells that cannot be read are null, and `findings` reports them.

    Pages have checksums, their headers have none, and Arrow skips a page that it does not recognise: the following rows
    would move up. So no row of a row group is returned before all of them are counted.

    Parameters
    ----------
    path : Path
        The file.

    Attributes
    ----------
    schema : pyarrow Schema
        Of the file.
    sizes, unpacked : list of int
        Rows of each row group, and its unpacked bytes.

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
        # The footer's statistics of columns are not read: where they contradict themselves, Arrow ends the process.
        groups = [self.file.metadata.row_group(i) for i in range(self.file.num_row_groups)]
        self.sizes = [max(group.num_rows, 0) for group in groups]
        self.unpacked = [group.total_byte_size for group in groups]
        self._refuse_bombs()
        self._bad = self._bombs()

    @property
    def too_large(self) -> list[str]:
        """The columns with a page that takes more memory than the footer states."""
        return sorted({name for _, name in self._bad})

    def sample(self) -> list[pa.Array | None]:
        """Return the first rows of each column that can be read, None for one of which none can; no columns without rows."""
        names = self.schema.names
        found: dict[str, Sequence[pa.Array]] = {}
        for number, rows in enumerate(self.sizes):
            for name in dict.fromkeys(names) if rows else ():
                if name not in found:
                    try:
                        first = next(self._pieces(number, name, SAMPLE_ROWS))
                    except (*_UNREADABLE, StopIteration):
                        continue
                    if first and len(first[0]) >= min(rows, SAMPLE_ROWS):
                        found[name] = first
        if not any(self.sizes):
            return []
        shortest = min((len(one) for cells in found.values() for one in cells), default=0)
        taken = {name: iter(cells) for name, cells in found.items()}
        firsts = [next(taken.get(name, iter(())), None) for name in names]
        return [None if cells is None else cells[:shortest] for cells in firsts]

    def batches(self, columns: list[str], required: Collection[str]) -> Iterator[tuple[int, pa.RecordBatch]]:
        """Yield the number of the first row and the rows.

        Parameters
        ----------
        columns : list of str
            Which to read.
        required : collection of str
            Those of them that every row needs: rows in which one of these is lost are left out.

        Raises
        ------
        ReadError
            One of the required columns, or all others, cannot be read at all.
        """
        lost = _Lost(sum(self.sizes))
        row = 0
        for number in range(len(self.sizes)):
            for batch in self._group(number, columns, lost, row):
                if not lost.any_of(required, row):
                    yield row, batch
                row += batch.num_rows
        self._refuse_if_all(lost, columns, required)
        self.findings.add(*(lost.finding(name, name in required) for name in columns if name in lost.reasons))

    def _group(self, number: int, columns: list[str], lost: _Lost, begin: int) -> Iterator[pa.RecordBatch]:
        """Yield batches of a row group, of which `begin` is the first row, null where a column cannot be read."""
        table = self._table(number, columns)
        if table is not None:
            yield from table.to_batches(max_chunksize=PART)
            return
        rows = self.sizes[number]
        names = list(dict.fromkeys(columns))  # several columns may have one name: they are read together
        sound = {name: self._sound(number, name, lost, begin) for name in names}
        pieces = {name: self._pieces(number, name, BLOCK_ROWS) for name in names}
        for row in range(0, rows, BLOCK_ROWS):
            cells = {name: next(pieces[name]) for name in names if row < sound[name]}
            yield self._batch(columns, cells, min(BLOCK_ROWS, rows - row))

    def _table(self, number: int, columns: list[str]) -> pa.Table | None:
        """Return a row group, None where something is wrong with one of the columns, or all are too large to be held at once."""
        numbers = 8 * self.sizes[number] * len(columns)  # of equal ones the footer counts an index in few bits
        if max(self.unpacked[number], numbers) > AT_ONCE_BYTES or any((number, name) in self._bad for name in columns):
            return None
        try:
            table = self.file.read_row_group(number, columns)
        except _UNREADABLE:
            return None  # reading the columns one by one shows which it is
        return table if table.num_rows == self.sizes[number] else None

    def _sound(self, number: int, name: str, lost: _Lost, begin: int) -> int:
        """Return how many rows of a column can be read from the first one of a row group on; the others are noted."""
        rows, count = int(self.sizes[number]), 0
        try:
            for cells in self._pieces(number, name, BLOCK_ROWS):
                count += len(cells[0]) if cells else 0
        except _UNREADABLE as error:
            reason = str(error)
        else:
            if count == rows:
                return rows
            reason, count = f"{count} rows where {rows} are counted", 0
        lost.add(name, begin + count, begin + rows, reason)
        return count

    def _batch(self, columns: Sequence[str], cells: dict[str, Sequence[pa.Array]], count: int) -> pa.RecordBatch:
        """Return columns side by side, in the file's order, null where there are no cells."""
        fields = [field for field in self.schema if field.name in columns]
        taken = {name: iter(arrays) for name, arrays in cells.items()}
        # A group without members has no cells.
        found = [next(taken.get(field.name, iter(())), None) for field in fields]
        arrays = [pa.nulls(count, f.type) if one is None else one for one, f in zip(found, fields, strict=True)]
        return pa.RecordBatch.from_arrays(arrays, [field.name for field in fields])

    def _pieces(self, number: int, name: str, step: int) -> Iterator[Sequence[pa.Array]]:
        """Yield the columns of a name, in blocks of rows.

        Raises
        ------
        ArrowException, OSError
            What comes next is damaged.
        """
        if (number, name) in self._bad:
            raise pa.ArrowInvalid(TOO_MUCH)
        held = list[pa.RecordBatch]()
        for batch in self.file.iter_batches(batch_size=step, row_groups=[number], columns=[name]):
            held.append(batch)
            if sum(one.num_rows for one in held) >= step:
                yield self._of_name(held, name)
                held.clear()
        if held:
            yield self._of_name(held, name)

    def _of_name(self, batches: Sequence[pa.RecordBatch], name: str) -> Sequence[pa.Array]:
        """Return the columns of a name; for 'motor', Arrow returns 'motor.position' too."""
        table = pa.Table.from_batches(batches)
        return [table.column(i).combine_chunks() for i in table.schema.get_all_field_indices(name)]

    def _refuse_bombs(self) -> None:
        """Refuse a file that would take far more memory than any recording."""
        size = self.path.stat().st_size
        announced = max(sum(self.unpacked), sum(self.sizes))
        if announced > max(AT_ONCE_BYTES, MAX_RATIO * size):
            raise ReadError(
                f"its footer announces {announced} bytes or rows in {size} bytes: no recording is compressed so much",
                self.path,
            )

    def _bombs(self) -> set[tuple[int, str]]:
        """Return the row groups and columns with a page that takes more memory than the footer states, as of a small file."""
        if self.path.stat().st_size > PIECE_BYTES:
            return set()
        try:
            return {(number, name) for number, name in sandboxed(self._too_large, AT_ONCE_BYTES)}
        except SandboxError as error:
            raise ReadError(f"the Parquet file cannot be read: {error}", self.path) from error

    def _too_large(self) -> list[tuple[int, str]]:
        found = []
        pa.set_memory_pool(pa.system_memory_pool())  # others take addresses ahead of what they need
        file, _ = open_parquet(self.path)
        for number in range(len(self.sizes)):
            for name in dict.fromkeys(self.schema.names):
                batches = file.iter_batches(PART, [number], [name], use_threads=False)
                try:
                    for _ in batches:
                        pass
                except MemoryError:
                    found.append((number, name))
                except _UNREADABLE:
                    pass  # it is damaged
        return found

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
        """Return whether a row is lost in any of some columns."""
        return any(begin <= row < end for name in names for begin, end in self._stretches.get(name, ())[-1:])

    def all_of(self, name: str) -> bool:
        """Return whether every row of a column is lost."""
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
