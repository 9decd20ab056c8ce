"""Tells how a text table is written: encoding, separator, decimal mark, header."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from vsalog.core.finding import Finding
from vsalog.readers.headers import printable_cell, unique_names
from vsalog.readers.limits import SAMPLE_ROWS
from vsalog.readers.repeated_header import own_rows
from vsalog.readers.sniff import without_holes
from vsalog.readers.table_dialect import Dialect, has_quotes
from vsalog.readers.table_header import find_header, join_torn_names, split_names, without_labview_head
from vsalog.readers.table_labels import labels_of, without_label
from vsalog.readers.table_notation import Notation, find_notations
from vsalog.readers.table_text import SEPARATORS, WHITESPACE, is_comment, is_value, most_common_width, split

_WHOLE = re.compile(r"^[+-]?\d+$")
_STATED_SEPARATOR = re.compile(r"^sep=(.)$")
"""A first line that spreadsheets write and read."""


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
    lines = lines[:SAMPLE_ROWS]
    stated = _STATED_SEPARATOR.match(lines[0])
    if stated:
        lines[0] = ""
    without_labview_head(lines)
    join_torn_names(lines)
    said = [(i, line) for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    separator = stated[1] if stated else _separator([line for _, line in said])
    table = [(i, split(line, separator)) for i, line in said]
    rows = [cells for _, cells in table]
    width = most_common_width(rows)
    labels = labels_of(rows, width)
    if labels:
        table = [(0, [*labels]), *((i, [without_label(cell) for cell in cells]) for i, cells in table)]
        rows = [cells for _, cells in table]
    notations, marks = find_notations(rows, width, separator)
    decimal_comma = any(notation.decimal_comma for notation in notations)
    header = find_header(lines, table, width, decimal_comma)
    torn = _torn(rows, width) if separator == "," else 0
    pairs = split_names(header.names)
    names = unique_names([name for name, _ in pairs])
    units = [unit or own for (_, unit), own in zip(pairs, header.units, strict=True)]
    rest = [(i, cells) for i, cells in table[header.rows :] if len(cells) == width]
    dialect = Dialect(
        encoding=encoding,
        separator=separator,
        quoted=any(has_quotes(line) for i, line in said if i >= header.skip_lines),
        skip_lines=header.skip_lines,
        names=tuple(names),
        units=tuple(notation.unit or unit for notation, unit in zip(notations, units, strict=True)),
        notations=tuple(notations),
        rows=tuple(tuple(cells) for _, cells in rest),
        lines=tuple(i + 1 for i, _ in rest),
        findings=(*header.findings, *marks, *_units_in_cells(names, units, notations)),
        torn=torn,
        labels=labels,
    )
    own = own_rows(dialect, lines) or range(len(rest))
    return replace(dialect, rows=tuple(dialect.rows[k] for k in own), lines=tuple(dialect.lines[k] for k in own))


def _torn(rows: Sequence[Sequence[str]], width: int) -> int:
    """Return how many names there are where rows have two cells for each, as decimal commas make of numbers; else 0."""
    names = next((row for row in rows if 2 * len(row) == width and not any(is_value(cell, False) for cell in row)), [])
    whole = all(_WHOLE.match(cell) for row in rows if len(row) == width for cell in row)
    return len(names) if whole else 0


def _units_in_cells(
    names: Sequence[str], stated: Sequence[str | None], notations: Sequence[Notation]
) -> Iterator[Finding]:
    """Yield what to tell of columns with a unit behind their numbers."""
    for name, unit, notation in zip(names, stated, notations, strict=True):
        if notation.unit and notation.unit != unit:
            evidence = {"cells": notation.unit, "header": f"'{printable_cell(unit)}'" if unit else "none"}
            yield Finding(code="table.unit_in_cells", part=name, evidence=evidence)


def detect_encoding(head: bytes) -> str:
    """Return Python's name of a text's encoding: by its mark, else UTF-8 where it is valid, else Latin-1."""
    if head.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    head = without_holes(head)
    if head[1::2].count(0) > len(head) // 4:
        return "utf-16-le"
    if head[0::2].count(0) > len(head) // 4:
        return "utf-16-be"
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
        cells = [without_label(cell) for row in rows for cell in row if cell]
        values = sum(is_value(cell, separator != ",") for cell in cells) / max(len(cells), 1)
        score = even * (0.05 + values)
        # Between other marks there are blanks as well, in names and in remarks ahead of the table.
        if score > best_score * (1.2 if separator == WHITESPACE else 1.001):
            best, best_score = separator, score
    return best
