"""Lines and cells of text tables: what a line is split into, what a cell may hold."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence

WHITESPACE = " "
SEPARATORS = (",", ";", "\t", "|", WHITESPACE)

NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
COMMA_NUMBER = re.compile(r"^[+-]?\d*,\d+([eE][+-]?\d+)?$")
POINT_NUMBER = re.compile(r"^[+-]?\d*\.\d+([eE][+-]?\d+)?$")
GROUPED_BY_POINT = re.compile(r"^[+-]?\d{1,3}(\.\d{3})+,\d+$")
GROUPED_BY_COMMA = re.compile(r"^[+-]?\d{1,3}(,\d{3})+\.\d+$")
"""Thousands apart and a decimal mark, which leaves no doubt which of the two is which."""

_BLANKS = re.compile(r"\s+(?![\[(])")
"""Between cells; a unit in brackets belongs to the name ahead of it."""
_NUMBER = re.compile(NUMBER)
_NOT_A_NUMBER = re.compile(r"^(nan|[+-]?inf(inity)?|n/?a|null|none)$", re.IGNORECASE)
_CLOCK = r"-?\d{1,4}:\d\d(?::\d\d(?:[.,]\d+|:\d{3})?)?(?:\s*[ap]\.?m\.?)?|\d{1,3}:\d\d[.,]\d+"
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
    """Tell whether a cell holds a number, a date or a word for none."""
    if _NUMBER.match(cell) or _NOT_A_NUMBER.match(cell) or _DATE.match(cell) or GROUPED_BY_COMMA.match(cell):
        return True
    return decimal_comma and (COMMA_NUMBER.match(cell) or GROUPED_BY_POINT.match(cell)) is not None


def most_common_width(rows: Sequence[Sequence[str]]) -> int:
    """Return how many cells most rows have, 0 where there are no rows."""
    counts = Counter(len(row) for row in rows)
    return counts.most_common(1)[0][0] if counts else 0
