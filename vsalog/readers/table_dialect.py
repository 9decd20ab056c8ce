"""How a text table is written."""

from __future__ import annotations

from dataclasses import dataclass

from vsalog.core.finding import Finding
from vsalog.readers.table_notation import Notation


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text table is written.

    Attributes
    ----------
    encoding : str
        Python's name of it.
    separator : str
        One of `SEPARATORS`; `WHITESPACE` stands for any run of blanks.
    quoted : bool
        Cells below the header may be in quotes.
    skip_lines : int
        Lines before the first row of values.
    names, units, notations : tuple
        Of the columns, and how their numbers are written; units None where neither header nor cells state one.
    rows : tuple of tuple of str
        The first rows.
    lines : tuple of int
        The lines they stand in, counted from 1.
    findings : tuple of Finding
        What is worth telling.
    torn : int
        How many names there are where commas both separate cells and stand in numbers, so that rows fall apart; else 0.
    labels : tuple of str
        What stands ahead of the number in every cell, by column; empty where nothing does.
    """

    encoding: str
    separator: str
    quoted: bool
    skip_lines: int
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    notations: tuple[Notation, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    findings: tuple[Finding, ...]
    torn: int
    labels: tuple[str, ...]


def has_quotes(line: str) -> bool:
    """Tell whether a line has cells in quotes; a single quote is damage."""
    count = line.count('"')
    return count > 0 and count % 2 == 0
