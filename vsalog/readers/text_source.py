"""Files of text, compressed or not, and text that the CSV parser cannot take as it is, rewritten while it is read."""

from __future__ import annotations

import codecs
import io
import re
import zlib
from enum import IntEnum
from pathlib import Path
from typing import IO, cast

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding
from vsalog.core.memory import PIECE_BYTES
from vsalog.readers.compression import FILE_RATIO
from vsalog.readers.last_line import may_be_cut
from vsalog.readers.limits import GLANCE_BYTES, PACKED_BYTES
from vsalog.readers.table_text import WHITESPACE

DAMAGE = (EOFError, zlib.error)
"""What a damaged compressed file raises."""

_CHECKS = ("data check", "length check")
"""What zlib, which has one kind of error, calls the checksum and the length at the end."""

_GZIP = b"\x1f\x8b"


class WindowBits(IntEnum):
    """Values of zlib's parameter wbits: window size, and the header and checksum to expect (zlib's manual, inflateInit2)."""

    GZIP = 16 + zlib.MAX_WBITS


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


class BoundedGzip(io.RawIOBase):
    """A compressed file: all that comes out ahead of damage, and no more than any recording would hold.

    Parameters
    ----------
    path : Path
        For messages.
    file : binary file
        The compressed one; is closed with this.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__()
        self._path = path
        self._compressed = file
        self._stream = zlib.decompressobj(WindowBits.GZIP)
        self._left = b""
        self._size = 0

    def readable(self) -> bool:
        """Tell that the file can be read."""
        return True

    def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
        """Fill `buffer`; return how many bytes were written, 0 at the end.

        Raises
        ------
        zlib.error, EOFError
            The file is damaged or cut off here.
        ReadError
            Too much came out so far.
        """
        data = b""
        while not data and self._more():
            data = self._some(len(buffer))
        self._size += len(data)
        if self._size > max(PACKED_BYTES, FILE_RATIO * self._compressed.tell()):
            raise ReadError(
                f"becomes more than {FILE_RATIO} times larger when it is decompressed, as no recording does;"
                " if it is one, decompress it first",
                self._path,
            )
        buffer[: len(data)] = data
        return len(data)

    def _more(self) -> bool:
        """Tell whether more is to come, and have some of it at hand."""
        self._left = self._left or self._compressed.read(GLANCE_BYTES)
        if not self._stream.eof:
            return True
        while self._left and not (left := self._left.lstrip(b"\0")):  # files may be filled up with zeros
            self._left = self._compressed.read(GLANCE_BYTES)
        if self._left:
            self._left, self._stream = left, zlib.decompressobj(WindowBits.GZIP)
        return bool(self._left)

    def _some(self, most: int) -> bytes:
        """Return what comes out next; of damaged bytes, ever fewer are taken until they end ahead of the damage."""
        taken = len(self._left)
        while True:
            stream = self._stream.copy()
            try:
                data = stream.decompress(self._left[:taken], most)
            except zlib.error:
                if taken == 1:
                    raise
                taken //= 2
                continue
            if not taken and not data:
                raise EOFError("it ends too early")
            self._left = (stream.unconsumed_tail or stream.unused_data) + self._left[taken:]
            self._stream = stream
            return data

    def close(self) -> None:
        """Close the compressed file too."""
        super().close()
        self._compressed.close()


def is_utf8(file: IO[bytes]) -> bool:
    """Tell whether all of a file, which is read from its beginning and left there, is UTF-8, as far as bytes tell."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        while raw := file.read(PIECE_BYTES):
            decoder.decode(raw)
        decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        return False
    finally:
        file.seek(0)
    return True


def read_beginning(source: IO[bytes], most: int) -> bytes:
    """Return the first bytes of a file, of a damaged one as far as it goes."""
    parts: list[bytes] = []
    size = 0
    while size < most:
        try:
            part = source.read(min(16 * 1024, most - size))
        except DAMAGE:
            break
        if not part:
            break
        parts.append(part)
        size += len(part)
    return b"".join(parts)


def trouble_at_end(path: Path) -> str:
    """Return what is wrong with a compressed file, all of which is read.

    ``changed`` are bytes of it; ``missing`` is its end, which would tell of such; "" is nothing.
    """
    try:
        with open_text(path) as file:
            while file.read(PIECE_BYTES):
                pass
    except zlib.error:
        return "changed"
    except EOFError:
        return "missing"
    return ""


class TextSource(io.RawIOBase):
    """A file that gives UTF-8, with runs of blanks turned into one where asked for.

    Parameters
    ----------
    file : binary file
        What to read.
    encoding : str
        Python's name of its encoding; what does not decode is replaced.
    separator : str
        What separates cells. Where that is blanks, every run of them becomes a single space, and those at the ends of lines
        are dropped.

    Attributes
    ----------
    cut : str
        The last line where it was left out, as it has no end and may be cut off; else "".
    damage : Finding or None
        What is wrong with a compressed file.
    """

    def __init__(self, file: IO[bytes], encoding: str, separator: str) -> None:
        super().__init__()
        self._file = file
        self._decoder = codecs.getincrementaldecoder(encoding)("replace")
        self._separator = separator
        self._squeeze = separator == WHITESPACE
        self._ready = b""
        self._line = ""
        self._ended = False
        self._tail = ""
        self.damage: Finding | None = None
        self.cut = ""

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
            raw = self._file.read(PIECE_BYTES)
        except DAMAGE as error:
            raw, self.damage = b"", _damage(error)
        self._ended = not raw
        text = self._line + self._decoder.decode(raw, final=self._ended)
        if self._squeeze:
            half = "\r" * (text.endswith("\r") and not self._ended)  # its "\n" may be still to come
            text = text.removesuffix(half).replace("\r\n", "\n").replace("\r", "\n") + half
        end = text.rfind("\n") if self._squeeze else max(text.rfind("\n"), text.rfind("\r"))
        # A line that is not whole waits for its end, which never comes where the file is damaged: half a number is another one.
        whole = self._ended and not self.damage
        cut = len(text) if whole or len(text) > PACKED_BYTES else end + 1
        if whole and may_be_cut(
            re.split(r"\r\n|\n|\r", self._tail + text[: end + 1]), text[end + 1 :], self._separator
        ):
            cut, self.cut = end + 1, text[end + 1 :]
        text, self._line = text[:cut], text[cut:]
        self._tail = text[-GLANCE_BYTES:] or self._tail
        self._ready = (_squeezed(text) if self._squeeze else text).encode("utf-8")


def _squeezed(text: str) -> str:
    """Turn runs of blanks into one, and drop those at the ends of lines; many times as fast as regular expressions."""
    text = text.replace("\t", " ")
    while "  " in text:
        text = text.replace("  ", " ")
    return text.replace("\n ", "\n").replace(" \n", "\n").removeprefix(" ").removesuffix(" ")


def _damage(error: Exception) -> Finding:
    evidence = {"reason": str(error)}
    if any(check in str(error) for check in _CHECKS):
        return Finding(code="compressed.bad_checksum", evidence=evidence)
    ended = not isinstance(error, zlib.error)
    return Finding(code="compressed.truncated" if ended else "compressed.damaged", evidence=evidence)
