"""Cells of a clock's column as numbers, exactly where they are written in decimals."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.recording import Stamps
from vsalog.readers.tables.cells import numbers_in
from vsalog.readers.tables.dates import in_nanoseconds, integers, scaled, trimmed


def is_numeric(sample: pa.Array) -> bool:
    """Return whether most cells of a column that are not blank are numbers."""
    values = floats(sample)
    return bool(len(values)) and np.count_nonzero(np.isfinite(values)) > 0.5 * (len(sample) - sample.null_count)


def floats(array: pa.Array) -> NDArray[np.float64]:
    """Return cells as floating point numbers, NaN where there is none."""
    if pa.types.is_string(array.type) or pa.types.is_large_string(array.type):
        array = trimmed(array)
    return np.asarray(numbers_in(array)[0].to_numpy(zero_copy_only=False), np.float64)


def scaled_up(array: pa.Array, digits: int) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return numbers times ten to the power of `digits` as integers, exactly where they are written in decimals."""
    kind = array.type
    if pa.types.is_time(kind) or pa.types.is_duration(kind):
        return in_nanoseconds(array)
    if pa.types.is_integer(kind):
        return scaled(*integers(array), 10**digits)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_decimal(kind):
        exact = _exact(array if pa.types.is_decimal(kind) else trimmed(array), digits)
        if exact is not None:
            return exact
    return multiplied(array, 10.0**digits)


def multiplied(array: pa.Array, factor: float, origin: float = 0.0) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return numbers, counted from `origin`, times a factor as integers, by way of floating point."""
    # Invalid numbers become infinite, and no stamp; a NaN may be signalling.
    with np.errstate(over="ignore", invalid="ignore"):
        values = (floats(array) - origin) * factor
    good = np.isfinite(values) & (np.abs(values) < 2.0**63)
    return np.rint(np.where(good, values, 0.0)).astype(np.int64), good


def is_exact(numbers: pa.Array, digits: int) -> bool:
    """Return whether numbers times a power of ten come so near to integers that rounding them is exact."""
    with np.errstate(invalid="ignore", over="ignore"):
        values = np.asarray(pc.fill_null(numbers, 0.0).to_numpy(zero_copy_only=False), np.float64) * 10.0**digits
        error, largest = (np.abs(one).max(initial=0.0) for one in (values - np.rint(values), values))
        # They were rounded twice: when they were read, and multiplied.
        return bool(error + 2 * np.spacing(largest) < 0.5)


def _exact(cells: pa.Array, digits: int) -> tuple[Stamps, NDArray[np.bool_]] | None:
    """Scale decimal numbers without floating point; None where some are written in another way, or too large."""
    try:
        number = pc.cast(cells, pa.decimal128(38, 18))
        number = pc.cast(pc.round(number, digits), pa.decimal128(38, digits), safe=False)
    except pa.ArrowInvalid:
        return None
    good = np.asarray(pc.is_valid(number).to_numpy(zero_copy_only=False), bool)
    buffer = number.buffers()[1]
    if buffer is None:
        return np.zeros(len(number), np.int64), good
    halves = np.frombuffer(buffer, np.int64)[2 * number.offset : 2 * (number.offset + len(number))].reshape(-1, 2)
    fits = (halves[:, 1] == np.where(halves[:, 0] < 0, -1, 0)) | ~good
    if not fits.all():
        return None
    return np.where(good, halves[:, 0], 0), good
