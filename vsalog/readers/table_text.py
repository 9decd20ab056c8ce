"""Lines and cells of text tables: what a line is split into, what a cell may hold."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

from vsalog.core.unit_tables import OFFSET_UNITS
from vsalog.core.units import is_known_by_heart

WHITESPACE = " "
SEPARATORS = (",", ";", "\t", "|", WHITESPACE)
_WORDS = (
    "NA", "N/A", "n/a", "N.A.", "#N/A", "#NA", "#NV", "null", "NULL", "Null", "None", "none", "nil", "missing",
    "#DIV/0!", "#VALUE!", "#NUM!", "#REF!",
)  # fmt: skip
NULLS = ("", "-", "--", "?", "*", *_WORDS)
"""What programs write where there is no number."""
LIKE_NUMBERS = ("-nan", "-NaN", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND", "—")
"""The same, but kept apart, as it takes long to tell of each number that it is none of these."""

NUMBER = r"^[+-]?(\d+(?:\.\d*)?|\.\d+)([eE][+-]?\d+)?$"
COMMA_NUMBER = re.compile(r"^[+-]?\d*,\d+([eE][+-]?\d+)?$")
GROUPED_BY_POINT = re.compile(r"^[+-]?\d{1,3}(\.\d{3})+,\d+$")
GROUPED_BY_COMMA = re.compile(r"^[+-]?\d{1,3}(,\d{3})+\.\d+$")
"""Thousands apart and a decimal mark, which leaves no doubt which of the two is which."""
_QUANTITY = re.compile(
    r"^([+−-]?(?:\d{1,3}(?:['’ \u00a0\u202f]\d{3})+(?:[.,]\d+)?|\d[\d.,]*|[.,]\d+)(?:[eEdD][+-]?\d+)?)\s*([^\d\s.,:;'].*)?$"
)

_BLANKS = re.compile(r"[ \t]+(?![\[(])")
"""Between cells; a unit in brackets belongs to the name ahead of it."""
_NUMBER = re.compile(NUMBER)
_NOT_A_NUMBER = re.compile(r"^(nan|[+-]?inf(inity)?|n/?a|null|none)$", re.IGNORECASE)
_CLOCK = r"(?:\d{1,5} days?,? )?-?\d{1,4}:\d\d(?::\d\d(?:[.,]\d+|:\d{3})?)?(?:\s*[ap]\.?m\.?)?|\d{1,3}:\d\d[.,]\d+"
_DAY = (
    r"\d{1,4}([./-])\d{1,2}\1\d{2,4}|\d{8}(?=[T ])|\d{1,2}[ -][a-zä]{3,9}[ -]\d{2,4}|[a-zä]{3,9} \d{1,2},? \d{4}"
    r"|[a-z]{3} [a-z]{3} [ \d]\d(?= )"
)
_DATE = re.compile(rf"^(?:{_DAY})(?:[T ](?:{_CLOCK}|\d{{6}}).*)?$|^(?:{_CLOCK})$", re.IGNORECASE)


def is_comment(line: str) -> bool:
    """Tell whether a line is a remark; ``%time`` starts the header of a rostopic export."""
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
    """Tell whether a cell holds a number, one with a unit behind it, a date or a word for none."""
    if (
        _NUMBER.match(cell)
        or _NOT_A_NUMBER.match(cell)
        or cell in _WORDS
        or cell in LIKE_NUMBERS
        or _DATE.match(cell)
        or GROUPED_BY_COMMA.match(cell)
    ):
        return True
    if decimal_comma and (COMMA_NUMBER.match(cell) or GROUPED_BY_POINT.match(cell)):
        return True
    quantity = quantity_of(cell)
    return quantity is not None and (decimal_comma or not set(", ") & set(quantity[0]))


def quantity_of(cell: str) -> tuple[str, str] | None:
    """Return the number in a cell, in whatever notation, and the unit behind it, "" for none; None where it is neither.

    >>> quantity_of("1.234,5 Nm"), quantity_of("2 apples")
    (('1.234,5', 'Nm'), None)
    """
    if _NUMBER.match(cell):
        return cell, ""
    match = _QUANTITY.match(cell)
    if match is None or (match[2] and not _is_unit(match[2])):
        return None
    return match[1].strip(), match[2] or ""


@lru_cache(maxsize=4096)
def _is_unit(text: str) -> bool:
    return text in OFFSET_UNITS or is_known_by_heart(text)


def most_common_width(rows: Sequence[Sequence[str]]) -> int:
    """Return how many cells most rows have, 0 where there are no rows."""
    counts = Counter(len(row) for row in rows)
    return counts.most_common(1)[0][0] if counts else 0
