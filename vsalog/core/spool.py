"""Columns in a temporary file, for logs that do not fit in memory."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import ReadError

Values = NDArray[Any]
Kind = type[np.int64 | np.float64]

ABSENT_BITS = 0x7FFA_5C31_9E07_D24B
ABSENT = np.int64(ABSENT_BITS).view(np.float64)
"""What a sample does not carry: a NaN as any other, but told from those that are recorded by its bits."""

EXTENT = 2**13
"""Values of a column that lie together in the file."""

PART = 2**16
"""Rows worked on at a time: large enough for NumPy, small enough not to weigh in memory."""


class Column(Protocol):
    """Numbers that can be read piece by piece: an array, or a column in a temporary file."""

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> Values: ...


class Spool:
    """A temporary file that columns share; it has no name, so that nothing is left behind however the process ends.

    It lies in the folder that TMPDIR names, or else in /var/tmp rather than /tmp, which is memory on many computers.

    Raises
    ------
    ReadError
        The file cannot be made.
    """

    def __init__(self) -> None:
        self.folder = _folder()
        self._end = 0
        try:
            # It is open as long as its columns are.
            self._file: Any = tempfile.TemporaryFile(dir=self.folder, buffering=0)  # noqa: SIM115
        except OSError as error:
            raise self._refusal(error) from error
        weakref.finalize(self, self._file.close)

    def append(self, data: Values) -> int:
        """Write values behind all others and return where they begin.

        Raises
        ------
        ReadError
            There is no room left.
        """
        at = self._end
        left = np.ascontiguousarray(data).data.cast("B")
        try:
            self._file.seek(at)
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            raise self._refusal(error) from error
        self._end += data.nbytes
        return at

    def read(self, at: int, into: Values) -> None:
        """Read values from where they begin."""
        left = into.data.cast("B")
        self._file.seek(at)
        while left:
            count = self._file.readinto(left)
            if not count:
                raise ReadError(f"a temporary file in {self.folder} has become shorter")
            left = left[count:]

    def _refusal(self, error: OSError) -> ReadError:
        return ReadError(
            f"the log is too large for memory, and a temporary file for its columns cannot be written in {self.folder}:"
            f" {error.strerror or error}; set TMPDIR to a folder with more room, or cut the log with --start and --end"
        )


def _folder() -> str:
    """Return the folder that temporary files which may be large belong into."""
    if "TMPDIR" not in os.environ and os.access("/var/tmp", os.W_OK):
        return "/var/tmp"
    return tempfile.gettempdir()


class SpooledColumn:
    """Values in a spool: appended at the end, read anywhere.

    Parameters
    ----------
    spool : Spool
        The file they go to.
    kind : type
        int64 or float64.
    """

    def __init__(self, spool: Spool, kind: Kind) -> None:
        self._spool = spool
        self._kind: np.dtype[Any] = np.dtype(kind)
        self._extents: list[int] = []
        self._waiting: list[Values] = []
        self._waiting_count = 0
        self.filled = 0
        self.blocks = 0

    def __len__(self) -> int:
        return self.filled

    def add(self, at: int, new: Values) -> None:
        """Put a block's values in place; what blocks before it had not is absent."""
        while self.filled < at:
            self._append(np.full(min(at - self.filled, EXTENT), ABSENT).astype(self._kind))
        self._append(new)
        self.blocks += 1

    def whole(self, count: int) -> SpooledColumn:
        """Return the column with so many values, absent at the end where the last blocks had none."""
        self.add(count, np.empty(0, self._kind))
        return self

    def __getitem__(self, rows: slice, /) -> Values:
        """Return some values, in order and without steps."""
        first, last, _ = rows.indices(self.filled)
        out = np.empty(max(last - first, 0), self._kind)
        at = first
        while at < last:
            extent, within = divmod(at, EXTENT)
            count = min(EXTENT - within, last - at)
            part = out[at - first : at - first + count]
            if extent < len(self._extents):
                self._spool.read(self._extents[extent] + within * self._kind.itemsize, part)
            else:
                part[:] = self._tail()[within : within + count]
            at += count
        return out

    def _append(self, new: Values) -> None:
        while new.size:
            taken = new[: EXTENT - self._waiting_count]
            # A copy: what is handed over may be a part of something large.
            self._waiting.append(taken.copy())
            self._waiting_count += taken.size
            self.filled += taken.size
            new = new[taken.size :]
            if self._waiting_count == EXTENT:
                self._extents.append(self._spool.append(self._tail()))
                self._waiting, self._waiting_count = [], 0

    def _tail(self) -> Values:
        """Return the values that are not written yet, as one array."""
        if len(self._waiting) != 1:
            self._waiting = [np.concatenate(self._waiting)]
        return self._waiting[0]


class ColumnPart:
    """A stretch of a column's rows.

    Parameters
    ----------
    column : Column
        The whole.
    first, last : int
        Rows from the first to before the last.
    """

    def __init__(self, column: Column, first: int, last: int) -> None:
        self._column, self._first, self._last = column, first, last

    def __len__(self) -> int:
        return self._last - self._first

    def __getitem__(self, rows: slice, /) -> Values:
        first, last, _ = rows.indices(len(self))
        return self._column[self._first + first : self._first + max(first, last)]


def in_memory(column: Column) -> Values:
    """Return all of a column as an array."""
    return column if isinstance(column, np.ndarray) else column[:]


def parts(length: int) -> Iterator[tuple[int, int]]:
    """Yield first row and last row, that one excluded, of pieces of so many rows."""
    for first in range(0, length, PART):
        yield first, min(first + PART, length)


def row_of(stamps: Column, stamp: int) -> int:
    """Return the first row whose stamp is not before a given one, as `np.searchsorted` does."""
    low, high = 0, len(stamps)
    while high - low > PART:
        middle = (low + high) // 2
        if int(stamps[middle : middle + 1][0]) < stamp:
            low = middle + 1
        else:
            high = middle
    return low + int(np.searchsorted(stamps[low:high], stamp))
