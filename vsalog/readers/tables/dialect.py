"""The dialect of a text table: encoding, separator, decimal mark, quotes, labels, header."""

from __future__ import annotations

import codecs
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from vsalog.core.finding import Finding
from vsalog.readers.limits import MOST_EXCEPTIONS, SAMPLE_ROWS
from vsalog.readers.tables.header import find_header, names_a_clock, split_names, without_labview_head
from vsalog.readers.tables.source import without_holes
from vsalog.readers.tables.text import (
    COMMA_NUMBER,
    GROUPED,
    NUMBER,
    SEPARATORS,
    WHITESPACE,
    has_quotes,
    is_comment,
    is_value,
    most_common_width,
    split,
    unique_names,
)

_WHOLE = re.compile(r"^[+-]?\d+$")
_THOUSANDS = re.compile(r"^[+-]?[1-9]\d{0,2},\d{3}$")
_FRACTION = re.compile(NUMBER)
_STATED_SEPARATOR = re.compile(r"^sep=(.)$")
"""A first line that spreadsheets write and read."""
_LABELLED = re.compile(r"^\s*([A-Za-z_][^:=\"{}]*)[:=]\s*(.*)$")
"""A cell with a label, as in lines for the plotter of a microcontroller: ``t:0.01,angle:0.5``."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """The dialect of a text table.

    Attributes
    ----------
    encoding : str
        Python's name of it.
    separator : str
        One of `SEPARATORS`; `WHITESPACE` is any run of blanks.
    decimal_comma : bool
        Numbers are written ``1,5``.
    quoted : bool
        Cells below the header may be in quotes.
    skip_lines : int
        Lines before the first row of values.
    names, units : tuple
        Of the columns; units None where the header states none.
    header : tuple of tuple of str
        Its rows as they are written.
    rows : tuple of tuple of str
        The first rows.
    lines : tuple of int
        Their line numbers, counted from 1.
    findings : tuple of Finding
        Findings about the table.
    torn : int
        The number of names where commas are both separators and decimal marks, so that rows have too many cells; else 0.
    labels : tuple of str
        The text before the number in every cell, by column; empty for none.
    """

    encoding: str
    separator: str
    decimal_comma: bool
    quoted: bool
    skip_lines: int
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    header: tuple[tuple[str, ...], ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    findings: tuple[Finding, ...]
    torn: int
    labels: tuple[str, ...]


def detect(head: bytes, whole: bool) -> Dialect:
    """Detect the dialect of a text table.

    Parameters
    ----------
    head : bytes
        The start of the file.
    whole : bool
        Whether that is all of it; otherwise the last line is taken to be truncated.
    """
    encoding = detect_encoding(head)
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, final=whole).removeprefix("\ufeff")
    lines = re.split(r"\r\n|\n|\r", text)
    if not whole and len(lines) > 1:
        lines.pop()
    lines = lines[:SAMPLE_ROWS]
    stated = _STATED_SEPARATOR.match(lines[0])
    if stated:
        lines[0] = ""
    of_labview = without_labview_head(lines)
    filled = [(i, line) for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    separator = stated[1] if stated else _separator([line for _, line in filled])
    table = [(i, split(line, separator)) for i, line in filled]
    rows = [cells for _, cells in table]
    width = most_common_width(rows)
    labels = _labels_of(rows, width)
    if labels:
        table = [(0, [*labels]), *((i, [_without_label(cell) for cell in cells]) for i, cells in table)]
    decimal_comma = _has_decimal_commas([cell for _, cells in table if len(cells) == width for cell in cells])
    header = find_header(lines, table, width, decimal_comma)
    pairs = split_names(header.names)
    again = [*header.lines, *([split(of_labview, separator)] if of_labview else [])]
    rest = _own_rows(table[header.rows :], again, decimal_comma)
    rest = [(i, cells) for i, cells in rest if len(cells) == width]
    skip_lines = rest[0][0] if rest else len(lines)
    return Dialect(
        encoding=encoding,
        separator=separator,
        decimal_comma=decimal_comma,
        quoted=any(has_quotes(line) for i, line in filled if i >= skip_lines),
        skip_lines=skip_lines,
        names=tuple(unique_names([name for name, _ in pairs])),
        units=tuple(unit or own for (_, unit), own in zip(pairs, header.units, strict=True)),
        header=tuple(tuple(cells) for cells in again),
        rows=tuple(tuple(cells) for _, cells in rest),
        lines=tuple(i + 1 for i, _ in rest),
        findings=(
            *header.findings,
            *_doubts(separator, [cell for _, cells in rest for cell in cells] if decimal_comma else []),
        ),
        torn=_torn(rows, width) if separator == "," else 0,
        labels=labels,
    )


def detect_encoding(head: bytes) -> str:
    """Return Python's name of a text's encoding: by its mark, else UTF-8 where it is valid, else Latin-1."""
    if head.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    head = without_holes(head)
    try:
        codecs.getincrementaldecoder("utf-8")("strict").decode(head)
    except UnicodeDecodeError:
        return "cp1252" if not set(head) & {0x81, 0x8D, 0x8F, 0x90, 0x9D} else "latin-1"
    return "utf-8"


def _separator(lines: Sequence[str]) -> str:
    """Return the separator that splits the lines most evenly into values."""
    best, best_score = ",", 0.0
    for separator in SEPARATORS:
        rows = [split(line, separator) for line in lines]
        width = most_common_width(rows)
        if width < 2:
            continue
        even = sum(len(row) == width for row in rows) / len(rows)
        cells = [_without_label(cell) for row in rows for cell in row if cell]
        values = sum(is_value(cell, separator != ",") for cell in cells) / max(len(cells), 1)
        score = even * (0.05 + values)
        # Between other marks there are blanks as well, in names and in remarks ahead of the table.
        if score > best_score * (1.2 if separator == WHITESPACE else 1.001):
            best, best_score = separator, score
    return best


def _has_decimal_commas(cells: Sequence[str]) -> bool:
    """Return whether more numbers have a decimal comma than a point."""
    commas = sum(bool(COMMA_NUMBER.match(cell) or GROUPED[True].match(cell)) for cell in cells)
    return commas > sum(bool(("." in cell and _FRACTION.match(cell)) or GROUPED[False].match(cell)) for cell in cells)


def _doubts(separator: str, cells: Sequence[str]) -> list[Finding]:
    """Return that commas are read as decimal marks where they separate cells too, or all may separate thousands."""
    commas = [cell for cell in cells if COMMA_NUMBER.match(cell)]
    unsure = bool(commas) and (separator == "," or all(_THOUSANDS.match(cell) for cell in commas))
    return [Finding(code="table.decimal_commas")] if unsure else []


def _own_rows(
    table: Sequence[tuple[int, list[str]]], header: Sequence[Sequence[str]], decimal_comma: bool
) -> list[tuple[int, list[str]]]:
    """Return the rows up to the header of another table, without the own header that comes again."""
    found = []
    for i, cells in table:
        if cells in header:
            continue
        if names_a_clock(cells) and not any(is_value(cell, decimal_comma) for cell in cells):
            break
        found.append((i, cells))
    return found


def _torn(rows: Sequence[Sequence[str]], width: int) -> int:
    """Return how many names there are where rows have two cells for each, as decimal commas make of numbers; else 0."""
    names = next((row for row in rows if 2 * len(row) == width and not any(is_value(cell, False) for cell in row)), [])
    whole = all(_WHOLE.match(cell) for row in rows if len(row) == width for cell in row)
    return len(names) if whole else 0


def _labels_of(rows: Sequence[Sequence[str]], width: int) -> tuple[str, ...]:
    """Return the text before the number in each cell of a column, none where a column's cells have no common label."""
    labels = []
    for cells in zip(*(row for row in rows if len(row) == width), strict=True):
        found = Counter(match[1].strip() for cell in cells if (match := _LABELLED.match(cell)))
        (label, count), *_ = found.most_common(1) or [("", 0)]
        if count < (1 - MOST_EXCEPTIONS) * len(cells):
            return ()
        labels.append(label)
    return tuple(labels) if len(set(labels)) == width else ()


def _without_label(cell: str) -> str:
    """Return the text after a cell's label.

    >>> _without_label("angle = 0.5")
    '0.5'
    """
    match = _LABELLED.match(cell)
    return match[2] if match else cell
