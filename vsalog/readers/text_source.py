"""Files of text, compressed or not, and text that the CSV parser cannot take as it is, rewritten while it is read."""

from __future__ import annotations

import codecs
import gzip
import io
import zlib
from pathlib import Path
from typing import IO, cast

from vsalog.errors import ReadError
from vsalog.readers.compression import FREE_BYTES

_PIECE, _COMPRESSED_PIECE = 1 << 20, 1 << 16  # of a damaged compressed file, the last piece is lost
_GZIP = b"\x1f\x8b"
_MOST_RATIO = 200
"""Tables become ten times smaller; what becomes so much smaller is no recording but a bomb."""


def open_text(path: Path) -> IO[bytes]:
    """Open a file, decompressed where it is compressed with gzip.

    Raises
    ------
    OSError
        It cannot be opened.
    """
    file = path.open("rb")
    compressed = file.read(len(_GZIP)) == _GZIP
    file.seek(0)
    return cast(IO[bytes], BoundedGzip(path, file)) if compressed else file


class BoundedGzip(gzip.GzipFile):
    """A compressed file that refuses to become much larger than any recording would.

    Parameters
    ----------
    path : Path
        For messages.
    file : binary file
        The compressed one; is closed with this.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(fileobj=file, mode="rb")
        self._path = path
        self._compressed = file

    def read(self, size: int | None = -1) -> bytes:
        """Read some bytes.

        Raises
        ------
        ReadError
            Too much came out so far.
        """
        data = super().read(size)
        if self.tell() > max(FREE_BYTES, _MOST_RATIO * self._compressed.tell()):
            raise ReadError(
                f"{self._path}: becomes more than {_MOST_RATIO} times larger when it is decompressed, as no recording does;"
                " if it is one, decompress it first"
            )
        return data

    def close(self) -> None:
        """Close the compressed file too."""
        super().close()
        self._compressed.close()


def read_beginning(source: IO[bytes], most: int) -> bytes:
    """Return the first bytes of a file, of a damaged one as far as it goes."""
    parts: list[bytes] = []
    size = 0
    while size < most:
        try:
            part = source.read(min(16 * 1024, most - size))
        except (EOFError, zlib.error, gzip.BadGzipFile):
            break
        if not part:
            break
        parts.append(part)
        size += len(part)
    return b"".join(parts)


class TextSource(io.RawIOBase):
    """A file that gives UTF-8, with runs of blanks turned into one where asked for.

    Parameters
    ----------
    file : binary file
        What to read.
    encoding : str
        Python's name of its encoding; what does not decode is replaced.
    squeeze : bool
        Turn every run of blanks into a single space, and drop those at the ends of lines.

    Attributes
    ----------
    damage : str
        What is wrong with a compressed file, in words, "" where it is sound.
    """

    def __init__(self, file: IO[bytes], encoding: str, squeeze: bool) -> None:
        super().__init__()
        self._file = file
        self._decoder = codecs.getincrementaldecoder(encoding)("replace")
        self._squeeze = squeeze
        self._piece = _COMPRESSED_PIECE if isinstance(file, BoundedGzip) else _PIECE
        self._ready = b""
        self._line = ""
        self._ended = False
        self.damage = ""

    def readable(self) -> bool:
        """Tell that the file can be read."""
        return True

    def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
        """Fill `buffer`; return how many bytes were written, 0 at the end."""
        while not self._ready and not self._ended:
            self._fill()
        count = min(len(buffer), len(self._ready))
        buffer[:count] = self._ready[:count]
        self._ready = self._ready[count:]
        return count

    def _fill(self) -> None:
        try:
            raw = self._file.read(self._piece)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raw, self.damage = b"", _words(error)
        self._ended = not raw
        text = self._line + self._decoder.decode(raw, final=self._ended)
        self._line = ""
        if self._squeeze:
            text = text.replace("\r\n", "\n").replace("\r", "\n") if self._ended or not text.endswith("\r") else text
            cut = len(text) if self._ended else text.rfind("\n") + 1
            text, self._line = text[:cut], text[cut:]
            text = _squeezed(text)
        self._ready = text.encode("utf-8")


def _squeezed(text: str) -> str:
    """Turn runs of blanks into one, and drop those at the ends of lines; many times as fast as regular expressions."""
    text = text.replace("\t", " ")
    while "  " in text:
        text = text.replace("  ", " ")
    return text.replace("\n ", "\n").replace(" \n", "\n").removeprefix(" ").removesuffix(" ")


def _words(error: Exception) -> str:
    if "CRC" in str(error):
        return "the checksum of the compressed file does not match: some of its bytes have changed, values may be wrong"
    if isinstance(error, zlib.error):
        return f"the compressed file is damaged ({error}): read up to there, of which the last values may be wrong"
    return f"the compressed file is damaged or cut off ({error}): read up to there"
