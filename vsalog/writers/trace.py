"""Stiffness traces as Parquet: one row per sample and transmission, units in the fields' metadata."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.arrow import findings_entry
from vsalog.core.column import PART
from vsalog.core.finding import Finding
from vsalog.core.trace import Trace, trace_columns, trace_schema, trace_tables
from vsalog.writers.atomic import atomic_path


def widened(table: pa.Table, schema: pa.Schema) -> pa.Table:
    """Return a table with the columns of a schema; missing ones are null."""
    known = set(table.column_names)
    arrays = [table[f.name] if f.name in known else pa.nulls(table.num_rows, f.type) for f in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _encodings(schema: pa.Schema) -> dict[str, Any]:
    """Numbers that hardly ever repeat gain nothing from a dictionary: bytes apart compress better, and faster."""
    texts = [f.name for f in schema if pa.types.is_dictionary(f.type)]
    floats = {f.name: "BYTE_STREAM_SPLIT" for f in schema if pa.types.is_float64(f.type)}
    floats |= {f"{f.name}.list.element": "BYTE_STREAM_SPLIT" for f in schema if pa.types.is_list(f.type)}
    return {"use_dictionary": texts, "column_encoding": {**floats, "stamp": "DELTA_BINARY_PACKED"}}


class TraceWriter:
    """Write blocks of traces to one Parquet file, which appears when all is written and not before.

    Use as a context manager. Rows of one transmission are in the order of time. Joints may have columns of their own: the
    file has those of all of them.

    Parameters
    ----------
    path : of the file
    metadata : of its schema: provenance
    layout : converts a trace's table to that of the file
    """

    def __init__(
        self, path: Path, metadata: Mapping[str, str], layout: Callable[[pa.Table], pa.Table] = lambda table: table
    ) -> None:
        self.path, self.metadata, self.layout = path, metadata, layout
        self._stack = ExitStack()
        self._writer: pq.ParquetWriter | None = None
        self._columns: list[str] = []
        self._schema: pa.Schema | None = None
        self._pending: list[Trace] = []
        self._findings: dict[str, str] = {}

    def __enter__(self) -> TraceWriter:
        self._temporary = self._stack.enter_context(atomic_path(self.path))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self.finish()
        except BaseException as failure:
            # A full disk shows here: the temporary file must be removed nevertheless.
            self._stack.__exit__(type(failure), failure, failure.__traceback__)
            raise
        self._stack.__exit__(kind, error, trace)

    @property
    def written(self) -> Path:
        """The file that is written to until all is there; to be read once `finish` was called."""
        return self._temporary

    def add_findings(self, findings: Iterable[Iterable[Finding]]) -> None:
        """Have the findings of the joints written into the file's metadata."""
        self._findings = findings_entry(findings)

    def finish(self) -> None:
        """Write what is pending and the footer; nothing can be written after that."""
        self._flush()
        if self._writer is None:
            self._add([])
        assert self._writer is not None
        if self._writer.is_open:
            self._writer.add_key_value_metadata(self._findings)
        self._writer.close()
        if not self._file.closed:
            self._file.flush()

    def write(self, trace: Trace) -> None:
        """Append a block."""
        if self._pending and self._pending[0].joint != trace.joint:
            self._flush()
        if added := [name for name in trace_columns(trace) if name not in self._columns]:
            self._flush()
            self._add(added)
        self._pending.append(trace)
        if sum(map(len, self._pending)) >= PART:
            self._flush()

    def _add(self, columns: list[str]) -> None:
        """Begin the file, or begin it again with its content so far and more columns, which are null there."""
        self._columns += columns
        self._schema = trace_schema(self._columns, self.metadata)
        schema = self.layout(pa.Table.from_batches([], self._schema)).schema  # `empty_table` would import pandas
        if self._writer is None:
            self._writer = self._open(schema)
        if self._writer.schema.equals(schema):
            return
        self._writer.close()
        self._file.close()
        with tempfile.TemporaryFile(dir=self.path.parent) as copy:
            with self._temporary.open("rb") as file:
                shutil.copyfileobj(file, copy)
            self._writer = self._open(schema)
            narrow = pq.ParquetFile(copy)
            for i in range(narrow.num_row_groups):
                self._writer.write_table(widened(narrow.read_row_group(i), schema))

    def _open(self, schema: pa.Schema) -> pq.ParquetWriter:
        # Opened here: Arrow does not accept a name whose bytes are no text.
        self._file = self._stack.enter_context(self._temporary.open("wb"))
        writer = pq.ParquetWriter(
            self._file, schema, compression="zstd", write_page_checksum=True, **_encodings(schema)
        )
        self._stack.callback(writer.close)
        return writer

    def _flush(self) -> None:
        if self._pending and self._writer is not None:
            for table in trace_tables(Trace.concatenate(self._pending), self._schema):
                self._writer.write_table(self.layout(table))
        self._pending.clear()
