"""The text of a table: decompressed, in UTF-8, and in blocks of whole lines."""

from __future__ import annotations

import codecs
import io
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import IO

import numpy as np
import pyarrow as pa

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding
from vsalog.core.memory import PIECE_BYTES
from vsalog.core.significance import REPEATS
from vsalog.readers.compression import FILE_RATIO
from vsalog.readers.limits import DECODED_BYTES, GLANCE_BYTES, PACKED_BYTES
from vsalog.readers.tables.text import WHITESPACE, is_comment, printable_cell, split

DAMAGE = (EOFError, zlib.error)
"""The exceptions of a damaged compressed file."""

_CHECKS = ("data check", "length check")
"""The words of zlib, which has one kind of error, for the checksum and the length at the end."""

_GZIP = b"\x1f\x8b"


class WindowBits(IntEnum):
    """Values of zlib's parameter wbits: window size, and the header and checksum to expect (zlib's manual, inflateInit2)."""

    GZIP = 16 + zlib.MAX_WBITS


Source = io.BufferedIOBase | io.RawIOBase
"""A file of bytes."""


def open_text(path: Path) -> io.BufferedReader | BoundedGzip:
    """Open a file, decompressed where it is compressed with gzip.

    Raises
    ------
    OSError
        It cannot be opened.
    """
    file = path.open("rb")
    compressed = file.read(len(_GZIP)) == _GZIP
    file.seek(0)
    return BoundedGzip(path, file) if compressed else file


class BoundedGzip(io.RawIOBase):
    """A compressed file: all data before damage, limited to the size of any recording.

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
        """Return that the file can be read."""
        return True

    def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
        """Fill `buffer`; return how many bytes were written, 0 at the end.

        Raises
        ------
        zlib.error, EOFError
            The file is damaged or cut off here.
        ReadError
            Too much was decompressed so far.
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
        """Return whether there is more, and read some of it."""
        self._left = self._left or self._compressed.read(GLANCE_BYTES)
        if not self._stream.eof:
            return True
        while self._left and not (left := self._left.lstrip(b"\0")):  # files may be filled up with zeros
            self._left = self._compressed.read(GLANCE_BYTES)
        if self._left:
            self._left, self._stream = left, zlib.decompressobj(WindowBits.GZIP)
        return bool(self._left)

    def _some(self, most: int) -> bytes:
        """Return the next decompressed data; of damaged bytes, ever fewer are taken until they end before the damage."""
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


def read_beginning(source: Source, most: int) -> bytes:
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


def without_holes(text: bytes) -> bytes:
    """Return text without runs of zeros, which a power failure leaves in files being written."""
    return re.sub(rb"\0{16,}", b"", text)


def trouble_at_end(path: Path) -> str:
    """Return the fault of a compressed file, all of which is read.

    ``changed`` for changed bytes; ``missing`` for its end, which has the checksum; "" for none.
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


class Lines:
    """The lines of a table in UTF-8, as its parser can take them: single blanks between cells, no labels in them.

    Parameters
    ----------
    file : binary file
        The input.
    encoding : str
        Python's name of its encoding; what does not decode is replaced.
    separator : str
        The separator of cells. If it is blanks, every run of them becomes a single one.
    labels : sequence of str
        The text before the number in every cell, by column; empty for none.

    Attributes
    ----------
    findings : list of Finding
        Findings about the end; complete once all blocks are read.
    """

    def __init__(self, file: Source, encoding: str, separator: str, labels: Sequence[str] = ()) -> None:
        self.findings: list[Finding] = []
        self._file = file
        self._above: bytes | bytearray = b""
        self._buffer = bytearray(DECODED_BYTES)
        self._separator = separator
        self._decoder = None if encoding == "utf-8" else codecs.getincrementaldecoder(encoding)("replace")
        mark = re.escape(separator)
        cells = f"{mark} *".join(rf"{re.escape(label)} *[:=] *([^\r\n{mark}]*)" for label in labels)
        self._labelled = re.compile(rf"(?m)^ *{cells}(?=\r?$)".encode()) if labels else None
        self._bare = separator.encode().join(rb"\%d" % (i + 1) for i in range(len(labels)))

    def blocks(self) -> Iterator[tuple[pa.Buffer, bool]]:
        """Yield the text, cut at ends of lines outside quotes, and whether it has quotes; a line that is too long has no end."""
        rest: bytes | bytearray = b""
        ended = damaged = False
        while not ended:
            text, damaged = self._behind(rest)
            ended = len(text) == len(rest)
            if self._decoder is not None:
                text = rest + self._decoder.decode(text[len(rest) :], final=ended).encode()
            # A line that is not whole waits for its end, which never comes where the file is damaged: half a number is another.
            end = _end_of_lines(text)
            if ended and not damaged:
                end = self._end_of_file(text, end)
            elif len(text) - end > PACKED_BYTES:
                end = len(text)
            rest = text[end:]
            if end:
                self._above = text[max(end - GLANCE_BYTES, 0) : end]
                yield self._plain(text, end), b'"' in text

    def _behind(self, rest: bytes | bytearray) -> tuple[bytes | bytearray, bool]:
        """Return the next text, and whether the file is damaged there; its memory is reused for the next."""
        if len(self._buffer) < 2 * len(rest):
            self._buffer = bytearray(4 * len(rest))
        self._buffer[: len(rest)] = rest
        size, damaged = len(rest), False
        try:
            size += self._file.readinto(memoryview(self._buffer)[size:]) or 0
        except DAMAGE as error:
            self.findings.append(_damage(error))
            damaged = True
        return self._buffer if size == len(self._buffer) else bytes(memoryview(self._buffer)[:size]), damaged

    def _end_of_file(self, text: bytes | bytearray, end: int) -> int:
        """Return where the text ends, without a last line that has no end and may be cut off."""
        last = text[end:].decode("utf-8", "replace")
        above = (self._above + text[max(end - GLANCE_BYTES, 0) : end]).decode("utf-8", "replace").splitlines()
        if not may_be_cut(above, last, self._separator):
            return len(text)
        self.findings.append(Finding(code="table.last_line_left_out", evidence={"line": printable_cell(last)}))
        return end

    def _plain(self, text: bytes | bytearray, end: int) -> pa.Buffer:
        if self._separator != WHITESPACE and self._labelled is None and text.isascii():
            return pa.py_buffer(text).slice(0, end)
        text = text[:end].decode("utf-8", "replace").replace("\ufeff", "").encode()
        if self._separator == WHITESPACE:
            text = _squeezed(text)
        return pa.py_buffer(text if self._labelled is None else self._labelled.sub(self._bare, text))


def _end_of_lines(text: bytes | bytearray) -> int:
    """Return where the last whole line ends that no quotes join with the next, 0 where there is none."""
    mark = b"\n" if b"\n" in text else b"\r"
    end = last = text.rfind(mark) + 1
    if b'"' not in text:
        return end
    quotes = text.count(b'"', 0, end)
    while quotes % 2 and end:
        before = text.rfind(mark, 0, end - 1) + 1
        quotes -= text.count(b'"', before, end)
        end = before
    return end if last - end < GLANCE_BYTES else last  # a single quote is damage


def _squeezed(text: bytes) -> bytes:
    """Turn runs of blanks into one, and drop those at the ends of lines; many times as fast as regular expressions."""
    text = text.replace(b"\t", b" ").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    while b"  " in text:
        text = text.replace(b"  ", b" ")
    return text.replace(b"\n ", b"\n").replace(b" \n", b"\n").removeprefix(b" ").removesuffix(b" ")


def may_be_cut(lines: Sequence[str], last: str, separator: str) -> bool:
    """Return whether the last cell of a line without an end may have been longer.

    It is whole where it is as long as the longest above, or where more decimals would make no other number in single precision,
    unless numbers may have an exponent or not.

    Parameters
    ----------
    lines : sequence of str
        Those ahead of it.
    last : str
        The line.
    separator : str
        What separates cells.
    """
    cells = split(last, separator)
    rows = [split(line, separator) for line in lines if line.strip() and not is_comment(line)]
    above = [row[-1].lstrip("+-") for row in rows[1:] if len(row) == len(cells)]  # the first may be cut, or the header
    if not last.strip() or is_comment(last) or last.endswith('"') or len(above) + 1 < REPEATS:
        return False
    widths = {len(cell) for cell in above}
    cell = cells[-1].lstrip("+-")
    exponents = len(widths) > 1 and any("e" in one.lower() for one in above) and "e" not in cell.lower()
    return exponents or (len(cell) < max(widths) and _may_lack_digits(cell, above))


def _may_lack_digits(cell: str, above: Sequence[str]) -> bool:
    """Return whether more digits would make another number of a cell, in single precision of the largest above."""
    decimals = len(cell.replace(",", ".").partition(".")[2])
    largest = 0.0
    for one in above:
        with suppress(ValueError):
            largest = max(largest, float(one.replace(",", ".")))
    return not decimals or 10.0**-decimals > float(np.finfo(np.float32).resolution) * largest


def _damage(error: Exception) -> Finding:
    evidence = {"reason": str(error)}
    if any(check in str(error) for check in _CHECKS):
        return Finding(code="compressed.bad_checksum", evidence=evidence)
    ended = not isinstance(error, zlib.error)
    return Finding(code="compressed.truncated" if ended else "compressed.damaged", evidence=evidence)
