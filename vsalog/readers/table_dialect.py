"""How a text table is written: encoding, separator, decimal mark, header."""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from vsalog.readers.headers import unique_names
from vsalog.units import split_header

WHITESPACE = " "
SEPARATORS = (",", ";", "\t", "|", WHITESPACE)
SAMPLE_LINES = 200

NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
_NUMBER = re.compile(NUMBER)
_COMMA_NUMBER = re.compile(r"^[+-]?\d*,\d+([eE][+-]?\d+)?$")
_POINT_NUMBER = re.compile(r"^[+-]?\d*\.\d+([eE][+-]?\d+)?$")
_NOT_A_NUMBER = re.compile(r"^(nan|[+-]?inf(inity)?|n/?a|null|none)$", re.IGNORECASE)
_DATE = re.compile(r"^\d{4}-\d\d-\d\d([T ].*)?$|^\d{1,2}:\d\d(:\d\d([.,]\d+)?)?$")


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text table is written.

    Attributes
    ----------
    encoding : str
        Python's name of it.
    separator : str
        One of `SEPARATORS`; `WHITESPACE` stands for any run of blanks.
    decimal_comma : bool
        Numbers are written ``1,5``.
    skip_lines : int
        Lines before the first row of values.
    names, units : tuple
        Of the columns; units None where the header states none.
    rows : tuple of tuple of str
        The first rows.
    lines : tuple of int
        The lines they stand in, counted from 1.
    notes : tuple of str
        What is worth telling.
    """

    encoding: str
    separator: str
    decimal_comma: bool
    skip_lines: int
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    notes: tuple[str, ...]


def detect(head: bytes, whole: bool) -> Dialect:
    """Tell how a text table is written.

    Parameters
    ----------
    head : bytes
        The start of the file.
    whole : bool
        Whether that is all of it; otherwise the last line is taken to be cut off.
    """
    encoding = detect_encoding(head)
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, final=whole).removeprefix("\ufeff")
    lines = re.split(r"\r\n|\n|\r", text)
    if not whole and len(lines) > 1:
        lines.pop()
    lines = lines[:SAMPLE_LINES]
    separator = _separator([line for line in lines if line.strip() and not is_comment(line)])
    table = [(i, split(line, separator)) for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    width = _width([cells for _, cells in table])
    decimal_comma = _decimal_comma([cells for _, cells in table], separator)
    return _with_header(lines, table, width, encoding, separator, decimal_comma)


def detect_encoding(head: bytes) -> str:
    """Return Python's name of a text's encoding: by its mark, else UTF-8 where it is valid, else Latin-1."""
    if head.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if head[1::2].count(0) > len(head) // 4:
        return "utf-16-le"
    if head[0::2].count(0) > len(head) // 4:
        return "utf-16-be"
    try:
        codecs.getincrementaldecoder("utf-8")("strict").decode(head)
    except UnicodeDecodeError:
        return "cp1252" if not set(head) & {0x81, 0x8D, 0x8F, 0x90, 0x9D} else "latin-1"
    return "utf-8"


def is_comment(line: str) -> bool:
    """Tell whether a line is a remark; ``%time`` starts the header of a rostopic export."""
    start = line.lstrip()
    return start.startswith("#") or (start.startswith("%") and not start.startswith("%time"))


def split(line: str, separator: str) -> list[str]:
    """Split a line into its cells, without the blanks around them."""
    if separator == WHITESPACE:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    except (csv.Error, StopIteration):
        return line.split(separator)


def is_value(cell: str, decimal_comma: bool) -> bool:
    """Tell whether a cell holds a number, a date or a word for none."""
    if _NUMBER.match(cell) or _NOT_A_NUMBER.match(cell) or _DATE.match(cell):
        return True
    return decimal_comma and _COMMA_NUMBER.match(cell) is not None


def _separator(lines: Sequence[str]) -> str:
    """Return the separator that splits the lines most evenly into values."""
    best, best_score = ",", 0.0
    for separator in SEPARATORS:
        rows = [split(line, separator) for line in lines]
        width = _width(rows)
        if width < 2:
            continue
        even = sum(len(row) == width for row in rows) / len(rows)
        cells = [cell for row in rows for cell in row if cell]
        values = sum(is_value(cell, separator != ",") for cell in cells) / max(len(cells), 1)
        score = even * (0.05 + values)
        if score > best_score * 1.001:
            best, best_score = separator, score
    return best


def _width(rows: Sequence[Sequence[str]]) -> int:
    """Return how many cells most rows have."""
    counts = Counter(len(row) for row in rows)
    return counts.most_common(1)[0][0] if counts else 0


def _decimal_comma(rows: Sequence[Sequence[str]], separator: str) -> bool:
    cells = [cell for row in rows for cell in row]
    comma = sum(_COMMA_NUMBER.match(cell) is not None for cell in cells)
    point = sum(_POINT_NUMBER.match(cell) is not None for cell in cells)
    return comma > 0 and point == 0


def _with_header(
    lines: Sequence[str],
    table: Sequence[tuple[int, list[str]]],
    width: int,
    encoding: str,
    separator: str,
    decimal_comma: bool,
) -> Dialect:
    """Find the header and the first row of values."""
    notes: list[str] = []
    start = next((k for k, (_, cells) in enumerate(table) if len(cells) in (width, width - 1)), 0)
    start = _skip_preamble(table, start, width, decimal_comma)
    names: list[str] | None = None
    units: list[str | None] = [None] * width
    skip = table[start][0] if table else len(lines)
    rest = [cells for _, cells in table[start:]]
    if rest and _is_header(rest, decimal_comma):
        names = _aligned(rest[0], rest[1:], width, notes)
        rest = rest[1:]
        skip = table[start + 1][0] if start + 1 < len(table) else len(lines)
        if len(rest) > 1 and _is_unit_row(rest[0], rest[1], decimal_comma):
            units = [cell.strip("[]() ") or None for cell in rest[0]] + units[len(rest[0]) :]
            rest = rest[1:]
            skip = table[start + 2][0]
    elif len(rest) and len(rest[0]) == width:
        names = _comment_header(lines[:skip], width)
    if names is None:
        notes.append("the table has no header: its columns are called column_0, column_1, …")
        names = [""] * width
    if names and names[0].startswith("%time"):
        names = [name.removeprefix("field.") for name in names]
    pairs = [split_header(name) for name in names]
    return Dialect(
        encoding=encoding,
        separator=separator,
        decimal_comma=decimal_comma,
        skip_lines=skip,
        names=tuple(unique_names([name for name, _ in pairs])),
        units=tuple(unit or own for (_, unit), own in zip(pairs, units, strict=True)),
        rows=tuple(tuple(row) for row in rest if len(row) == width),
        lines=tuple(i + 1 for i, row in table[len(table) - len(rest) :] if len(row) == width),
        notes=tuple(notes),
    )


def _skip_preamble(table: Sequence[tuple[int, list[str]]], start: int, width: int, decimal_comma: bool) -> int:
    """Step over lines of text ahead of the header that happen to have nearly as many cells."""
    while start + 2 < len(table):
        here, following = table[start][1], table[start + 1][1]
        wordy = not any(is_value(cell, decimal_comma) for row in (here, following) for cell in row if cell)
        if len(here) == width or len(following) < len(here) or not wordy:
            return start
        start += 1
    return start


def _is_header(rows: Sequence[Sequence[str]], decimal_comma: bool) -> bool:
    """Tell whether the first row names the columns: it has words where the others have values, or only words."""
    first = rows[0]
    words = [i for i, cell in enumerate(first) if cell and not is_value(cell, decimal_comma)]
    if not words:
        return False
    if len(words) == sum(bool(cell) for cell in first):
        return True
    shift = len(rows[1]) - len(first) if len(rows) > 1 else 0
    for i in words:
        below = [row[i + shift] for row in rows[1:] if 0 <= i + shift < len(row) and row[i + shift]]
        if sum(is_value(cell, decimal_comma) for cell in below) > len(below) / 2:
            return True
    return False


def _aligned(header: list[str], rows: Sequence[Sequence[str]], width: int, notes: list[str]) -> list[str]:
    """Return a name for every column, also where the header has one fewer than the rows."""
    if len(header) == width:
        return header
    trailing = rows and all(not row[-1] for row in rows if len(row) == width)
    if len(header) < width and not trailing:
        notes.append("the header has one name fewer than the rows have cells: the first column is taken as unnamed")
        return [""] * (width - len(header)) + header
    return (header + [""] * width)[:width]


def _is_unit_row(row: Sequence[str], following: Sequence[str], decimal_comma: bool) -> bool:
    """Tell whether a row below the header states the units."""
    texts = [cell for cell in row if cell]
    if len(row) != len(following) or not texts or any(is_value(cell, decimal_comma) for cell in texts):
        return False
    values = sum(is_value(cell, decimal_comma) for cell in following if cell)
    return values > len(following) / 2 and all(len(cell) <= 16 for cell in texts)


def _comment_header(lines: Sequence[str], width: int) -> list[str] | None:
    """Return the names in the last remark ahead of the values, where there are as many as columns."""
    for line in reversed(lines):
        if not line.strip():
            continue
        content = line.strip().lstrip("#%").strip()
        for separator in SEPARATORS:
            cells = split(content, separator)
            if len(cells) == width and all(cells) and not any(is_value(cell, False) for cell in cells):
                return cells
        return None
    return None
