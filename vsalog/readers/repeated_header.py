"""A header further down in a text table: whether it names the same columns, in which order, in which units."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from decimal import Context, Decimal
from typing import NamedTuple

import pyarrow as pa

from vsalog.core.errors import UnitError
from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.core.units import parse_unit, split_header
from vsalog.readers.headers import printable_cell, unique_names
from vsalog.readers.limits import SHOWN
from vsalog.readers.table_dialect import Dialect
from vsalog.readers.table_header import LABVIEW_CLOCK, NO_UNIT, is_clock, named, split_names
from vsalog.readers.table_notation import Notation
from vsalog.readers.table_text import NUMBER, SEPARATORS, WHITESPACE, is_comment, is_value, split
from vsalog.readers.time_names import UNITS, stated_unit

_NANOSECONDS = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9, "d": 86400 * 10**9}
_DIGITS = Context(prec=30, traps=[])
_NUMBER = re.compile(NUMBER)
_GLUED = re.compile(r"^[+-]?[\d.,]*\d(?:[eE][+-]?\d+)?\W*?((?:[#%]|\W?[^\W\d]).*)$")
"""The last number of a row and the first name of a header, as where a file whose last line has no end is put ahead of another."""
_REMARK_BEHIND = re.compile(r"^([^#%]+)([#%].*)$")
_OF_LABVIEW = {LABVIEW_CLOCK: "time [s]", "Comment": ""}
"""What it calls the clock, and remarks behind the rows."""
LONGEST_PAUSE = 1000
"""Steps of a clock for which a log may pause."""


class Line(NamedTuple):
    """A line of words between the rows: as many cells as columns, none of them a value in a column of values.

    Attributes
    ----------
    cells : dict of int to str
        By column, of those that are at hand; without the sign of a remark ahead of them.
    remark : bool
        It begins with # or %.
    blanks : bool
        Nothing but blanks separates its cells, as those of any sentence.
    behind : bool
        It stands behind a row that had no end.
    """

    cells: dict[int, str]
    remark: bool = False
    blanks: bool = False
    behind: bool = False

    @property
    def texts(self) -> list[str]:
        """The cells that are not blank."""
        return [cell for cell in self.cells.values() if cell]


class Order(NamedTuple):
    """What a header says of the columns below it.

    Attributes
    ----------
    places : dict of str to str
        Of each column, the name that the first header has at its place.
    factors : dict of str to Decimal
        What the numbers of columns in another unit are multiplied with.
    findings : tuple of Finding
        What had to be assumed.
    """

    places: dict[str, str]
    factors: dict[str, Decimal]
    findings: tuple[Finding, ...] = ()


class FirstHeader:
    """The header at the top, with which those further down are compared.

    Parameters
    ----------
    dialect : Dialect
        How the table is written.

    Attributes
    ----------
    as_above : Order
        The columns are where the first header has them.
    values : tuple of str
        Columns that hold values; those with the fewest blanks first.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.as_above = Order({name: name for name in dialect.names}, {})
        self._columns = dialect.names
        self._names = list(dialect.names)
        self._headless = all(name == f"column_{i}" for i, name in enumerate(dialect.names))
        self._units = dialect.units
        self._notations = dialect.notations
        self._separator = dialect.separator
        columns = [[cell for cell in cells if cell] for cells in zip(*dialect.rows, strict=True)]
        filled = [
            sum(is_value(cell, notation.decimal_comma) for cell in cells)
            for notation, cells in zip(dialect.notations, columns, strict=False)
        ]
        valued = [i for i, good in enumerate(filled) if 2 * good > len(columns[i])]
        self.values = tuple(dialect.names[i] for i in sorted(valued, key=lambda i: -filled[i]))
        self._valued = set(valued)

    def line(self, text: str) -> Line | None:
        """Return a line as it may be a header; None for one that has other than words, or not as many as columns."""
        if not is_comment(text):
            both = _REMARK_BEHIND.match(text)
            if both and len(split(both[1], self._separator)) == len(self._columns):
                line = self.line(both[2])
                return line and line._replace(behind=True)
            cells = split(text, self._separator)
            line = self._of_cells(self._fitted(cells))
            return line and line._replace(behind=len(cells) > len(self._columns) + 1)
        content = text.strip().lstrip("#%").strip()
        for separator in dict.fromkeys((self._separator, *SEPARATORS)):
            line = self._of_cells(split(content, separator))
            if line is not None and all(line.cells.values()):
                return Line(line.cells, True, separator == WHITESPACE)
        return None

    def _of_cells(self, cells: list[str]) -> Line | None:
        return self.row(dict(enumerate(cells)), False) if len(cells) == len(self._columns) else None

    def _fitted(self, cells: list[str]) -> list[str]:
        """Return the cells of a header that has one too many or too few, or stands behind a row that had no end."""
        width = len(self._columns)
        if len(cells) == width + 1 and (not cells[-1] or cells[0] == LABVIEW_CLOCK):
            return cells[:-1]
        if len(cells) == width - 1 and self._columns[0] == "column_0":
            return ["", *cells]
        if len(cells) == width - 1 and self._columns[-1] == f"column_{width - 1}":
            return [*cells, ""]
        if len(cells) == 2 * width - 1 > 1 and (both := _GLUED.match(cells[width - 1])) and is_value(cells[0], True):
            return [both[1].lstrip("#% "), *cells[width:]]
        return cells

    def row(self, cells: dict[int, str], remark: bool) -> Line | None:
        """Return what `line` does, of those cells of a row that are at hand."""
        cells = {i: cell.lstrip("#% ") if remark and i == 0 else cell for i, cell in cells.items()}
        cells = {i: cell.strip('" ') for i, cell in cells.items()}  # a table without quotes may have some in its header
        if remark and not all(cells.values()):
            return None
        if cells.get(0) == "X_Dimension":  # LabVIEW says so that its clock is one
            return None
        if cells.get(0) == LABVIEW_CLOCK and is_clock(self._columns[0]):
            cells = {i: _OF_LABVIEW.get(cell, cell) for i, cell in cells.items()}
        valued = [(i, cells[i]) for i in self._valued.intersection(cells) if cells[i]]
        if not any(cells.values()) or any(is_value(cell, self._notations[i].decimal_comma) for i, cell in valued):
            return None
        return Line(cells, remark, self._separator == WHITESPACE)

    def whole(self, line: Line) -> bool:
        """Tell whether all cells of a line are at hand."""
        return len(line.cells) == len(self._columns)

    def same(self, line: Line) -> bool:
        """Tell whether a line names each column that is at hand as the first header does, in the same unit."""
        for i, cell in line.cells.items():
            name, unit = split_header(cell)
            if (
                printable(name).strip() != self._columns[i].rpartition("#")[0]
                and printable(name).strip() != self._columns[i]
            ):
                return False
            if self._factor(i, name, unit) != (Decimal(1), False):
                return False
        return True

    def order(self, lines: Sequence[Line]) -> Order | None:
        """Return what the last header among lines that follow one another says; None where none names the same columns.

        Names are the same whatever their case, blanks and punctuation; the clock has many.
        """
        for k in reversed(range(len(lines))):
            order = self._order(lines[k], [[*line.cells.values()] for line in lines[k + 1 :]])
            if order is not None:
                return order
        found = next((line for line in lines if self.names_others([line], None)), None) if self._headless else None
        return None if found is None else self._adopted(found)

    def _adopted(self, line: Line) -> Order:
        """Take a line for the header of a table that has none at the top."""
        self._headless = False
        pairs = split_names([*line.cells.values()])
        self._names, self._units = unique_names([name for name, _ in pairs]), tuple(unit for _, unit in pairs)
        evidence = {"header": printable_cell(", ".join(line.texts))}
        return self.as_above._replace(findings=(Finding(code="table.header_below", evidence=evidence),))

    def names_others(self, lines: Sequence[Line], goes_on: bool | None) -> bool:
        """Tell whether one of some lines is a header, of other columns than the first or in units that do not fit.

        Parameters
        ----------
        lines : sequence of Line
            Those in question.
        goes_on : bool or None
            Whether the clock goes on below them as above, as it does where a program says something; None if nobody knows.
        """
        return any(self._names_others(line, goes_on) for line in lines)

    def _names_others(self, line: Line, goes_on: bool | None) -> bool:
        cells = line.texts
        if len(cells) < 2 or not all(re.search(r"[^\W\d_]", cell) for cell in cells):
            return False
        clock = any(is_clock(cell) and cells.count(cell) == 1 for cell in cells)
        if not clock and len(set(cells)) < len(cells):
            return False
        names = {_bare(split_header(cell)[0]) for cell in cells}
        most = 2 * len(names & {_bare(name) for name in self._names}) >= len(cells)
        if line.remark:  # whose words may be those of a sentence
            return clock and (most or not line.blanks or goes_on is False)
        return clock or most or (not goes_on if len(cells) > 2 else goes_on is False)

    def _order(self, line: Line, below: Sequence[list[str]]) -> Order | None:
        names, own_units, _ = named([*line.cells.values()], below, len(self._columns))
        if self._columns[0].startswith("%time"):
            names = [name.removeprefix("field.") for name in names]
        pairs = split_names(names)
        names = unique_names([name for name, _ in pairs])
        at = self._matched(names)
        if at is None:
            return None
        units = [unit or own for (_, unit), own in zip(pairs, own_units, strict=True)]
        factors: dict[str, Decimal] = {}
        assumed: list[str] = []
        for i, (name, k) in enumerate(zip(self._columns, at, strict=True)):
            factor, same = self._factor(i, names[k], units[k])
            if factor is None:
                return None
            if factor != 1:
                factors[name] = factor
            if same:
                assumed.append(name)
        places = {name: self._columns[k] for name, k in zip(self._columns, at, strict=True)}
        evidence = {"columns": listed_columns(assumed)}
        once = Finding(code="table.unit_stated_once", value=len(assumed), evidence=evidence)
        return Order(places, factors, (once,) if assumed else ())

    def _matched(self, names: Sequence[str]) -> list[int] | None:
        """Return where each column's name is among the names of a header."""
        for key in _KEYS:
            first, again = key(self._names), key(names)
            if len(set(first)) == len(first) and sorted(first) == sorted(again):
                return [again.index(one) for one in first]
        return None

    def _factor(self, column: int, name: str, unit: str | None) -> tuple[Decimal | None, bool]:
        """Return what a column's numbers are multiplied with below a header, None where nobody knows.

        The second tells whether its unit is assumed to be the same, as only one of both headers states it.
        """
        first = self._units[column]
        called = self._columns[column]
        if self._notations[column].unit:  # every cell has it
            return Decimal(1), False
        if is_clock(called):
            first, unit = (_unit_of_time(*one) for one in ((called, first), (name, unit)))
        first, unit = (None if one in NO_UNIT else one for one in (first, unit))
        if first == unit:
            return Decimal(1), False
        if unit is None:
            return Decimal(1), not is_clock(called)  # what a clock's unit is its steps told
        if first is None:
            return Decimal(1) if _size(unit)[0] == 1.0 else None, True
        return _ratio(unit, first), False


def own_rows(dialect: Dialect, lines: Sequence[str]) -> list[int]:
    """Return which of a dialect's first rows are of the first header's columns.

    Parameters
    ----------
    dialect : Dialect
        Of which `rows` and `lines` are asked.
    lines : sequence of str
        The first lines of the file.
    """
    first = FirstHeader(dialect)
    run: list[tuple[int, Line]] = []
    words: set[int] = set()
    end = len(lines)
    for i, text in enumerate(lines[dialect.skip_lines :], start=dialect.skip_lines):
        if not text.strip():
            continue
        line = first.line(text)
        if line is not None:
            run.append((i, line))
            continue
        if is_comment(text) or not run:
            continue
        found = [line for _, line in run]
        order = first.order(found)
        if order is not None:
            words.update(i for i, _ in run)
        if (first.names_others(found, True) and order is None) or (order and order[:2] != first.as_above[:2]):
            end = run[0][0]
            break
        run.clear()
    return [k for k, line in enumerate(dialect.lines) if line - 1 < end and line - 1 not in words]


def listed_columns(names: Iterable[str]) -> str:
    """Return the first names of columns, in quotes."""
    quoted = [f"'{name}'" for name in names]
    return ", ".join(quoted[:SHOWN]) + ", …" * (len(quoted) > SHOWN)


def goes_on(earlier: str, before: str, after: str) -> bool:
    """Tell whether a clock goes on as it did, from two of its cells to a third."""
    try:
        a, b, c = (float(cell.replace(",", ".")) for cell in (earlier, before, after))
    except ValueError:  # a date looks like the others
        return re.sub(r"\d", "0", before) == re.sub(r"\d", "0", after)
    return 0 <= c - b <= LONGEST_PAUSE * max(b - a, 0.0) or c == b


def rescaled(cells: pa.Array, factor: Decimal, notation: Notation) -> pa.Array:
    """Return cells with their numbers multiplied, written as the column's others are."""
    mark = "," if notation.decimal_comma else "."
    plain, _ = notation.plain(cells)
    return pa.array([_times(cell, factor, mark) for cell in plain.to_pylist()], pa.string())


def _times(cell: str | None, factor: Decimal, mark: str) -> str | None:
    if cell is None or not _NUMBER.match(cell.strip()):
        return cell
    return str(_DIGITS.multiply(_DIGITS.create_decimal(cell.strip()), factor)).replace(".", mark)


def _bare(name: str) -> str:
    """Return a name in small letters, without blanks and punctuation, unless it has nothing else."""
    return re.sub(r"[\W_]", "", name.casefold()) or name


def _with_one_clock(names: Sequence[str]) -> list[str]:
    """Return bare names; what the clock is called does not matter where there is one."""
    clocks = [name for name in names if is_clock(name)]
    return ["the clock" if [name] == clocks else _bare(name) for name in names]


_KEYS: tuple[Callable[[Sequence[str]], list[str]], ...] = (
    list,
    lambda names: [" ".join(name.casefold().split()) for name in names],
    lambda names: [_bare(name) for name in names],
    _with_one_clock,
)
"""How names are compared: the first way that tells all of them apart, and finds them all, holds."""


def _unit_of_time(name: str, unit: str | None) -> str | None:
    stated = stated_unit(name, unit)
    return None if stated is None else UNITS.get(stated, stated)


def _size(unit: str) -> tuple[float, ...]:
    """Return a unit's size and dimensions, (0,) where it is not known."""
    try:
        return (parse_unit(unit).factor, *parse_unit(unit).dimension)
    except UnitError:
        return (0.0,)


def _ratio(unit: str, first: str) -> Decimal | None:
    if unit in _NANOSECONDS and first in _NANOSECONDS:
        return Decimal(_NANOSECONDS[unit]) / Decimal(_NANOSECONDS[first])
    (size, *kind), (wanted, *other) = _size(unit), _size(first)
    if kind and kind == other:
        return Decimal(size / wanted) if size != wanted else Decimal(1)
    return Decimal(1) if not kind and not other and unit.casefold() == first.casefold() else None
