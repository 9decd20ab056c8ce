"""CSV, TSV and other text tables."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
from numpy.typing import NDArray

from vsalog.errors import ReadError
from vsalog.readers.base import Block, Catalogue, ChannelInfo, first_of_each, plural
from vsalog.readers.headers import printable_cell
from vsalog.readers.row_clock import ROW_NOTE, row_clock
from vsalog.readers.sparse import group_by_blanks
from vsalog.readers.table_dialect import NUMBER, WHITESPACE, Dialect, detect
from vsalog.readers.text_source import TextSource
from vsalog.readers.time_columns import find_clocks, looks_like_clock, nanoseconds
from vsalog.recording import Stamps, Values

HEAD_BYTES = 256 * 1024
BLOCK_BYTES = 4 * 2**20

_NULLS = ["", "NA", "N/A", "n/a", "null", "NULL", "None", "none", "-", "--"]
_CELL = NUMBER.replace("^", "^(", 1)[:-1] + r"|[+-]?(?i:inf|infinity)|[+-]?(?i:nan))$"


class TableReader:
    """Reads a text table; see `vsalog.readers.base.Reader`.

    Parameters
    ----------
    path : Path
        The file, plain or compressed with gzip.
    rate : float or None
        Samples per second [Hz], for a table without a time column.

    Raises
    ------
    ReadError
        The file cannot be opened or has no rows of values.
    """

    format = "csv"
    rig_text: str | None = None

    def __init__(self, path: Path, rate: float | None) -> None:
        self.path = path
        self.rate = rate
        self.notes: list[str] = []
        self.unread: dict[str, str] = {}
        self._gzip = False
        self._dialect = self._detect()
        self._sample = _sample_columns(self._dialect)
        self._plan = find_clocks(self._dialect.names, self._dialect.units, self._sample)
        self._counts: dict[str, _Cells] = {}
        clocks = self._plan.columns()
        numbers = [_numbers_and_words(column) for column in self._sample]
        if not any(good and (clocks or good > words) for good, words in numbers):
            raise ReadError(f"{path}: holds text, but no table: none of its columns holds numbers")
        self._channels = [i for i in range(len(self._dialect.names)) if i not in clocks]
        groups = group_by_blanks(self._sample, self._channels) if clocks else [self._channels]
        self._streams = {i: self._stream_name(k, group) for k, group in enumerate(groups) for i in group}

    def catalogue(self) -> Catalogue:
        """Return the columns; those whose first cells are all text are listed as unread."""
        channels: dict[str, ChannelInfo] = {}
        unread: dict[str, str] = {}
        for i in self._channels:
            name, unit = self._dialect.names[i], self._dialect.units[i]
            cells = _Cells()
            cells.convert(self._sample[i])
            if cells.text:
                unread[name] = cells.text
            else:
                channels[name] = ChannelInfo(self._streams[i], "csv", unit)
        return Catalogue(channels, unread)

    def heads(self) -> Iterator[Block]:
        """Yield the first rows."""
        return first_of_each(self.blocks(None))

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield the table's rows, block by block.

        Raises
        ------
        ReadError
            The table cannot be parsed.
        """
        self._note_dialect()
        names = self._dialect.names
        columns = [i for i in self._channels if wanted is None or names[i] in wanted]
        self._counts = {names[i]: _Cells() for i in columns}
        row, dropped = 0, 0
        for batch in self._batches(columns):
            stamps, good = self._clock(batch, row)
            values = {names[i]: self._counts[names[i]].convert(batch.column(names[i])) for i in columns}
            row += batch.num_rows
            if not good.all():
                dropped += int(np.count_nonzero(~good))
                stamps = {kind: times[good] for kind, times in stamps.items()}
                values = {name: cells[good] for name, cells in values.items()}
            yield from self._by_stream(columns, stamps, values)
        self._report(dropped)

    def _by_stream(self, columns: list[int], stamps: dict[str, Stamps], values: dict[str, Values]) -> Iterator[Block]:
        """Yield a block per stream, the sparse ones without their blank rows."""
        names, units = self._dialect.names, self._dialect.units
        for stream in dict.fromkeys(self._streams[i] for i in columns) or [self.path.stem]:
            own = [i for i in columns if self._streams[i] == stream]
            cells = {names[i]: values[names[i]] for i in own}
            times = stamps
            if stream != self.path.stem:
                filled = ~np.all([np.isnan(column) for column in cells.values()], axis=0)
                cells = {name: column[filled] for name, column in cells.items()}
                times = {kind: time[filled] for kind, time in stamps.items()}
            stated = {names[i]: unit for i in own if (unit := units[i]) is not None}
            yield Block(stream, "csv", times, cells, stated, self._timeless())

    def _stream_name(self, number: int, group: list[int]) -> str:
        return self.path.stem if number == 0 else f"{self.path.stem} ({self._dialect.names[group[0]]} …)"

    def _detect(self) -> Dialect:
        try:
            with self.path.open("rb") as file:
                self._gzip = file.read(2) == b"\x1f\x8b"
            with self.open() as source:
                head = read_beginning(source, HEAD_BYTES)
        except OSError as error:
            raise ReadError(f"{self.path}: cannot be read: {error.strerror or error}") from error
        dialect = detect(head, whole=len(head) < HEAD_BYTES)
        if not dialect.names or not dialect.rows:
            raise ReadError(f"{self.path}: holds text, but no table: no row of values was found")
        return dialect

    @property
    def has_clock(self) -> bool:
        """Whether columns tell the time."""
        return bool(self._plan.clocks)

    @property
    def encoding(self) -> str:
        """Python's name of the text's encoding."""
        return self._dialect.encoding

    @property
    def seekable(self) -> bool:
        """Whether lines can be found from anywhere in the file: it is not compressed, and a line's end is one byte."""
        return not self._gzip and not self.encoding.startswith("utf-16")

    def open(self) -> IO[bytes]:
        """Open the text, decompressed."""
        return gzip.open(self.path, "rb") if self._gzip else self.path.open("rb")  # type: ignore[return-value]

    def _clock(self, batch: pa.RecordBatch, row: int) -> tuple[dict[str, Stamps], NDArray[np.bool_]]:
        """Return a batch's stamps by kind of clock, and which rows have one."""
        good = np.ones(batch.num_rows, dtype=bool)
        if not self._plan.clocks:
            return row_clock(row, batch.num_rows, self.rate), good
        stamps = {}
        for kind, clock in self._plan.clocks.items():
            cells = [self._point(batch.column(self._dialect.names[i])) for i in clock.columns]
            stamps[kind], valid = nanoseconds(cells, clock.form)
            good &= valid
        return stamps, good

    def _point(self, cells: pa.Array) -> pa.Array:
        return pc.replace_substring(cells, ",", ".") if self._dialect.decimal_comma else cells

    def _batches(self, columns: list[int]) -> Iterator[pa.RecordBatch]:
        """Parse the table, wanted columns and clocks only, all as text."""
        dialect = self._dialect
        chosen = [dialect.names[i] for i in sorted({*columns, *self._plan.columns()})] or [dialect.names[0]]
        ragged = _Ragged()
        with self.open() as file:
            text = TextSource(file, dialect.encoding, dialect.separator == WHITESPACE)
            plain = dialect.encoding == "utf-8" and dialect.separator != WHITESPACE and not self._gzip
            # Arrow reads ahead in a thread of its own. It must not need the interpreter, which may be gone by then at exit.
            source = pa.memory_map(str(self.path)) if plain and _arrow_can_open(self.path) else file if plain else text
            try:
                with pacsv.open_csv(
                    source,
                    read_options=pacsv.ReadOptions(
                        use_threads=False,
                        block_size=BLOCK_BYTES,
                        skip_rows=dialect.skip_lines,
                        column_names=list(dialect.names),
                    ),
                    parse_options=pacsv.ParseOptions(delimiter=dialect.separator, invalid_row_handler=ragged.handle),
                    convert_options=pacsv.ConvertOptions(
                        include_columns=chosen,
                        column_types=dict.fromkeys(chosen, pa.string()),
                        strings_can_be_null=True,
                        quoted_strings_can_be_null=True,
                        null_values=_NULLS,
                        check_utf8=False,
                    ),
                ) as reader:
                    yield from (self._pointed(batch, columns) for batch in reader)
            except pa.ArrowInvalid as error:
                raise ReadError(f"{self.path}: cannot be parsed as a table: {error}") from error
            except OSError as error:
                raise ReadError(f"{self.path}: cannot be read: {error.strerror or error}") from error
            if text.damage:
                self.notes.append(f"the compressed file is damaged or cut off ({text.damage}): read up to there")
        self.notes.extend(ragged.notes(len(dialect.names)))

    def _pointed(self, batch: pa.RecordBatch, columns: list[int]) -> pa.RecordBatch:
        """Write the decimal commas of the values as points."""
        if not self._dialect.decimal_comma:
            return batch
        for name in (self._dialect.names[i] for i in columns):
            at = batch.schema.get_field_index(name)
            batch = batch.set_column(at, name, pc.replace_substring(batch.column(at), ",", "."))
        return batch

    def _timeless(self) -> str:
        if self._plan.backwards is None:
            return ""
        column, row = self._plan.backwards
        where = f"line {self._dialect.lines[row]}"
        return f"its time column '{printable_cell(self._dialect.names[column])}' runs backwards at {where}"

    def _note_dialect(self) -> None:
        self.notes += [note for note in (*self._dialect.notes, *self._plan.notes) if note not in self.notes]
        if self._dialect.decimal_comma and self._dialect.separator == ",":
            self.notes.append("the comma in the quoted numbers is read as a decimal mark")
        if self.rate is not None and self._plan.clocks:
            self.notes.append("the table has a time column: the sample rate that was given is not used")
        sparse = len(set(self._streams.values())) - (self.path.stem in self._streams.values())
        if sparse:
            self.notes.append(
                f"{plural(sparse, 'group')} of columns with many blank cells read without them, as streams of their own"
            )
        if self._plan.clocks or self.rate is not None:
            return
        self.notes.append(ROW_NOTE if self._plan.backwards is None else f"{self._timeless()}, so there is no time")
        for name, cells in zip(self._dialect.names, self._sample, strict=True):
            if looks_like_clock(_Cells().convert(cells)):
                self.notes.append(f"column '{name}' rises evenly: if it is the time, call it 'time [s]' in the header")
                break

    def _report(self, dropped: int) -> None:
        """Tell what was wrong with the cells."""
        if dropped:
            self.notes.append(f"{plural(dropped, 'row')} without a time left out")
        for name, cells in self._counts.items():
            if cells.text:
                self.unread[name] = cells.text
            elif cells.bad:
                self.notes.append(
                    f"column '{name}': {plural(cells.bad, 'cell')} without a number read as NaN"
                    f" (the first in row {cells.first_row + 1}: '{printable_cell(cells.first)}')"
                )


class _Cells:
    """Turns the cells of a column into numbers and counts those that are none."""

    def __init__(self) -> None:
        self.rows = 0
        self.good = 0
        self.bad = 0
        self.first = ""
        self.first_row = 0

    @property
    def text(self) -> str:
        """Why the column is no signal, "" where it is one."""
        if self.good:
            return ""
        return "text" if self.bad else "no values"

    def convert(self, cells: pa.Array) -> Values:
        """Return the numbers in a stretch of the column, NaN where there is none."""
        try:
            numbers = pc.cast(cells, pa.float64())
            bad = 0
        except pa.ArrowInvalid:
            numbers, bad = self._convert_carefully(cells)
        self.good += len(numbers) - numbers.null_count
        self.bad += bad
        self.rows += len(cells)
        return np.array(numbers.to_numpy(zero_copy_only=False), dtype=np.float64)

    def _convert_carefully(self, cells: pa.Array) -> tuple[pa.Array, int]:
        cells = pc.ascii_trim_whitespace(cells)
        cells = pc.replace_substring_regex(cells, "^(?i:true)$", "1")
        cells = pc.replace_substring_regex(cells, "^(?i:false)$", "0")
        number = pc.match_substring_regex(cells, _CELL)
        empty = pc.equal(cells, "")
        wrong = pc.fill_null(pc.and_not(pc.invert(number), empty), False)
        count = int(pc.sum(wrong).as_py() or 0)
        if count and not self.bad:
            at = int(pc.index(wrong, True).as_py())
            self.first_row = self.rows + at
            self.first = bytes(pc.cast(cells[at], pa.binary()).as_py()).decode("utf-8", "replace")
        nothing = pa.scalar(None, pa.string())
        return pc.cast(pc.if_else(pc.fill_null(number, False), cells, nothing), pa.float64()), count


class _Ragged:
    """Counts lines with too many or too few cells; remarks do not count."""

    def __init__(self) -> None:
        self.count = 0
        self.example = ""

    def handle(self, row: Any) -> str:
        """Skip a line."""
        text = str(row.text or "")
        if not text.lstrip().startswith(("#", "%")):
            self.count += 1
            self.example = self.example or text
        return "skip"

    def notes(self, width: int) -> list[str]:
        """Return what to tell."""
        if not self.count:
            return []
        return [
            f"{plural(self.count, 'line')} without exactly {width} cells skipped (the first: '{printable_cell(self.example)}')"
        ]


def read_beginning(source: IO[bytes], most: int) -> bytes:
    """Return the first bytes of a file, of a damaged one as far as it goes."""
    parts: list[bytes] = []
    size = 0
    while size < most:
        try:
            part = source.read(min(16 * 1024, most - size))
        except (EOFError, zlib.error, gzip.BadGzipFile):
            break
        if not part:
            break
        parts.append(part)
        size += len(part)
    return b"".join(parts)


def _numbers_and_words(column: pa.Array) -> tuple[int, int]:
    """Count the cells that hold a number and those that hold something else: prose has numbers too, between words."""
    cells = _Cells()
    cells.convert(column)
    return cells.good, cells.bad


def _sample_columns(dialect: Dialect) -> list[pa.Array]:
    """Return the columns' first cells, with decimal points."""
    rows = dialect.rows
    columns = []
    for i in range(len(dialect.names)):
        cells = [row[i] if row[i] not in _NULLS else None for row in rows]
        column = pa.array(cells, pa.string())
        columns.append(pc.replace_substring(column, ",", ".") if dialect.decimal_comma else column)
    return columns


def _arrow_can_open(path: Path) -> bool:
    """Tell whether a path is one that Arrow can be given: file names may hold bytes that are no text."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
