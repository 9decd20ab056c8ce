"""Cells of tables as numbers: one in a cell, or a list of them."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.arrow import arrow_texts
from vsalog.core.finding import Evidence, Finding
from vsalog.core.recording import Values
from vsalog.readers.limits import MAX_ARRAY, MOST_EXCEPTIONS, SAMPLE_ROWS
from vsalog.readers.tables.dates import in_nanoseconds
from vsalog.readers.tables.text import BETWEEN_THOUSANDS, GROUPED, LIKE_NUMBERS, NUMBER, printable_cell

_CELL = NUMBER.replace("^", "^(", 1)[:-1] + r"|[+-]?(?i:inf|infinity)|[+-]?(?i:nan))$"
_EMPTY = arrow_texts(["", *LIKE_NUMBERS])
_WHOLE = re.compile(r"^[+-]?\d{1,40}$")
_NOTHING = pa.nulls(1, pa.string())[0]
_LIST = r"^\s*[\[(].*[\])]\s*$"


class Cells:
    """Converts the cells of a column to numbers and counts those that are none."""

    def __init__(self) -> None:
        self.rows = 0
        self.good = 0
        self.bad = 0
        self.first = ""
        self.first_row = 0
        self.rounded = ""

    @property
    def text(self) -> str:
        """Why the column is no signal, "" where it is one, as are all numbers that are not stored as text."""
        if self.good:
            return ""
        return "text" if self.bad else "no values"

    def findings(self, column: str) -> list[Finding]:
        """Return the cells that are no number, or none that floating point can represent."""
        found = []
        if self.rounded:
            found.append(Finding(code="table.numbers_rounded", part=column, evidence={"number": self.rounded}))
        if self.bad and not self.text:
            first: Evidence = {"row": self.first_row + 1, "first": printable_cell(self.first)}
            found.append(Finding(code="table.cells_without_number", part=column, value=self.bad, evidence=first))
        return found

    def convert(self, cells: pa.Array) -> Values:
        """Return the numbers in a stretch of the column, NaN where there is none."""
        numbers, wrong = numbers_in(cells)
        texts = pa.types.is_string(cells.type) or pa.types.is_large_string(cells.type)
        if wrong is not None:
            if not self.bad:
                at = int(np.argmax(wrong))
                self.first_row = self.rows + at
                self.first = bytes(pc.cast(cells[at], pa.binary()).as_py()).decode("utf-8", "replace")
            self.bad += int(np.count_nonzero(wrong))
        self.good += len(numbers) - numbers.null_count if texts else len(cells)
        self.rows += len(cells)
        values = np.asarray(numbers.to_numpy(zero_copy_only=False), dtype=np.float64)
        if numbers is not cells:
            self.rounded = self.rounded or _rounded(cells, values)
        return values


def numbers_in(cells: pa.Array) -> tuple[pa.Array, NDArray[np.bool_] | None]:
    """Return cells as float64, durations in seconds, null where one is no number.

    Along with them come flags of texts that are something else; None where there are none.
    """
    kind = cells.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return _numbers_in_text(cells)
    if pa.types.is_float64(kind):
        return cells, None
    if pa.types.is_duration(kind):
        durations, good = in_nanoseconds(cells)
        return pa.array(durations * 1e-9, mask=~good), None
    if pa.types.is_boolean(kind):
        cells = pc.cast(cells, pa.uint8())
    if pa.types.is_decimal(kind):  # Arrow rounds them twice
        cells = pc.cast(cells, pa.string())
    try:
        return pc.cast(cells, pa.float64(), safe=False), None
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        return pa.nulls(len(cells), pa.float64()), None


def _numbers_in_text(cells: pa.Array) -> tuple[pa.Array, NDArray[np.bool_] | None]:
    numbers = _all_numbers(cells)
    if numbers is None:
        cells = pc.ascii_trim_whitespace(cells)
        numbers = _all_numbers(pc.if_else(pc.equal(cells, ""), _NOTHING, cells))
    if numbers is not None:
        return numbers, None
    cells = pc.replace_substring_regex(cells, "^(?i:true)$", "1")
    cells = pc.replace_substring_regex(cells, "^(?i:false)$", "0")
    number = pc.match_substring_regex(cells, _CELL)
    wrong = pc.fill_null(pc.and_not(pc.invert(number), pc.is_in(cells, _EMPTY)), False)
    numbers = pc.cast(pc.if_else(pc.fill_null(number, False), cells, _NOTHING), pa.float64())
    return numbers, np.asarray(wrong.to_numpy(zero_copy_only=False), bool) if pc.any(wrong).as_py() else None


def with_points(cells: pa.Array, decimal_comma: bool) -> pa.Array:
    """Return texts with numbers as ``1234.5``; with decimal commas, a single point separates thousands or is invalid."""
    apart = pc.match_substring_regex(cells, GROUPED[decimal_comma].pattern)
    marks = ("." if decimal_comma else ",") + BETWEEN_THOUSANDS
    cells = pc.if_else(apart, pc.replace_substring_regex(cells, f"[{marks}]", ""), cells)
    if not decimal_comma:
        return cells
    cells = pc.replace_substring_regex(cells, r"^(\s*[+-]?\d+)\.(\d+\s*)$", r"\1'\2")
    return pc.replace_substring_regex(cells, r"^(\s*[+-]?\d*),(\d+(?:[eE][+-]?\d+)?\s*)$", r"\1.\2")


def too_large(values: Values) -> NDArray[np.bool_]:
    """Return which values are beyond those between which floating point holds all whole numbers."""
    found: NDArray[np.bool_] = np.abs(values) * np.finfo(np.float64).epsneg > 1.0
    return found


def _rounded(cells: pa.Array, values: Values) -> str:
    """Return a whole number that floating point cannot hold, "" where none was found."""
    for at in np.flatnonzero(too_large(values) & np.isfinite(values))[:SAMPLE_ROWS].tolist():
        cell = str(cells[at].as_py()).strip()
        if _WHOLE.match(cell) and int(cell) != int(values[at]):
            return cell
    return ""


def _all_numbers(cells: pa.Array) -> pa.Array | None:
    """Return cells as numbers; None where one of them is none."""
    try:
        pc.cast(cells[:SAMPLE_ROWS], pa.float64())  # checking every cell takes long
        return pc.cast(cells, pa.float64())
    except pa.ArrowInvalid:
        return None


def numbers_and_words(column: pa.Array) -> tuple[int, int]:
    """Count the cells with a number and those with something else: prose has numbers too, between words."""
    cells = Cells()
    cells.convert(column)
    return cells.good, cells.bad


def elements_of(column: pa.Array) -> int:
    """Return how many numbers the lists in most cells of a column contain, 0 for none."""
    filled = column.drop_null()
    lists = pc.filter(filled, pc.match_substring_regex(filled, _LIST))
    if not len(lists) or len(lists) < (1 - MOST_EXCEPTIONS) * len(filled):
        return 0
    lengths, often = np.unique(pc.list_value_length(_parts(lists)).to_numpy(zero_copy_only=False), return_counts=True)
    count = int(lengths[np.argmax(often)])
    return count if count <= MAX_ARRAY and numbers_and_words(split_lists(lists, count)[0])[0] else 0


def split_lists(cells: pa.Array, count: int) -> list[pa.Array]:
    """Return the elements of lists such as ``[0.5, 1.5]`` as columns of text; a list of another length is none."""
    parts = _parts(cells)
    good = pc.fill_null(pc.equal(pc.list_value_length(parts), count), False)
    whole = pc.if_else(good, parts, pa.scalar(None, parts.type))
    return [pc.if_else(good, pc.list_element(whole, k), cells) if len(cells) else cells for k in range(count)]


def _parts(cells: pa.Array) -> pa.Array:
    inside = pc.utf8_trim(cells, " \t\r\n[]()")
    return pc.split_pattern_regex(inside, r"\s*,\s*|\s+")
