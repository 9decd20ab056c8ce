"""The last line of a text table that was cut off within a number, as where power failed: half a number is another one."""

from __future__ import annotations

from pathlib import Path

from vsalog.readers.table_text import WHITESPACE, split

_TAIL = 1 << 16
_ENOUGH = 10


def cut_off(path: Path, separator: str) -> bytes:
    """Return the last line of a file where it has no end and its last cell is shorter than all of the lines ahead, else b""."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - _TAIL, 0))
        lines = file.read().replace(b"\r\n", b"\n").split(b"\n")
    last = lines.pop()
    if not last.strip() or len(lines) < _ENOUGH:
        return b""
    cells = [_last_cell(line, separator) for line in lines[1:] if line.strip()]
    cell = _last_cell(last, separator)
    # Numbers that are written as short as can be have any length: only where all have the same one may be too short.
    lengths, decimals = {len(c) for c in cells}, {_decimals(c) for c in cells}
    shorter = len(lengths) == 1 and len(cell) < min(lengths)
    return last if shorter or (len(decimals) == 1 and _decimals(cell) < min(decimals)) else b""


def _last_cell(line: bytes, separator: str) -> str:
    text = line.decode("latin-1")
    return (text.split() if separator == WHITESPACE else split(text, separator) or [""])[-1]


def _decimals(cell: str) -> int:
    """Return how many characters there are behind the decimal mark."""
    return len(cell.replace(",", ".").partition(".")[2])
