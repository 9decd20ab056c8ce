"""Cells of text tables as numbers."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vsalog.readers.table_text import NUMBER
from vsalog.recording import Values

_CELL = NUMBER.replace("^", "^(", 1)[:-1] + r"|[+-]?(?i:inf|infinity)|[+-]?(?i:nan))$"


class Cells:
    """Turns the cells of a column into numbers and counts those that are none."""

    def __init__(self) -> None:
        self.rows = 0
        self.good = 0
        self.bad = 0
        self.first = ""
        self.first_row = 0

    @property
    def text(self) -> str:
        """Why the column is no signal, "" where it is one."""
        if self.good:
            return ""
        return "text" if self.bad else "no values"

    def convert(self, cells: pa.Array) -> Values:
        """Return the numbers in a stretch of the column, NaN where there is none."""
        try:
            numbers = pc.cast(cells, pa.float64())
            bad = 0
        except pa.ArrowInvalid:
            numbers, bad = self._convert_carefully(cells)
        self.good += len(numbers) - numbers.null_count
        self.bad += bad
        self.rows += len(cells)
        return np.array(numbers.to_numpy(zero_copy_only=False), dtype=np.float64)

    def _convert_carefully(self, cells: pa.Array) -> tuple[pa.Array, int]:
        cells = pc.ascii_trim_whitespace(cells)
        cells = pc.replace_substring_regex(cells, "^(?i:true)$", "1")
        cells = pc.replace_substring_regex(cells, "^(?i:false)$", "0")
        number = pc.match_substring_regex(cells, _CELL)
        empty = pc.equal(cells, "")
        wrong = pc.fill_null(pc.and_not(pc.invert(number), empty), False)
        count = int(pc.sum(wrong).as_py() or 0)
        if count and not self.bad:
            at = int(pc.index(wrong, True).as_py())
            self.first_row = self.rows + at
            self.first = bytes(pc.cast(cells[at], pa.binary()).as_py()).decode("utf-8", "replace")
        nothing = pa.scalar(None, pa.string())
        return pc.cast(pc.if_else(pc.fill_null(number, False), cells, nothing), pa.float64()), count


def numbers_and_words(column: pa.Array) -> tuple[int, int]:
    """Count the cells that hold a number and those that hold something else: prose has numbers too, between words."""
    cells = Cells()
    cells.convert(column)
    return cells.good, cells.bad
