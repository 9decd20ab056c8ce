"""How the numbers in a table's columns are written: decimal mark, thousands, exponents, units behind them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.compute as pc

from vsalog.core.finding import Finding
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import MOST_EXCEPTIONS
from vsalog.readers.table_text import quantity_of

_NUMBER = re.compile(r"^[+-]?\d*([.,])\d+(?:[eE][+-]?\d+)?$")
_BOTH = re.compile(r"^[+-]?\d{1,3}(?:(?:\.\d{3})+(,)|(?:,\d{3})+(\.))\d+$")
"""Thousands apart and a decimal mark, which leaves no doubt which of the two is which."""
_GROUPS = re.compile(r"^[+-]?[1-9]\d{0,2}(?:(?:\.\d{3})+|(?:,\d{3})+)$")
"""Either thousands, or three decimals."""
_GROUPED = {
    ".": r"^[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d+)?$",
    ",": r"^[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d+)?$",
}
_BLANKS = "['’ \u00a0\u202f]"
_BLANK_GROUPED = rf"^[+-]?\d{{1,3}}(?:{_BLANKS}\d{{3}})+(?:[.,]\d+)?$"
_HEXADECIMAL = re.compile(r"^(?:[0-9A-F]{2,}|[0-9a-f]{2,})$")
_FORTRAN = re.compile(r"^[+-]?(?:\d+(?:\.\d*)?|\.\d+)[dD][+-]?\d+$")


@dataclass(frozen=True, slots=True)
class Notation:
    """How the numbers of a column are written, where that is not as in programs.

    Attributes
    ----------
    decimal_comma : bool
        As ``1,5``; a point sets thousands apart then.
    grouped : bool
        Where the decimal mark is a point, a comma sets thousands apart.
    blanks : bool
        Blanks or apostrophes set thousands apart.
    fortran : bool
        Exponents are written ``1.5D+03``.
    minus : bool
        There are minus signs that are no hyphens.
    unit : str
        Stands behind every number, "" for none.
    mixed : str
        Units that stand behind numbers where they are not all the same.
    hexadecimal : bool
        They are written ``1F``, so that those without letters would be read as others.
    fraction : bool
        Every number has a decimal comma, so that ``100.000`` is no thousand, but written with a decimal point.
    """

    decimal_comma: bool = False
    grouped: bool = False
    blanks: bool = False
    fortran: bool = False
    minus: bool = False
    unit: str = ""
    mixed: str = ""
    hexadecimal: bool = False
    fraction: bool = False

    def plain(self, cells: pa.Array) -> tuple[pa.Array, str]:
        """Return cells with numbers as ``1234.5``, and the first with a point or comma that (seemingly) sets thousands apart."""
        if self.hexadecimal:
            return pc.binary_join_element_wise("0x", cells, ""), ""
        if self.minus:
            cells = pc.replace_substring(cells, "−", "-")
        if self.unit:
            cells = pc.replace_substring_regex(cells, f"[\\s\u00a0\u202f]*{re.escape(self.unit)}\\s*$", "")
        if self.fortran:
            cells = pc.replace_substring_regex(cells, r"^([+-]?[\d.]+)[dD]([+-]?\d+)$", r"\1e\2")
        if self.blanks:
            apart = pc.fill_null(pc.match_substring_regex(cells, _BLANK_GROUPED), False)
            cells = pc.if_else(apart, pc.replace_substring_regex(cells, _BLANKS, ""), cells)
        mark = "." if self.decimal_comma else ","
        example = ""
        if (self.decimal_comma or self.grouped) and mark.encode() in _bytes_of(cells):
            apart = pc.fill_null(pc.match_substring_regex(cells, _GROUPED[mark]), False)
            at = pc.index(apart, True).as_py()
            if at >= 0:
                example = str(cells[at].as_py())
                if self.fraction:
                    apart = pc.and_(apart, pc.fill_null(pc.match_substring(cells, ","), False))
                cells = pc.if_else(apart, pc.replace_substring(cells, mark, ""), cells)
        return (_with_points(cells) if self.decimal_comma else cells), example


def _bytes_of(cells: pa.Array) -> bytes:
    """Return the text of all cells, of the array that they are a part of too: to look through it is many times as fast."""
    text = cells.buffers()[2]
    return b"" if text is None else text.to_pybytes()


def _with_points(cells: pa.Array) -> pa.Array:
    """Write a point for every comma."""
    valid, begins, text = cells.buffers()
    if text is None:
        return cells
    text = pa.py_buffer(text.to_pybytes().replace(b",", b"."))
    return pa.Array.from_buffers(cells.type, len(cells), [valid, begins, text], cells.null_count, cells.offset)


def find_notations(rows: Sequence[Sequence[str]], width: int, separator: str) -> tuple[list[Notation], list[Finding]]:
    """Tell how the columns of a table write numbers, and what of it is worth telling.

    Parameters
    ----------
    rows : sequence of sequence of str
        The first rows, perhaps with the header.
    width : int
        Cells of a row.
    separator : str
        What separates them.
    """
    columns = [_Column([row[i] for row in rows if len(row) == width and row[i]]) for i in range(width)]
    commas = [column for column in columns if column.mark == ","]
    points = [column for column in columns if column.mark == "."]
    default, found = bool(commas), list[Finding]()
    if commas and points:
        default = sum(c.commas for c in commas) > sum(c.points for c in points)
        found.append(Finding(code="table.mixed_decimal_marks"))
    elif not commas and not points:
        count = {mark: sum(column.groups[mark] for column in columns) for mark in ".,"}
        default = separator != "," and count[","] > (1 - MOST_EXCEPTIONS) * sum(count.values())
        if default:
            found.append(Finding(code="table.decimal_commas"))
    return [column.notation(default) for column in columns], found


class _Column:
    """The first cells of a column, the header's among them, and what they tell of its decimal mark."""

    def __init__(self, cells: Sequence[str]) -> None:
        self._hexadecimal = _are_hexadecimal(cells)
        quantities = [quantity for cell in cells if (quantity := quantity_of(cell))]
        units = Counter(unit for _, unit in quantities).most_common()
        sure = bool(units) and units[0][1] > (1 - MOST_EXCEPTIONS) * len(quantities)
        self._unit = units[0][0] if sure else ""
        self._mixed = "" if sure else ", ".join(f"'{unit}'" for unit, _ in units if unit)
        numbers = [number.replace("−", "-") for number, _ in quantities]
        self._minus = any("−" in number for number, _ in quantities)
        self._fortran = any(_FORTRAN.match(number) for number in numbers)
        self._blanks = any(re.match(_BLANK_GROUPED, number) for number in numbers)
        self._grouped = False
        self._numbers = len(numbers)
        self.commas = self.points = 0
        self.groups = {".": 0, ",": 0}
        for number in numbers:
            self._count(re.sub(_BLANKS, "", number) if self._blanks else number)
        self.mark = ""
        if self.commas > (1 - MOST_EXCEPTIONS) * (self.commas + self.points):
            self.mark = ","
        elif self.points > (1 - MOST_EXCEPTIONS) * (self.commas + self.points):
            self.mark = "."

    def _count(self, number: str) -> None:
        if _GROUPS.match(number):
            self.groups["." if "." in number else ","] += 1
            return
        match = _NUMBER.match(number) or _BOTH.match(number)
        if match:
            comma = "," in match.groups()
            self.commas += comma
            self.points += not comma
            self._grouped |= not comma and "," in number

    def notation(self, default: bool) -> Notation:
        """Return how it writes numbers, with a decimal comma by `default` where it does not tell."""
        comma = self.mark == "," or (default and not self.mark)
        grouped = not comma and (self._grouped or self.groups[","] > 0)
        return Notation(
            comma,
            grouped,
            self._blanks,
            self._fortran,
            self._minus,
            self._unit,
            self._mixed,
            self._hexadecimal,
            comma and self.commas + self.groups[","] == self._numbers > REPEATS,
        )


def _are_hexadecimal(cells: Sequence[str]) -> bool:
    """Tell whether cells, but for a header, are hexadecimal numbers of one length, some with letters."""
    found = [cell for cell in cells if _HEXADECIMAL.match(cell)]
    lettered = sum(quantity_of(cell) is None for cell in found)
    return len(found) >= max(len(cells) - 2, 3) and lettered > 0 and len({len(cell) for cell in found}) == 1
