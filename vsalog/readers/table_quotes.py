"""Quotes that a text table has only further down, as around the first number that sets thousands apart."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import islice
from pathlib import Path

from vsalog.core.memory import PIECE_BYTES
from vsalog.readers.limits import SAMPLE_ROWS
from vsalog.readers.table_dialect import Dialect, has_quotes
from vsalog.readers.table_notation import Notation
from vsalog.readers.table_text import split

_WHOLE = re.compile(r"^[+-]?\d+$")


def heeding_quotes(path: Path, dialect: Dialect) -> Dialect:
    """Return how a table is written that is not compressed, if quotes are first met below its first rows.

    A quote is damage in a table without, and would swallow the lines up to the next: most lines that have some must have
    as many cells as a row when they are heeded.
    """
    if dialect.quoted or dialect.encoding.startswith("utf-16"):
        return dialect
    lines = [line.decode("latin-1") for line in _lines_with_quotes(path, dialect.skip_lines)]
    fitting = sum(has_quotes(line) and len(split(line, dialect.separator)) == len(dialect.names) for line in lines)
    if 2 * fitting <= len(lines):
        return dialect
    return replace(dialect, quoted=True, notations=_with_thousands(dialect))


def _lines_with_quotes(path: Path, skipped: int) -> list[bytes]:
    """Return the first lines with quotes below some others."""
    with path.open("rb") as file:
        for _ in islice(file, skipped):
            pass
        position = file.tell()
        while (piece := file.read(PIECE_BYTES)) and b'"' not in piece:
            position += len(piece)
        if not piece:
            return []
        file.seek(position + max(piece.rfind(b"\n", 0, piece.index(b'"')), 0))
        text = file.read(PIECE_BYTES)
    return [line for line in text.splitlines() if b'"' in line][:SAMPLE_ROWS]


def _with_thousands(dialect: Dialect) -> tuple[Notation, ...]:
    """Return how columns are written, those of whole numbers with thousands set apart: a comma needs quotes then."""
    if dialect.separator != "," or any(notation.decimal_comma for notation in dialect.notations):
        return dialect.notations
    columns = zip(*dialect.rows, strict=True)
    whole = [all(_WHOLE.match(cell) for cell in cells) for cells in columns]
    return tuple(replace(n, grouped=n.grouped or w) for n, w in zip(dialect.notations, whole, strict=True))
