"""The numbers of many messages at once, by the positions of a layout."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.readers.message_layout import Bytes, Integers
from vsalog.readers.nested import Place
from vsalog.readers.reach import Nanoseconds, Stamp


def values(data: Bytes, start: Integers, offsets: Integers, code: str) -> NDArray[np.float64]:
    """Return the numbers [as recorded, times in s] of one type at some offsets in each message.

    Parameters
    ----------
    data : uint8 array
        The buffer of the messages.
    start : int64 array, shape (n,)
        The position of each.
    offsets : int64 array, shape (k,)
        The positions of the numbers in a message.
    code : str
        As of `Place`.

    Returns
    -------
    float64 array, shape (k, n)
    """
    if "," in code:
        return np.asarray(_nanoseconds(data, start, offsets, code)[0] * 1e-9, dtype=np.float64)
    numbers = _numbers(data, start, offsets, code)
    with np.errstate(invalid="ignore"):  # a signalling NaN is no number either
        return numbers.astype(np.float64, copy=False)


def stamps(data: Bytes, start: Integers, place: Place) -> NDArray[np.int64]:
    """Return a header's time stamps [ns], shape (n,), `Stamp.NEVER` for those with nanoseconds that no time has."""
    found, fraction = _nanoseconds(data, start, np.array([place.offset]), place.code)
    found[(fraction < 0) | (fraction >= Nanoseconds.SECOND)] = Stamp.NEVER
    return np.asarray(found[0], np.int64)


def _nanoseconds(
    data: Bytes, start: Integers, offsets: Integers, code: str
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return times [ns], exact, and their parts of a second [ns], shapes (k, n)."""
    seconds, fraction = code.split(",")
    rest = _numbers(data, start, offsets + 4, fraction).astype(np.int64)
    return _numbers(data, start, offsets, seconds).astype(np.int64) * Nanoseconds.SECOND + rest, rest


def _numbers(data: Bytes, start: Integers, offsets: Integers, code: str) -> NDArray[Any]:
    """Return the numbers at some offsets in each message, of a NumPy type with byte order, shape (k, n)."""
    out = np.empty((offsets.size, start.size, int(code[2])), dtype=np.uint8)
    _cut(data, start, offsets, out)
    return out.view(code)[:, :, 0]


@compiled
def _cut(data: Bytes, start: Integers, offsets: Integers, out: Bytes) -> None:
    """Copy bytes at each offset in each message, of so few messages at a time that the processor's cache holds them.

    Loops of fixed length and unsigned indices let the compiler copy at once.
    """
    size = out.shape[2]
    for first in range(0, start.size, 64):
        for j in range(offsets.size):
            for k in range(first, min(first + 64, start.size)):
                at, to = np.uint64(start[k] + offsets[j]), np.uint64(k)
                if size == 8:
                    for i in range(8):
                        out[j, to, i] = data[at + np.uint64(i)]
                elif size == 4:
                    for i in range(4):
                        out[j, to, i] = data[at + np.uint64(i)]
                else:
                    for i in range(size):
                        out[j, to, i] = data[at + np.uint64(i)]
