"""Files whose names libraries cannot be given, for names are bytes, and some of them are no text; and parts of files."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote


def is_text(path: Path) -> bool:
    """Tell whether a path is one that libraries can be given that take text."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def for_arrow(path: Path) -> str | IO[bytes]:
    """Return what Arrow can read a file by: its path, or the file, opened, where the path is no text."""
    return str(path) if is_text(path) else path.open("rb")


def for_sqlite(path: Path) -> str:
    """Return a path as the address that SQLite is given, without options."""
    return f"file:{quote(os.fsencode(path.absolute()))}"


class FilePart(io.RawIOBase):
    """A stretch of a file as a file of its own, for reading.

    Parameters
    ----------
    path : Path
        The file.
    first, last : int
        From which byte to before which.
    """

    def __init__(self, path: Path, first: int, last: int) -> None:
        super().__init__()
        self._file = path.open("rb", buffering=0)
        self._first, self._size, self._at = first, last - first, 0

    @classmethod
    def opened(cls, path: Path, first: int, last: int) -> IO[bytes]:
        """Open a stretch of a file, buffered."""
        return io.BufferedReader(cls(path, first, last))

    def readable(self) -> bool:
        """Tell that it can be read."""
        return True

    def seekable(self) -> bool:
        """Tell that reading can go on anywhere."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go to a byte of the stretch."""
        self._at = offset + (0, self._at, self._size)[whence]
        return self._at

    def readinto(self, buffer: Any) -> int:
        """Read up to the end of the stretch."""
        self._file.seek(self._first + self._at)
        count = self._file.readinto(memoryview(buffer)[: max(0, self._size - self._at)]) or 0
        self._at += count
        return count

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()
