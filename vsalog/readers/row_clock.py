"""The clock of tables that have none: the number of the row."""

from __future__ import annotations

import numpy as np

from vsalog.recording import Stamps

ROW_NOTE = "there is no time column: give the sample rate with --rate, in Hz"


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
    """
    rows = np.arange(first, first + count, dtype=np.int64)
    if rate is None:
        return {"none": rows}
    return {"rate": np.rint(rows * (1e9 / rate)).astype(np.int64)}
