"""Traces of a data set: all with the same columns in the same order, whichever estimator wrote them."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.arrow import arrow_column
from vsalog.core.trace import EXTRA_UNITS, trace_schema
from vsalog.writers.trace import widened

COEFFICIENT, COEFFICIENTS = "coefficient_", "coefficients"
STAMP = "stamp"


def in_dataset(table: pa.Table) -> pa.Table:
    """Return rows of a trace with the columns of the data set.

    Those that an estimator lacks are null, those that only a third party's estimator gives come after all others, and
    coefficients become one list per row.
    """
    fixed = trace_schema([]).names
    own = [name for name in table.column_names if name not in fixed and not name.startswith(COEFFICIENT)]
    schema = trace_schema(list(dict.fromkeys([*EXTRA_UNITS, *own])), table.schema.metadata)
    field = pa.field(COEFFICIENTS, pa.list_(pa.float64()), metadata={"unit": "N*m"})
    return widened(table, schema).append_column(field, _coefficients(table))


def _coefficients(table: pa.Table) -> pa.Array:
    columns = [table[name] for name in table.column_names if name.startswith(COEFFICIENT)]
    values = [column.to_numpy() for column in columns if column.null_count < len(column)]
    if not values:
        return pa.nulls(len(table), pa.list_(pa.float64()))
    offsets = np.arange(len(table) + 1, dtype=np.int32) * np.int32(len(values))
    return pa.ListArray.from_arrays(arrow_column(offsets), arrow_column(np.stack(values, axis=1).ravel()))


def day(path: Path) -> str:
    """Return the day (UTC) of the first sample in a trace's file; 1970-01-01 where its clock has no date."""
    with path.open("rb") as file:
        metadata = pq.ParquetFile(file).metadata
    column = metadata.schema.to_arrow_schema().get_field_index(STAMP)
    groups = (metadata.row_group(i).column(column) for i in range(metadata.num_row_groups))
    first = min((group.statistics.min for group in groups if group.num_values), default=0)
    return datetime.fromtimestamp(first // 10**9, UTC).strftime("%Y-%m-%d")
