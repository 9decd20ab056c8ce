"""The header of a text table: the names and units of its columns, and the beginning of the values."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from vsalog.core.finding import Finding, Findings
from vsalog.core.units import is_known_by_heart, split_header
from vsalog.readers.limits import FIRST_ROWS
from vsalog.readers.tables.text import SEPARATORS, is_comment, is_value, printable_cell, split
from vsalog.readers.tables.time_units import Rank, rank_of

_NO_UNIT = ("-", "–", "1")
_UNIT_LABEL = re.compile(r"^units?:\s*", re.IGNORECASE)
"""As Simulink writes them."""
_NUMBERED = re.compile(r"^(.*)(\.\d+)$", re.DOTALL)
_LABVIEW_CLOCK, _LABVIEW_AXIS = "X_Value", "X_Dimension"
_LABVIEW_END = "***End_of_Header***"

Table = Sequence[tuple[int, list[str]]]
"""Line numbers, from 0, and cells."""


class Header(NamedTuple):
    """The part before the values.

    Attributes
    ----------
    names, units : list
        Of each column, "" and None where there is none.
    lines : list of list of str
        Its rows as they are written, to find it further down.
    rows : int
        Index of the first row of values in the table.
    findings : Findings
        Findings about it.
    """

    names: list[str]
    units: list[str | None]
    lines: list[list[str]]
    rows: int
    findings: Findings


def find_header(lines: Sequence[str], table: Table, width: int, decimal_comma: bool) -> Header:
    """Find the header of a table and its first row of values.

    It is the first row of words that names a clock, else the last one before the values that states no units, else a remark.

    Parameters
    ----------
    lines : sequence of str
        All lines.
    table : sequence of (int, list of str)
        Those that are neither empty nor remarks, split.
    width : int
        Cells that most of them have.
    decimal_comma : bool
        Whether numbers have a decimal comma.
    """
    findings = Findings()
    rows = [_without_end(cells, width) for _, cells in table]
    wordy = [not any(is_value(cell, decimal_comma) for cell in cells) for cells in rows]
    fits = [width - 1 <= len(cells) <= width and bool(cells) for cells in rows]
    begin = next((k for k, cells in enumerate(rows) if not wordy[k] and len(cells) == width), len(rows))
    named = next(
        (k for k in range(min(begin + FIRST_ROWS + 1, len(rows))) if wordy[k] and fits[k] and _any_clock(rows[k])), None
    )
    if named is None:
        first = begin
        while first and wordy[first - 1] and fits[first - 1]:
            first -= 1
        words = range(first, begin)
        named = next((k for k in reversed(words) if not _are_units(rows[k])), first if words else None)
    if named is None and begin < len(rows) and _mixed_header(rows, begin, width, decimal_comma):
        named = begin
    if named is None:
        written = _in_remarks(lines[: table[begin][0]] if begin < len(rows) else lines, width)
        below, values = written[1:], begin
    else:
        values = named + 1
        while values < len(rows) and wordy[values] and len(rows[values]) == width:
            values += 1
        written = [_aligned(rows[named], [row for row in rows[values:] if len(row) == width], width, findings)]
        below = rows[named + 1 : values]
        if ahead := sum(all(is_value(cell, decimal_comma) for cell in cells) for cells in rows[:named]):
            findings.append(Finding(code="table.rows_ahead_of_header", value=ahead))
    if not written:
        findings.append(Finding(code="table.no_header"))
    units: list[str | None] = [None] * width
    for row in below:
        if _are_units(row):
            units = [_UNIT_LABEL.sub("", cell).strip("[]() ") or None for cell in row]
        else:
            cells = printable_cell(", ".join(row))
            findings.append(Finding(code="table.words_below_header", evidence={"cells": cells}))
    names = written[0] if written else [""] * width
    if names[:1] == ["%time"]:
        names = [name.removeprefix("field.") for name in names]
    return Header(names, units, [table[named][1], *below] if named is not None else written, values, findings)


def split_names(names: Sequence[str]) -> list[tuple[str, str | None]]:
    """Split the cells of a header into names and units, also where pandas appended a number to a repeated one.

    >>> split_names(["q [rad]", "q [rad].1"])
    [('q', 'rad'), ('q.1', 'rad')]
    """
    found = []
    for name in names:
        numbered = _NUMBERED.match(name)
        if numbered and numbered[1] in names:
            bare, unit = split_header(numbered[1])
            found.append((bare + numbered[2], unit))
        else:
            found.append(split_header(name))
    return found


def without_labview_head(lines: list[str]) -> str:
    """Blank LabVIEW's lines before a table, rename its X_Value to the time, and leave the last column, of remarks, unnamed.

    Returns
    -------
    str
        The header as it is written, which is repeated before each segment; "" where LabVIEW wrote none.
    """
    ends = [i for i, line in enumerate(lines) if line.startswith(_LABVIEW_END)]
    at = ends[0] + 1 if ends else len(lines)
    while at < len(lines) and not lines[at].startswith(_LABVIEW_CLOCK):
        at += 1
    if at == len(lines):
        return ""
    written = lines[at]
    head, header = lines[:at], lines[at].removesuffix("Comment").rstrip("\t,")  # rows need not have its cell
    lines[:at] = [""] * at
    separator = "\t" if "\t" in header else ","
    units = next((line.split(separator)[1:] for line in head if line.startswith("Y_Unit_Label")), [])
    seconds = any(line.startswith(_LABVIEW_AXIS) and "Time" in line for line in head)
    names = header.split(separator)
    stated = iter(units)
    for i, name in enumerate(names):
        if name == _LABVIEW_CLOCK:
            names[i] = "time [s]" if seconds else name
        elif unit := next(stated, ""):
            names[i] = f"{name} [{unit}]"
    lines[at] = separator.join(names)
    return written


def is_clock(name: str) -> bool:
    """Return whether a column has the name of a clock; a date alone is none."""
    return rank_of(split_header(name)[0]) not in (None, Rank.DATED)


def names_a_clock(cells: Sequence[str]) -> bool:
    """Return whether words name columns, one of them a clock; LabVIEW states before a segment which one is."""
    return (
        len(cells) > 1
        and cells[0] != _LABVIEW_AXIS
        and all(re.search(r"[^\W\d_]", cell) for cell in cells if cell)
        and _any_clock(cells)
    )


def _any_clock(cells: Sequence[str]) -> bool:
    return any(is_clock(cell) for cell in cells)


def _without_end(cells: list[str], width: int) -> list[str]:
    """Return a row without the blank cell that a separator at its end makes, where others have none."""
    return cells[:-1] if len(cells) == width + 1 > 2 and not cells[-1] else cells


def _mixed_header(rows: Sequence[Sequence[str]], at: int, width: int, decimal_comma: bool) -> bool:
    """Return whether a row with values nevertheless names columns: it has words where most others have values."""
    words = [i for i, cell in enumerate(rows[at]) if cell and not is_value(cell, decimal_comma)]
    for i in words:
        below = [row[i] for row in rows[at + 1 :] if len(row) == width and row[i]]
        if below and 2 * sum(is_value(cell, decimal_comma) for cell in below) > len(below):
            return True
    return False


def _aligned(header: list[str], rows: Sequence[Sequence[str]], width: int, findings: Findings) -> list[str]:
    """Return a name for every column, also where the header has one fewer than the rows."""
    if len(header) == width:
        return header
    if any(row[-1] for row in rows) or not rows:
        findings.append(Finding(code="table.unnamed_column"))
        return [""] * (width - len(header)) + header
    return header + [""] * (width - len(header))


def _are_units(row: Sequence[str]) -> bool:
    """Return whether a row of words states the units: most are in brackets, or units that are known by heart."""
    texts = [cell for cell in row if cell]
    stated = sum(
        cell[0] in "[(" or cell in _NO_UNIT or is_known_by_heart(cell) or _UNIT_LABEL.match(cell) is not None
        for cell in texts
    )
    return 2 * stated >= len(texts)


def _in_remarks(lines: Sequence[str], width: int) -> list[list[str]]:
    """Return the names in the last remark ahead of the values, where there are as many as columns, and units below them."""
    found: list[list[str]] = []
    for line in reversed([line for line in lines if is_comment(line)]):
        content = line.strip().lstrip("#%").strip()
        rows = [split(content, separator) for separator in SEPARATORS]
        cells = next(
            (row for row in rows if len(row) == width and not any(is_value(c, False) or not c for c in row)), []
        )
        if not cells:
            break
        found.insert(0, cells)
        if not _are_units(cells):
            break
    return found
