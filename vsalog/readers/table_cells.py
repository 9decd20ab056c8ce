"""Cells of text tables as numbers."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vsalog.core.arrow import arrow_texts
from vsalog.core.finding import Evidence, Finding
from vsalog.core.recording import Values
from vsalog.readers.headers import printable_cell
from vsalog.readers.limits import SAMPLE_ROWS
from vsalog.readers.table_text import LIKE_NUMBERS, NUMBER

_CELL = NUMBER.replace("^", "^(", 1)[:-1] + r"|[+-]?(?i:inf|infinity)|[+-]?(?i:nan))$"

_EMPTY = arrow_texts(["", *LIKE_NUMBERS])
_WHOLE = re.compile(r"^[+-]?\d{1,40}$")
_NOTHING = pa.nulls(1, pa.string())[0]


class Cells:
    """Turns the cells of a column into numbers and counts those that are none."""

    def __init__(self) -> None:
        self.rows = 0
        self.good = 0
        self.bad = 0
        self.first = ""
        self.first_row = 0
        self.rounded = ""

    @property
    def text(self) -> str:
        """Why the column is no signal, "" where it is one."""
        if self.good:
            return ""
        return "text" if self.bad else "no values"

    def findings(self, column: str) -> list[Finding]:
        """Return what was no number, or is none that floating point can hold."""
        found = []
        if self.rounded:
            found.append(Finding(code="table.numbers_rounded", part=column, evidence={"number": self.rounded}))
        if self.bad and not self.text:
            first: Evidence = {"row": self.first_row + 1, "first": printable_cell(self.first)}
            found.append(Finding(code="table.cells_without_number", part=column, value=self.bad, evidence=first))
        return found

    def convert(self, cells: pa.Array) -> Values:
        """Return the numbers in a stretch of the column, NaN where there is none."""
        numbers, bad = _all_numbers(cells), 0
        if numbers is None:
            cells = pc.ascii_trim_whitespace(cells)
            numbers = _all_numbers(pc.if_else(pc.equal(cells, ""), _NOTHING, cells))
        if numbers is None:
            numbers, bad = self._convert_carefully(cells)
        self.good += len(numbers) - numbers.null_count
        self.bad += bad
        self.rows += len(cells)
        values = np.array(numbers.to_numpy(zero_copy_only=False), dtype=np.float64)
        self.rounded = self.rounded or _rounded(cells, values)
        return values

    def _convert_carefully(self, cells: pa.Array) -> tuple[pa.Array, int]:
        cells = pc.replace_substring_regex(cells, "^(?i:true)$", "1")
        cells = pc.replace_substring_regex(cells, "^(?i:false)$", "0")
        number = pc.match_substring_regex(cells, _CELL)
        empty = pc.is_in(cells, _EMPTY)
        wrong = pc.fill_null(pc.and_not(pc.invert(number), empty), False)
        count = int(pc.sum(wrong).as_py() or 0)
        if count and not self.bad:
            at = int(pc.index(wrong, True).as_py())
            self.first_row = self.rows + at
            self.first = bytes(pc.cast(cells[at], pa.binary()).as_py()).decode("utf-8", "replace")
        return pc.cast(pc.if_else(pc.fill_null(number, False), cells, _NOTHING), pa.float64()), count


def _rounded(cells: pa.Array, values: Values) -> str:
    """Return a whole number that floating point cannot hold, "" where none was found."""
    large = np.abs(values) * np.finfo(np.float64).epsneg > 1.0  # beyond, whole numbers are left out
    for at in np.flatnonzero(large & np.isfinite(values))[:SAMPLE_ROWS].tolist():
        cell = str(cells[at].as_py()).strip()
        if _WHOLE.match(cell) and int(cell) != int(values[at]):
            return cell
    return ""


def _all_numbers(cells: pa.Array) -> pa.Array | None:
    """Return cells as numbers; None where one of them is none."""
    try:
        pc.cast(cells[:SAMPLE_ROWS], pa.float64())  # to tell of each cell that it is no number takes long
        return pc.cast(cells, pa.float64())
    except pa.ArrowInvalid:
        return None


def numbers_and_words(column: pa.Array) -> tuple[int, int]:
    """Count the cells that hold a number and those that hold something else: prose has numbers too, between words."""
    cells = Cells()
    cells.convert(column)
    return cells.good, cells.bad
