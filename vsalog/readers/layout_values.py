"""The numbers of many messages at once, by where a layout says that they lie."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.readers.layout import Bytes, Field, Integers
from vsalog.readers.reach import NEVER


def column(data: Bytes, start: Integers, field: Field) -> NDArray[np.float64]:
    """Return a field's values [as recorded, times in s], shape (n,), of the messages that begin at `start`, shape (n,)."""
    if "," in field.code:
        return np.asarray(nanoseconds(data, start, field) * 1e-9, dtype=np.float64)
    numbers = _numbers(data, start, field.offset, field.code)
    if field.code[1] != "f":
        return numbers.astype(np.float64)
    with np.errstate(invalid="ignore"):  # NaN of the kind that signals is no number either
        return numbers.astype(np.float64, copy=False)


def doubles(data: Bytes, start: Integers, offsets: Integers) -> NDArray[np.float64]:
    """Return the numbers of NumPy type ``<f8`` at some offsets, shape (k,), in each message, shape (k, n)."""
    out = np.empty((offsets.size, 8 * start.size), dtype=np.uint8)
    _cut_doubles(data, start, offsets, out)
    return out.view("<f8")


def nanoseconds(data: Bytes, start: Integers, field: Field) -> NDArray[np.int64]:
    """Return a time field's values [ns], shape (n,), exact."""
    seconds, fraction = field.code.split(",")
    whole = _numbers(data, start, field.offset, seconds).astype(np.int64)
    return whole * 1_000_000_000 + _numbers(data, start, field.offset + 4, fraction).astype(np.int64)


def stamps(data: Bytes, start: Integers, field: Field) -> NDArray[np.int64]:
    """Return a header's time stamps [ns], shape (n,), `NEVER` for those with nanoseconds that no time has."""
    fraction = _numbers(data, start, field.offset + 4, field.code.split(",")[1]).astype(np.int64)
    found = nanoseconds(data, start, field)
    found[(fraction < 0) | (fraction >= 1_000_000_000)] = NEVER
    return found


def _numbers(data: Bytes, start: Integers, offset: int, code: str) -> NDArray[Any]:
    """Return the numbers at an offset in each message, of a NumPy type with byte order."""
    width = int(code[2])
    out = np.empty((start.size, width), dtype=np.uint8)
    _cut(data, start, offset, out)
    return out.view(code).reshape(-1)


@njit(cache=True, nogil=True)
def _cut_doubles(data: Bytes, start: Integers, offsets: Integers, out: Bytes) -> None:
    """Copy eight bytes at each offset in each message, of so few messages at a time that the processor's cache holds them."""
    for first in range(0, start.size, 64):
        for j in range(offsets.size):
            for k in range(first, min(first + 64, start.size)):
                at, to = np.uint64(start[k] + offsets[j]), np.uint64(8 * k)
                for i in range(8):
                    out[j, to + np.uint64(i)] = data[at + np.uint64(i)]


@njit(cache=True, nogil=True)
def _cut(data: Bytes, start: Integers, offset: int, out: Bytes) -> None:
    """Copy the bytes at an offset in each message. Loops of fixed length and unsigned indices let the compiler copy at once."""
    if out.shape[1] == 8:
        for k in range(start.size):
            at = np.uint64(start[k] + offset)
            for i in range(8):
                out[k, i] = data[at + np.uint64(i)]
    elif out.shape[1] == 4:
        for k in range(start.size):
            at = np.uint64(start[k] + offset)
            for i in range(4):
                out[k, i] = data[at + np.uint64(i)]
    else:
        for k in range(start.size):
            for i in range(out.shape[1]):
                out[k, i] = data[start[k] + offset + i]
