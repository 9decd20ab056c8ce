"""The header of a text table: what its columns are called, and where the values begin."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from vsalog.core.finding import Finding, Findings
from vsalog.core.units import is_known_by_heart, split_header
from vsalog.readers.headers import printable_cell
from vsalog.readers.limits import FIRST_ROWS
from vsalog.readers.table_text import SEPARATORS, is_value, split
from vsalog.readers.time_names import Rank, rank_of

NO_UNIT = ("-", "–", "1")
_UNIT_LABEL = re.compile(r"^units?:\s*", re.IGNORECASE)
"""As Simulink writes them."""
_NUMBERED = re.compile(r"^(.*)(\.\d+)$", re.DOTALL)
LABVIEW_CLOCK = "X_Value"
_LABVIEW_END = "***End_of_Header***"

Table = Sequence[tuple[int, list[str]]]
"""Line numbers, from 0, and cells."""


@dataclass(frozen=True, slots=True)
class Header:
    """What stands ahead of the values.

    Attributes
    ----------
    names, units : list
        Of each column, "" and None where there is none.
    rows : int
        Index of the first row of values in the table.
    skip_lines : int
        Lines ahead of it.
    findings : tuple of Finding
        What is worth telling.
    """

    names: list[str]
    units: list[str | None]
    rows: int
    skip_lines: int
    findings: tuple[Finding, ...]


def find_header(lines: Sequence[str], table: Table, width: int, decimal_comma: bool) -> Header:
    """Find the header of a table and its first row of values.

    Parameters
    ----------
    lines : sequence of str
        All lines.
    table : sequence of (int, list of str)
        Those that are neither empty nor remarks, split.
    width : int
        Cells that most of them have.
    decimal_comma : bool
        How numbers are written.
    """
    findings = Findings()
    table = [(i, _without_end(cells, width, decimal_comma)) for i, cells in table]
    start = next((k for k, (_, cells) in enumerate(table) if len(cells) in (width, width - 1)), 0)
    start = _skip_preamble(table, start, width, decimal_comma)
    first, start = start, _skip_settings(table, start, width, decimal_comma)
    ahead = sum(all(is_value(cell, decimal_comma) for cell in cells) for _, cells in table[first:start])
    if ahead:
        findings.add(Finding(code="table.rows_ahead_of_header", value=ahead))
    names: list[str] | None = None
    units: list[str | None] = [None] * width
    rest = [cells for _, cells in table[start:]]
    if rest and _names_columns(rest, decimal_comma):
        names = _aligned(rest.pop(0), rest, width, findings)
        below = _rows_of_words(rest, width, decimal_comma)
        names, units, passed = named(names, rest[:below], width)
        rest = rest[below:]
        findings.add(*passed)
    elif rest and len(rest[0]) == width:
        said = _comment_header(lines[: table[start][0]], width)
        names, units, passed = named(said[0], said[1:], width) if said else (None, units, [])
        findings.add(*passed)
    if names is None:
        findings.add(Finding(code="table.no_header"))
        names = [""] * width
    first = len(table) - len(rest)
    return Header(names, units, first, table[first][0] if rest else len(lines), tuple(findings))


def named(
    first: list[str], below: Sequence[list[str]], width: int
) -> tuple[list[str], list[str | None], list[Finding]]:
    """Return the names and units that the rows of a header state, and what to tell of rows that state neither.

    Parameters
    ----------
    first : list of str, of length `width`
        Its first row.
    below : sequence of list of str
        The others.
    width : int
        Columns of the table.
    """
    names, passed = first, list[Finding]()
    units: list[str | None] = [None] * width
    for row in below:
        if _are_units(row):
            units = [_UNIT_LABEL.sub("", cell).strip("[]() ") or None for cell in row]
        elif "" in names or len(set(names)) < width:
            names = _merged(names, row)
        else:
            cells = {"cells": printable_cell(", ".join(row))}
            passed.append(Finding(code="table.words_below_header", evidence=cells))
    if names and names[0].startswith("%time"):
        names = [name.removeprefix("field.") for name in names]
    return names, units, passed


def split_names(names: Sequence[str]) -> list[tuple[str, str | None]]:
    """Split the cells of a header into names and units, also where pandas put a number behind one that comes again.

    >>> split_names(["q [rad]", "q [rad].1"])
    [('q', 'rad'), ('q.1', 'rad')]
    """
    return [
        _again(match[1], match[2]) if (match := _NUMBERED.match(name)) and match[1] in names else split_header(name)
        for name in names
    ]


def _again(cell: str, number: str) -> tuple[str, str | None]:
    name, unit = split_header(cell)
    return name + number, unit


def without_labview_head(lines: list[str]) -> None:
    """Blank what LabVIEW writes ahead of a table, call its X_Value what it is, and leave the last column, of remarks, unnamed."""
    ends = [i for i, line in enumerate(lines) if line.startswith(_LABVIEW_END)]
    if not ends:
        return
    head = lines[: ends[-1] + 1]
    lines[: len(head)] = [""] * len(head)
    if len(head) == len(lines):
        return
    lines[len(head)] = _with_units(
        head, lines[len(head)].removesuffix("Comment").rstrip("\t,")
    )  # rows need not have its cell
    if any(line.startswith("X_Dimension") and "Time" in line for line in head):
        lines[len(head)] = lines[len(head)].replace(LABVIEW_CLOCK, "time [s]")


def _with_units(head: Sequence[str], header: str) -> str:
    """Return LabVIEW's header with the units that its head states, where there is one for each column but the first."""
    for separator in "\t,":
        names = header.split(separator)
        units = next(
            (
                line.rstrip(separator).split(separator)[1:]
                for line in head
                if line.startswith(f"Y_Unit_Label{separator}")
            ),
            [],
        )
        if units and len(units) == len(names) - 1:
            stated = [f"{name} [{unit}]" if unit else name for name, unit in zip(names[1:], units, strict=True)]
            return separator.join([names[0], *stated])
    return header


def join_torn_names(lines: list[str]) -> None:
    """Put names in quotes together that go on in the next line; the lines that they go on in become blank."""
    for i, line in enumerate(lines):
        if line.count('"') % 2 == 0:
            continue
        for end in range(i + 2, min(i + 2 + FIRST_ROWS, len(lines) + 1)):
            joined = " ".join(lines[i:end])
            if joined.count('"') % 2 == 0:
                if _are_names(joined):
                    lines[i:end] = [joined] + [""] * (end - i - 1)
                break


def _are_names(line: str) -> bool:
    rows = [split(line, separator) for separator in SEPARATORS if separator.strip()]
    return any(len(cells) > 1 and not any(is_value(cell, True) for cell in cells) for cells in rows)


def _without_end(cells: list[str], width: int, decimal_comma: bool) -> list[str]:
    """Return a row of words without the blank cell that a separator at its end makes, where the rows of values have none."""
    one_more = len(cells) == width + 1 > 2 and not cells[-1]
    return cells[:-1] if one_more and not any(is_value(cell, decimal_comma) for cell in cells[:-1]) else cells


def _skip_preamble(table: Sequence[tuple[int, list[str]]], start: int, width: int, decimal_comma: bool) -> int:
    """Step over lines of text ahead of the header that happen to have nearly as many cells."""
    while start + 2 < len(table):
        here, following = table[start][1], table[start + 1][1]
        wordy = not any(is_value(cell, decimal_comma) for row in (here, following) for cell in row if cell)
        if len(here) == width or len(following) < len(here) or not wordy:
            return start
        start += 1
    return start


def _skip_settings(table: Table, start: int, width: int, decimal_comma: bool) -> int:
    """Step over lines that say something of the log in as many cells as it has columns: the header below names a clock.

    A few rows of values may be ahead of it too, as where a serial port was listened to before the recording began again.
    """
    rows = 0
    for k, (_, cells) in enumerate(table[start:], start=start):
        if len(cells) == width and _names_a_clock(cells, decimal_comma):
            return k
        if all(is_value(cell, decimal_comma) for cell in cells) and rows < FIRST_ROWS:
            rows += 1
            continue
        if len(cells) > width or "" in cells or len(set(cells)) < len(cells):
            return start
        if all(is_value(cell, decimal_comma) for cell in cells):
            return start
    return start


def _names_a_clock(cells: Sequence[str], decimal_comma: bool) -> bool:
    return not any(is_value(cell, decimal_comma) for cell in cells) and any(is_clock(cell) for cell in cells)


def is_clock(name: str) -> bool:
    """Tell whether a column is called a clock; a date alone is none."""
    return rank_of(split_header(name)[0]) not in (None, Rank.DATED)


def _names_columns(rows: Sequence[Sequence[str]], decimal_comma: bool) -> bool:
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


def _aligned(header: list[str], rows: Sequence[Sequence[str]], width: int, findings: Findings) -> list[str]:
    """Return a name for every column, also where the header has one fewer than the rows."""
    if len(header) == width:
        return header
    trailing = rows and all(not row[-1] for row in rows if len(row) == width)
    if len(header) < width and not trailing:
        findings.add(Finding(code="table.unnamed_column"))
        return [""] * (width - len(header)) + header
    return (header + [""] * width)[:width]


def _rows_of_words(rows: Sequence[Sequence[str]], width: int, decimal_comma: bool) -> int:
    """Return how many rows below the first of a header belong to it: of words, with values below."""
    for count, row in enumerate(rows[: FIRST_ROWS + 1]):
        texts = [cell for cell in row if cell]
        values = sum(is_value(cell, decimal_comma) for cell in texts)
        if len(row) != width or values:
            return count if len(row) == width and 2 * values > len(texts) else 0
    return 0


def _are_units(row: Sequence[str]) -> bool:
    """Tell whether a row of words states the units: most are in brackets, or units that are known by heart."""
    texts = [cell for cell in row if cell]
    stated = sum(
        cell[0] in "[(" or cell in NO_UNIT or is_known_by_heart(cell) or _UNIT_LABEL.match(cell) is not None
        for cell in texts
    )
    return 2 * stated >= len(texts)


def _merged(groups: Sequence[str], names: Sequence[str]) -> list[str]:
    """Join two rows of a header: a name of the first stands for the blank cells to its right, too.

    >>> _merged(["time", "motor", "", "link"], ["", "position", "torque", "position"])
    ['time', 'motor.position', 'motor.torque', 'link.position']
    """
    joined, group = [], ""
    for above, name in zip(groups, names, strict=True):
        group = above or group
        if name and is_clock(name):  # however it is grouped with others
            joined.append(name)
            continue
        joined.append(f"{group}.{name}" if group and name else above or name)
        if not name:  # a column of its own, no group
            group = ""
    return joined


def _comment_header(lines: Sequence[str], width: int) -> list[list[str]]:
    """Return the names in the last remark ahead of the values, where there are as many as columns, and units below them."""
    rows: list[list[str]] = []
    for line in reversed([line for line in lines if line.strip()]):
        cells = _in_remark(line, width)
        if cells:
            rows.insert(0, cells)
        if not cells or not _are_units(cells) or len(rows) > 1:
            break
    return rows[-1:] if len(rows) > 1 and _are_units(rows[0]) else rows


def _in_remark(line: str, width: int) -> list[str]:
    content = line.strip().lstrip("#%").strip()
    for separator in SEPARATORS:
        cells = split(content, separator)
        if len(cells) == width and all(cells) and not any(is_value(cell, False) for cell in cells):
            return cells
    return []
