"""A last line without an end, as where power failed while a number was written: half a number is another one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vsalog.core.significance import REPEATS
from vsalog.readers.limits import GLANCE_BYTES
from vsalog.readers.table_text import WHITESPACE, is_comment, split

_NUMBER = re.compile(r"^[+-]?(\d*)(?:[.,](\d*))?$")


def cut_off(path: Path, separator: str) -> bytes:
    """Return the last line of a file where it has no end and its last cell may have been longer, else b""."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - GLANCE_BYTES, 0))
        lines = file.read().replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
    last = lines.pop()
    ahead = [line.decode("latin-1") for line in lines[size > GLANCE_BYTES :]]
    return last if may_be_cut(ahead, last.decode("latin-1"), separator) else b""


def may_be_cut(lines: Sequence[str], last: str, separator: str) -> bool:
    """Tell whether the last cell of a line without an end may have been longer.

    Where programs do not end the last line, most have written all of it: as long as the longest above it, in the same format, a
    number is whole, and what lacks digits that hardly count is no other number.

    Parameters
    ----------
    lines : sequence of str
        Those ahead of it, whole.
    last : str
        The line.
    separator : str
        What separates cells.
    """
    rows = [line for line in lines if line.strip() and not is_comment(line)]
    if not last.strip() or is_comment(last) or last.endswith('"') or len(rows) < REPEATS:
        return False
    width = len(_cells(last, separator))
    above = [cells[-1] for line in rows if len(cells := _cells(line, separator)) == width]
    cell = _cells(last, separator)[-1]
    if len(above) < REPEATS:
        return False
    if not cell:
        return "" not in above
    for sign in ("", "+-"):  # of one width with it or without it
        widths = {len(one.lstrip(sign)) for one in above[1:]}  # the header's may be the first
        if len(widths) == 1:
            return len(cell.lstrip(sign)) < min(widths)
    longer = any(one != cell and one.startswith(cell) for one in above)
    return longer if cell in above and len(set(above)) < len(above) / 4 else _lacks_digits(cell, above)


def _lacks_digits(cell: str, above: Sequence[str]) -> bool:
    """Tell whether a number has fewer digits than some above it, and may have lost some that count."""
    parts = [match for one in above if (match := _NUMBER.match(one))]
    number = _NUMBER.match(cell)
    if number is None or len(parts) < len(above) - 1:  # the header may be among them
        return True  # exponents, or words
    decimals, others = len(number[2] or ""), {len(part[2] or "") for part in parts}
    if others != {0} and (len(others) == 1 or decimals == max(others)):
        return decimals < max(others)
    if _digits(number) >= max(_digits(part) for part in parts):
        return False
    values = [_value(part) for part in parts]
    # Digits that single precision would not have make no other number.
    return not decimals or 10.0**-decimals > float(np.finfo(np.float32).resolution) * (max(values) - min(values))


def _digits(number: re.Match[str]) -> int:
    """Return how many digits count."""
    return len((number[1] + (number[2] or "")).lstrip("0"))


def _value(number: re.Match[str]) -> float:
    try:
        return float(number[0].replace(",", "."))
    except ValueError:  # a sign alone
        return 0.0


def _cells(line: str, separator: str) -> list[str]:
    return line.split() if separator == WHITESPACE else split(line, separator)
