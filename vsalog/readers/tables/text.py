"""Lines and cells of text tables: the cells of a line, the content of a cell, the names of columns."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence

from vsalog.core.printable import printable

WHITESPACE = " "
SEPARATORS = (",", ";", "\t", "|", WHITESPACE)
_WORDS = (
    "NA", "N/A", "n/a", "N.A.", "#N/A", "#NA", "#NV", "null", "NULL", "Null", "None", "none", "nil", "missing",
    "#DIV/0!", "#VALUE!", "#NUM!", "#REF!",
)  # fmt: skip
NULLS = ("", "-", "--", "?", "*", *_WORDS)
"""Words of programs for "no number"."""
LIKE_NUMBERS = ("-nan", "-NaN", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND", "—")
"""The same, but separate, since checking each number against them takes long."""

NUMBER = r"^[+-]?(\d+(?:\.\d*)?|\.\d+)([eE][+-]?\d+)?$"
COMMA_NUMBER = re.compile(r"^[+-]?\d*,\d+([eE][+-]?\d+)?$")
BETWEEN_THOUSANDS = "\u00a0\u202f'"
"""Blanks that do not break, as in France, and apostrophes, as in Switzerland: no decimal marks."""
GROUPED = {
    True: re.compile(rf"^[+-]?\d{{1,3}}(?:(?:\.\d{{3}})+,\d+|(?:[{BETWEEN_THOUSANDS}]\d{{3}})+(?:,\d+)?)$"),
    False: re.compile(rf"^[+-]?\d{{1,3}}(?:(?:,\d{{3}})+\.\d+|(?:[{BETWEEN_THOUSANDS}]\d{{3}})+(?:\.\d+)?)$"),
}
"""Separated thousands, which determine the decimal mark; by whether that is a comma."""
DURATION = r"^(?P<number>-?\d+(?:\.\d+)?) (?P<unit>sec|min|hr|days?)$"
"""As MATLAB writes durations."""
_BLANKS = re.compile(r"[ \t]+(?![\[(])")
"""Between cells; a unit in brackets belongs to the name ahead of it."""
_NUMBER, _DURATION = re.compile(NUMBER), re.compile(DURATION)
_NOT_A_NUMBER = re.compile(r"^(nan|[+-]?inf(inity)?|n/?a|null|none)$", re.IGNORECASE)
_CLOCK = r"(?:\d{1,5} days?,? )?-?\d{1,4}:\d\d(?::\d\d(?:[.,]\d+)?)?(?:\s*[ap]\.?m\.?)?|\d{1,3}:\d\d[.,]\d+"
_DAY = r"\d{1,4}([./-])\d{1,2}\1\d{2,4}|\d{8}(?=[T ])|\d{1,2}[ -][a-z]{3,9}[ -]\d{2,4}"
_DATE = re.compile(rf"^(?:{_DAY})(?:[T ](?:{_CLOCK}|\d{{6}}).*)?$|^(?:{_CLOCK})$", re.IGNORECASE)
_LIST = re.compile(r"^\[\s*(?:[+-]?[\d.]|nan)[^\]]*\]$")


def is_comment(line: str) -> bool:
    """Return whether a line is a remark; ``%time`` starts the header of a rostopic export."""
    start = line.lstrip()
    return start.startswith("#") or (start.startswith("%") and not start.startswith("%time"))


def split(line: str, separator: str) -> list[str]:
    """Split a line into its cells, without the blanks around them."""
    if separator == WHITESPACE:
        return _BLANKS.split(line.strip())
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    except (csv.Error, StopIteration):
        return line.split(separator)


def is_value(cell: str, decimal_comma: bool) -> bool:
    """Return whether a cell contains a number, a list, a date, a duration or a word for none."""
    found = (
        cell in _WORDS
        or cell in LIKE_NUMBERS
        or any(one.match(cell) for one in (_NUMBER, _NOT_A_NUMBER, _DATE, _DURATION, _LIST, GROUPED[decimal_comma]))
    )
    return found or (decimal_comma and COMMA_NUMBER.match(cell) is not None)


def most_common_width(rows: Sequence[Sequence[str]]) -> int:
    """Return how many cells most rows have, 0 where there are no rows."""
    counts = Counter(len(row) for row in rows)
    return counts.most_common(1)[0][0] if counts else 0


def has_quotes(line: str) -> bool:
    """Return whether a line has cells in quotes; a single quote is damage."""
    count = line.count('"')
    return count > 0 and count % 2 == 0


def unique_names(names: Sequence[str]) -> list[str]:
    """Return names for all columns: ``column_3`` for an empty one, ``x#2`` for the second ``x``."""
    taken: dict[str, int] = {}
    result = []
    for i, name in enumerate(names):
        name = printable(name).strip() or f"column_{i}"
        taken[name] = taken.get(name, 0) + 1
        result.append(name if taken[name] == 1 else f"{name}#{taken[name]}")
    return result


def printable_cell(text: str) -> str:
    """Return a cell or line for a message: short, without anything that could disturb a terminal."""
    text = printable(text)
    return text if len(text) <= 40 else text[:39] + "…"
