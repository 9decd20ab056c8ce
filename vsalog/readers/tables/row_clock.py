"""The clock of tables that have none: the number of the row."""

from __future__ import annotations

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.recording import Stamps
from vsalog.readers.reach import Stamp


def row_clock(first: int, count: int, rate: float | None) -> dict[str, Stamps]:
    """Return the stamps of `count` rows from row `first` on.

    Parameters
    ----------
    first, count : int
        Row numbers.
    rate : float or None
        Samples per second [Hz]; without it the stamps are the bare row numbers, of the kind ``none``.

    Returns
    -------
    dict of str to int64 array, shape (count,)
        Nanoseconds since the first row under ``rate``, or row numbers under ``none``.

    Raises
    ------
    ReadError
        At that rate the rows' times cannot be told apart, or are farther apart than 64 bits reach.
    """
    rows = np.arange(first, first + count, dtype=np.int64)
    if rate is None:
        return {"none": rows}
    if rate > 1e9:
        raise ReadError(f"--rate {rate:g}: rows cannot be less than a nanosecond apart; give the sample rate in Hz")
    if (first + count) * (1e9 / rate) > Stamp.FARTHEST:
        raise ReadError(
            f"--rate {rate:g}: {first + count} rows would last longer than a century; give the sample rate in Hz"
        )
    return {"rate": np.rint(rows * (1e9 / rate)).astype(np.int64)}
