"""Cells of Parquet columns as numbers, and their types."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc


def plain_type(kind: pa.DataType) -> pa.DataType:
    """Return the type a column is read as: texts of every kind as text, dates and times of day too, categories as their
    values.
    """
    if pa.types.is_dictionary(kind):
        return plain_type(kind.value_type)
    texts = (pa.types.is_large_string, pa.types.is_string_view, pa.types.is_time, pa.types.is_date)
    return pa.string() if any(test(kind) for test in texts) else kind


def plain_cells(cells: pa.Array) -> pa.Array:
    """Return cells in the type that they are read as."""
    if pa.types.is_dictionary(cells.type):
        return plain_cells(cells.dictionary_decode())
    kind = plain_type(cells.type)
    plain = cells if cells.type == kind else pc.cast(cells, kind)
    return as_text(plain) if pa.types.is_string(kind) else plain


def as_text(cells: pa.Array) -> pa.Array:
    """Return texts as UTF-8, which they claim to be; an invalid byte becomes the replacement character."""
    try:
        cells.validate(full=True)
    except pa.ArrowInvalid:
        raw = cells.cast(pa.binary()).to_pylist()
        return pa.array([None if text is None else text.decode("utf-8", "replace") for text in raw], pa.string())
    return cells


def is_moment(kind: pa.DataType) -> bool:
    """Return whether values of a type are times by that alone."""
    return bool(pa.types.is_duration(kind) or pa.types.is_timestamp(kind))


def is_number(kind: pa.DataType) -> bool:
    """Return whether values of a type are a signal."""
    return bool(
        pa.types.is_integer(kind)
        or pa.types.is_floating(kind)
        or pa.types.is_boolean(kind)
        or pa.types.is_decimal(kind)
        or pa.types.is_duration(kind)
    )


def rising(rows: int, kind: pa.DataType) -> pa.Array:
    """Return cells of a type as a clock would have them, null where numbers cannot be of that type."""
    try:
        return pc.cast(pa.array(np.arange(rows) / 1000.0), kind, safe=False)
    except pa.ArrowException:
        return pa.nulls(rows, kind)
