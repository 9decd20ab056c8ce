"""Headers in the parts of a text table that are not read: below one, columns are others."""

from __future__ import annotations

import mmap
import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from vsalog.readers.limits import FIRST_ROWS, GLANCE_BYTES, MOST_STEPS
from vsalog.readers.repeated_header import FirstHeader, Line
from vsalog.readers.table_dialect import Dialect
from vsalog.readers.table_text import WHITESPACE


def last_header(path: Path, dialect: Dialect, begin: int, end: int) -> bytes:
    """Return the lines of the last header within a part of a file, b"" where there is none.

    Parameters
    ----------
    path : Path
        The table, not compressed.
    dialect : Dialect
        How it is written.
    begin, end : int
        The part [bytes], whole lines.
    """
    first = FirstHeader(dialect)
    header = b""
    run: list[bytes] = []
    lines: list[Line] = []
    last = begin
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        for at in _beginnings(text, first, dialect, max(begin - 1, 0), end):
            if at != last or len(run) == FIRST_ROWS:
                header = _header(first, run, lines) or header
                run, lines = [], []
            stop = text.find(b"\n", at, at + GLANCE_BYTES) + 1 or at + GLANCE_BYTES
            raw, last = text[at:stop], stop
            line = first.line(raw.decode(dialect.encoding, "replace").strip("\r\n"))
            if line is not None:
                run.append(raw)
                lines.append(line)
    return _header(first, run, lines) or header


def _header(first: FirstHeader, run: list[bytes], lines: list[Line]) -> bytes:
    """Return lines that follow one another if they are a header, else b""."""
    return b"".join(run) if lines and (first.order(lines) or first.names_others(lines, True)) else b""


def _beginnings(text: mmap.mmap, first: FirstHeader, dialect: Dialect, begin: int, end: int) -> Iterator[int]:
    """Yield where lines begin that are remarks, or have a word where values are."""
    ahead = dialect.names.index(first.values[0]) if first.values else 0
    remark, word = (
        rb"[ \t]*[#%]",
        rb"[ \t]*[#%\"A-Za-z_\x80-\xff]",
    )  # one class of letters is found many times as fast as several
    separator = b"" if dialect.separator == WHITESPACE else re.escape(dialect.separator.encode())
    cell = rb"[^" + separator + rb"\n]*" + separator if separator else rb"[^ \t\n]*[ \t]+"
    wordy = re.compile(
        rb"\n(?:" + remark + rb"|(?:" + cell + rb"){%d}" % ahead + word + rb")" if ahead else rb"\n" + word
    )
    for match in islice(wordy.finditer(text, begin, end), MOST_STEPS):
        yield match.start() + 1
