"""Text that the CSV parser cannot take as it is, rewritten while it is read."""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from typing import IO

_BLANKS = re.compile(r"[ \t]+")
_EDGES = re.compile(r"^ | $", re.MULTILINE)
_CHUNK = 1 << 16


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
        Why a compressed file could not be read to its end, "" where it could.
    """

    def __init__(self, file: IO[bytes], encoding: str, squeeze: bool) -> None:
        super().__init__()
        self._file = file
        self._decoder = codecs.getincrementaldecoder(encoding)("replace")
        self._squeeze = squeeze
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
            raw = self._file.read(_CHUNK)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raw, self.damage = b"", str(error)
        self._ended = not raw
        text = self._line + self._decoder.decode(raw, final=self._ended)
        self._line = ""
        if self._squeeze:
            text = text.replace("\r\n", "\n").replace("\r", "\n") if self._ended or not text.endswith("\r") else text
            cut = len(text) if self._ended else text.rfind("\n") + 1
            text, self._line = text[:cut], text[cut:]
            text = _EDGES.sub("", _BLANKS.sub(" ", text))
        self._ready = text.encode("utf-8")
