"""Columns of samples: arrays in memory or, of logs that are too long for it, in files that are mapped into it.

Either way they are NumPy arrays. Loops over whole columns use `parts`, which releases the memory of one part of a file before
the next one.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import weakref
from collections.abc import Iterator
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import ReadError

T = TypeVar("T", bound=np.generic)

ABSENT_BITS = 0x7FFA_5C31_9E07_D24B
ABSENT = np.int64(ABSENT_BITS).view(np.float64)
"""A value that a sample lacks: a NaN whose bits distinguish it from recorded ones."""

PART = 2**16
"""Rows per block: large enough for NumPy, small enough for memory."""


class Column(Generic[T]):
    """Samples that come block by block and become an array.

    Memory that was never written is zero and takes no room, so a column of zeros, as of unused covariances, is not written
    before another number comes. A file has no name, so that it disappears however the process ends. It
    is in the folder that TMPDIR names, or else in /var/tmp rather than /tmp, which is memory on many computers.

    Parameters
    ----------
    kind : type or dtype
        Of the numbers.
    room : int
        Samples that are expected.
    in_file : bool
        Whether they go to a file at once, see `to_file`.

    Attributes
    ----------
    blocks : int
        Blocks that were added.
    """

    def __init__(self, kind: type[T] | np.dtype[T], room: int = 0, *, in_file: bool = False) -> None:
        self._values: NDArray[T] = np.zeros(0 if in_file else room, kind)
        self._filled, self._zero = 0, True
        self._file: Any = None
        self.blocks = 0
        if in_file:
            self.to_file()

    def __len__(self) -> int:
        return self._filled

    def add(self, at: int, new: NDArray[T]) -> None:
        """Put a block's values in place; values missing in earlier blocks are absent.

        Raises
        ------
        ReadError
            It is in a file, and the disk is full.
        """
        while self._filled < at:
            self._append(np.full(min(at - self._filled, PART), ABSENT).astype(self._values.dtype))
        self._append(new)
        self.blocks += 1

    def append(self, new: NDArray[T]) -> None:
        """Append a block's values; errors as for `add`."""
        self.add(self._filled, new)

    def to_file(self) -> None:
        """Put all values, present and future, into a temporary file.

        Raises
        ------
        ReadError
            It cannot be made, or there is no room for it.
        """
        if self._file is not None:
            return
        try:
            # It is open until the column is complete.
            self._file = tempfile.TemporaryFile(dir=_folder(), buffering=0)  # noqa: SIM115
        except OSError as error:
            raise _refusal(error) from error
        weakref.finalize(self, self._file.close)
        there, self._values = self._values[: self._filled], self._values[:0]
        self._write(there)

    def so_far(self) -> NDArray[T]:
        """Return the values so far; errors as for `add`."""
        if self._file is None:
            return self._values[: self._filled]
        if not self._filled:
            return self._values
        try:
            return np.frombuffer(mmap.mmap(self._file.fileno(), 0), self._values.dtype)
        except OSError as error:
            raise _refusal(error) from error

    def whole(self, count: int) -> NDArray[T]:
        """Return all values, absent at the end where the last blocks had none; no more can be added."""
        self.add(count, np.empty(0, self._values.dtype))
        if self._file is not None:
            self._values = self.so_far()
            self._file.close()
            self._file = None
        elif self._values.size > count:
            self._values.resize(count, refcheck=False)
        return self._values

    def _append(self, new: NDArray[T]) -> None:
        end = self._filled + len(new)
        if self._file is not None:
            self._write(new)
        else:
            if end > self._values.size:
                smaller = self._values[: self._filled]
                self._values = np.zeros(max(end, 2 * self._values.size), dtype=self._values.dtype)
                if not self._zero:
                    self._values[: self._filled] = smaller
            self._zero = self._zero and not new.view(f"u{new.itemsize}").any()
            if not self._zero:
                self._values[self._filled : end] = new
        self._filled = end

    def _write(self, new: NDArray[T]) -> None:
        assert self._file is not None
        left = np.ascontiguousarray(new).data.cast("B") if new.size else memoryview(b"")
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            raise _refusal(error) from error


def is_mapped(values: NDArray[Any]) -> bool:
    """Return whether values are mapped from a file."""
    return _file_of(values) is not None


def let_go(*columns: NDArray[Any]) -> None:
    """Release the memory of values mapped from a file; they are read again on the next access."""
    for values in columns:
        if (found := _file_of(values)) is not None and hasattr(found[0], "madvise"):
            file, at = found
            begin = at - at % mmap.PAGESIZE
            file.madvise(mmap.MADV_DONTNEED, begin, at + values.nbytes - begin)


def parts(*columns: NDArray[Any]) -> Iterator[tuple[int, int]]:
    """Yield first and last row, the last excluded, of pieces of columns that are processed together."""
    for first in range(0, len(columns[0]), PART):
        last = min(first + PART, len(columns[0]))
        yield first, last
        # The piece before, too, of which some rows may have been read again.
        let_go(*(column[max(0, first - PART) : last] for column in columns))


def _file_of(values: NDArray[Any]) -> tuple[mmap.mmap, int] | None:
    """Return the file of values, and their offset in it; None for values in memory."""
    whole = values
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    buffer = whole.base
    if not values.nbytes or not isinstance(buffer, memoryview) or not isinstance(buffer.obj, mmap.mmap):
        return None
    return buffer.obj, values.__array_interface__["data"][0] - whole.__array_interface__["data"][0]


def _folder() -> str:
    """Return the folder for large temporary files."""
    if "TMPDIR" not in os.environ and os.access("/var/tmp", os.W_OK):
        return "/var/tmp"
    return tempfile.gettempdir()


def _refusal(error: OSError) -> ReadError:
    return ReadError(
        f"a temporary file for data too large for memory cannot be written in {_folder()}:"
        f" {error.strerror or error}; set TMPDIR to a folder with more room, or cut the log with --start and --end"
    )
