"""Dates in tables as nanoseconds since the epoch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.recording import Stamps
from vsalog.readers.reach import Nanoseconds
from vsalog.readers.tables.time_written import moments, times_of_day

_SHAPE = r"^\d{4}-\d\d-\d\d([T ]\d\d(:?\d\d(:?\d\d([.]\d{1,9})?)?)?)?([+-]\d\d:?\d\d)?$"
_ZONED = r":?\d\d(\.\d+)?[+-]\d\d:?\d\d$"


def dates(array: pa.Array, order: str = "") -> tuple[Stamps, NDArray[np.bool_]]:
    """Return dates [ns since the epoch], and which of them are dates; those without a time zone count as UTC.

    Parameters
    ----------
    array : pyarrow array
        Timestamps, dates, or texts.
    order : str
        Of day, month and year in ``3/4/2024``, see `time_written.moments`.
    """
    kind = array.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        return in_nanoseconds(array)
    text = trimmed(array)
    found = _iso(text)
    stamps, good = integers(found)
    if found.null_count > text.null_count:
        other = pc.if_else(pc.is_null(found), text, pa.scalar(None, pa.string()))
        written, also = moments(other, order)
        stamps, good = np.where(good, stamps, written), good | also
    return stamps, good


def of_day(text: pa.Array) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return times of day [ns since midnight], and which texts, without blanks around them, are such."""
    found = _iso(pc.binary_join_element_wise("1970-01-01", text, " "))
    stamps, good = integers(found)
    if found.null_count > text.null_count:
        written, also = times_of_day(pc.if_else(pc.is_null(found), text, pa.scalar(None, pa.string())))
        stamps, good = np.where(good, stamps, written), good | also
    return stamps, good


def integers(array: pa.Array) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return whole numbers, 0 where there is none, and where there are some."""
    if pa.types.is_uint64(array.type):
        array = pc.if_else(pc.less(array, pa.scalar(2**63, pa.uint64())), array, pa.scalar(None, pa.uint64()))
    good = np.asarray(pc.is_valid(array).to_numpy(zero_copy_only=False), bool)
    filled = pc.fill_null(pc.cast(array, pa.int64()), 0)
    return np.asarray(filled.to_numpy(zero_copy_only=False), np.int64), good


# How many nanoseconds the units of Arrow's types have.
_FACTORS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


def in_nanoseconds(array: pa.Array) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return dates, times of day and durations as `integers` does, and those that do not fit into 64 bits as none.

    Arrow's own conversion would either refuse all for the sake of one, or let it wrap around.
    """
    kind = array.type
    if pa.types.is_date32(kind):
        numbers, factor = pc.cast(array, pa.int32()), int(Nanoseconds.DAY)
    elif pa.types.is_date64(kind):
        numbers, factor = pc.cast(array, pa.int64()), 10**6
    else:
        numbers, factor = pc.cast(array, pa.int32() if pa.types.is_time32(kind) else pa.int64()), _FACTORS[kind.unit]
    return scaled(*integers(numbers), factor)


def scaled(values: Stamps, good: NDArray[np.bool_], factor: int) -> tuple[Stamps, NDArray[np.bool_]]:
    """Multiply whole numbers; those whose product does not fit into 64 bits are none."""
    most = (2**63 - 1) // factor
    fits = good & (values >= -most) & (values <= most)
    return np.where(fits, values, 0) * np.int64(factor), fits


def trimmed(array: pa.Array) -> pa.Array:
    """Return cells as texts without blanks around them, null where bytes are no text."""
    text = pc.cast(array, pa.string())
    try:
        return pc.utf8_trim_whitespace(text)
    except pa.ArrowInvalid:
        return pc.utf8_trim_whitespace(pa.array(map(_decoded, pc.cast(text, pa.binary()).to_pylist()), pa.string()))


def _decoded(cell: bytes | None) -> str | None:
    try:
        return None if cell is None else cell.decode()
    except UnicodeDecodeError:
        return None


def _iso(text: pa.Array) -> pa.Array:
    """Return dates of ISO 8601 as int64 nanoseconds, null where a text is none."""
    zoned = pc.fill_null(pc.match_substring_regex(text, _ZONED), False)
    nothing = pa.scalar(None, pa.string())
    plain = _valid(pc.if_else(zoned, nothing, text), pa.timestamp("ns"))
    return pc.coalesce(plain, _valid(pc.if_else(zoned, text, nothing), pa.timestamp("ns", "UTC")))


def _valid(text: pa.Array, kind: Any) -> pa.Array:
    """Cast dates to int64 nanoseconds, null where a text is none."""
    text = pc.if_else(pc.fill_null(pc.match_substring_regex(text, _SHAPE), False), text, pa.scalar(None, pa.string()))
    try:
        return pc.cast(pc.cast(text, kind), pa.int64())
    except pa.ArrowInvalid:
        cells = []
        for cell in text.to_pylist():
            try:
                cells.append(None if cell is None else pc.cast(pc.cast(pa.scalar(cell), kind), pa.int64()).as_py())
            except pa.ArrowInvalid:
                cells.append(None)
        return pa.array(cells, pa.int64())
