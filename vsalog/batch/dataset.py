"""The data set's files: every trace with the same columns in the same order, whichever estimator wrote it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.batch.names import encoded
from vsalog.core.arrow import arrow_column, arrow_texts, findings_entry
from vsalog.core.column import PART as ROW_GROUP
from vsalog.core.errors import WriteError
from vsalog.core.finding import Finding
from vsalog.core.trace import EXTRA_UNITS, UNITS, Trace

TRACES = "traces"
PART = "part.parquet"
COEFFICIENTS = "coefficients"


def trace_name(device: str, date: str, log: str) -> str:
    """Return where a log's trace lies in the batch; all three are encoded, so that none can be a path."""
    return f"{TRACES}/device={encoded(device)}/date={encoded(date)}/log={encoded(log)}/{PART}"


def dataset_schema(extra: Sequence[str], metadata: Mapping[str, str]) -> pa.Schema:
    """Return the schema of all traces; columns that only a third party's estimator gives come last."""
    text = pa.dictionary(pa.int32(), pa.string())
    fields = [
        pa.field("time", pa.float64(), metadata={"unit": "s"}),
        pa.field("stamp", pa.int64(), metadata={"unit": "ns"}),
        pa.field("joint", text),
        pa.field("transmission", text),
        pa.field("run", text),
    ]
    for name, unit in (UNITS | EXTRA_UNITS | dict.fromkeys(extra, "")).items():
        kind = pa.bool_() if name == "excited" else pa.float64()
        fields.append(pa.field(name, kind, metadata={"unit": unit} if unit else None))
    fields.append(pa.field(COEFFICIENTS, pa.list_(pa.float64()), metadata={"unit": "N*m"}))
    return pa.schema(fields, metadata=dict(metadata))


class DatasetWriter:
    """Write the blocks of a log's trace to one file; a context manager. Row groups are cut at the same rows however blocks come.

    Parameters
    ----------
    path : of the file
    metadata : of its schema: provenance

    Raises
    ------
    WriteError
        It cannot be written.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self.path, self.metadata = path, metadata
        self.first_stamp: int | None = None
        self._stack = ExitStack()
        self._writer: pq.ParquetWriter | None = None
        self._schema: pa.Schema | None = None
        self._extra: list[str] = []
        self._pending: list[Trace] = []
        self._findings: dict[str, str] = {}

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._explained():
            try:
                if error is None:
                    self._flush()
                    self._open(self._extra).add_key_value_metadata(self._findings)
            finally:
                self._stack.close()

    def add_findings(self, findings: Iterable[Iterable[Finding]]) -> None:
        """Have the findings of the joints written into the file's metadata."""
        self._findings = findings_entry(findings)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise WriteError(f"{self.path}: cannot be written: {error.strerror or error}") from error

    @property
    def date(self) -> str:
        """The day (UTC) of the log's first sample; 1970-01-01 where its clock knows no date."""
        day = datetime.fromtimestamp((self.first_stamp or 0) // 10**9, UTC)
        return day.strftime("%Y-%m-%d")

    def write(self, trace: Trace) -> None:
        """Append a block."""
        if len(trace):
            first = int(trace.stamps.min())
            self.first_stamp = first if self.first_stamp is None else min(first, self.first_stamp)
        if self._pending and (self._pending[0].joint != trace.joint or _columns(self._pending[0]) != _columns(trace)):
            with self._explained():
                self._flush()
        self._pending.append(trace)
        if sum(map(len, self._pending)) >= ROW_GROUP:
            with self._explained():
                self._flush()

    def _flush(self) -> None:
        if not self._pending:
            return
        trace = Trace.concatenate(self._pending)
        self._pending.clear()
        extra = [c for c in _columns(trace) if c not in UNITS and c not in EXTRA_UNITS and not _coefficient(c)]
        writer = self._open(extra)
        assert self._schema is not None
        for table in _tables(trace, self._schema):
            writer.write_table(table)

    def _open(self, extra: Sequence[str]) -> pq.ParquetWriter:
        """Open the file at the first block; begin it again where a joint brings columns that those before it had not."""
        if self._writer is not None and set(extra) <= set(self._extra):
            return self._writer
        before = None
        if self._writer is not None:
            self._stack.close()
            before = self.path.replace(self.path.with_suffix(".narrow"))
        self._extra = list(dict.fromkeys([*self._extra, *extra]))
        schema = self._schema = dataset_schema(self._extra, self.metadata)
        texts = [f.name for f in schema if pa.types.is_dictionary(f.type)]
        encodings = {f.name: "BYTE_STREAM_SPLIT" for f in schema if pa.types.is_float64(f.type)}
        encodings |= {"stamp": "DELTA_BINARY_PACKED", f"{COEFFICIENTS}.list.element": "BYTE_STREAM_SPLIT"}
        # Opened here: Arrow cannot be given a name whose bytes are no text.
        file = self._stack.enter_context(self.path.open("wb"))
        self._writer = pq.ParquetWriter(
            file, schema, compression="zstd", write_page_checksum=True, use_dictionary=texts, column_encoding=encodings
        )
        self._stack.callback(self._writer.close)
        if before is not None:
            with before.open("rb") as source:
                narrow = pq.ParquetFile(source)
                for i in range(narrow.num_row_groups):
                    self._writer.write_table(_widened(narrow.read_row_group(i), schema))
            before.unlink()
        return self._writer


def _coefficient(column: str) -> bool:
    return column.startswith("coefficient_")


def _columns(trace: Trace) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for columns in trace.transmissions.values() for name in columns))


def _tables(trace: Trace, schema: pa.Schema) -> Iterator[pa.Table]:
    """Turn a trace into a table per transmission."""
    count = len(trace)
    runs = pa.DictionaryArray.from_arrays(arrow_column(trace.run.astype(np.int32)), arrow_texts(trace.run_names))
    time, stamps, joint = arrow_column(trace.time), arrow_column(trace.stamps), _constant(trace.joint, count)
    for name, columns in trace.transmissions.items():
        there = {
            "time": time,
            "stamp": stamps,
            "joint": joint,
            "transmission": _constant(name, count),
            "run": runs,
            COEFFICIENTS: _coefficients([v for c, v in columns.items() if _coefficient(c)], count),
        }
        arrays = [
            there[f.name]
            if f.name in there
            else arrow_column(columns[f.name])
            if f.name in columns
            else pa.nulls(count, f.type)
            for f in schema
        ]
        yield pa.Table.from_arrays(arrays, schema=schema)


def _widened(table: pa.Table, schema: pa.Schema) -> pa.Table:
    known = set(table.column_names)
    arrays = [table[f.name] if f.name in known else pa.nulls(table.num_rows, f.type) for f in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _coefficients(values: list[np.typing.NDArray[np.generic]], count: int) -> pa.Array:
    if not values:
        return pa.nulls(count, pa.list_(pa.float64()))
    flat = np.stack([np.asarray(v, np.float64) for v in values], axis=1).ravel()
    offsets = np.arange(count + 1, dtype=np.int32) * np.int32(len(values))
    return pa.ListArray.from_arrays(arrow_column(offsets), arrow_column(flat))


def _constant(text: str, length: int) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(arrow_column(np.zeros(length, np.int32)), arrow_texts([text]))
