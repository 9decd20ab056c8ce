"""The clock columns of a table, and their values in nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import MOST_EXCEPTIONS, SAMPLE_ROWS
from vsalog.readers.reach import Nanoseconds
from vsalog.readers.tables.dates import dates, dates_of, format_of, of_day, possible_formats, trimmed, without_midnight
from vsalog.readers.tables.text import DURATION, printable_cell
from vsalog.readers.tables.time_numbers import floats, is_numeric, multiplied, scaled_up
from vsalog.readers.tables.time_units import EPOCH, SERIAL, UNITS, Rank, guessed_unit, plain, rank_of, stated_unit

# Decimal digits from the unit to the nanosecond.
_DIGITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
_NANOSECONDS = {"min": 60 * 10**9, "h": Nanoseconds.HOUR, "d": Nanoseconds.DAY}

_SECONDS = re.compile(r"^(?P<stem>.*?)(?:^|[._/])(secs?)$")
_FRACTION = dict.fromkeys(("nanosec", "nsec", "nsecs", "nanosecs"), "pair") | dict.fromkeys(
    ("usec", "usecs"), "pair us"
)


@dataclass(frozen=True, slots=True)
class ClockColumn:
    """Columns that give one clock.

    Attributes
    ----------
    columns : tuple of int
        One column, or seconds and nanoseconds, or date and time of day.
    form : str
        A unit (``s``, ``ms``, ``us``, ``ns``, ``min``, ``h``, ``d``), ``serial`` or ``datenum`` (days), ``date``, ``day`` (time
        of day), ``minutes`` (``59:58.5``), ``duration s`` (``0.5 sec``), ``pair``, ``pair us`` or
        ``date+day``. After ``date`` and ``date+day`` may be the format of dates: ``date %d.%m.%Y``.
    """

    columns: tuple[int, ...]
    form: str


@dataclass(frozen=True, slots=True)
class ClockPlan:
    """The clocks of a table by kind, and the findings about the choice.

    Attributes
    ----------
    clocks : dict of str to ClockColumn
        By kind; none where no column is a clock.
    findings : tuple of Finding
        Findings about the choice.
    backwards : tuple of int, or None
        Where there is no clock: the column that has the name of one but runs backwards, and the row where it does.
    """

    clocks: dict[str, ClockColumn] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    backwards: tuple[int, int] | None = None

    def columns(self) -> set[int]:
        """Return the columns that are clocks, not channels."""
        return {column for clock in self.clocks.values() for column in clock.columns}


Rest = Callable[[], Iterable[pa.Array]]
Whole = Callable[[int], Iterable[pa.Array]]
"""Returns all of a column, part by part."""


def _nothing(_: int) -> Iterable[pa.Array]:
    return ()


def find_clocks(
    names: Sequence[str],
    units: Sequence[str | None],
    sample: Sequence[pa.Array],
    whole: Whole = _nothing,
    *,
    by_rise: bool = False,
) -> ClockPlan:
    """Find the clocks of a table by its headers, checked against its first rows.

    Parameters
    ----------
    names, units : sequence of str
        Of all columns; units None where the header states none.
    sample : sequence of pyarrow arrays
        The columns' first rows.
    whole : callable, optional
        Called for dates whose day and month the first rows do not determine.
    by_rise : bool
        Whether a first column that increases evenly is the time where no other is.
    """
    pair = _second_and_fraction(names, sample)
    ranked = sorted(
        (rank, i) for i, name in enumerate(names) if (rank := rank_of(name)) is not None and i < len(sample)
    )
    clocks: list[tuple[int, ClockColumn, tuple[Finding, ...]]] = []
    for rank, i in ranked:
        form, doubts = _form(names[i], units[i], sample[i], partial(whole, i))
        if form is not None and (rank != Rank.DATED or _is_moment(form, sample[i])):
            clock, more = _with_date(ClockColumn((i,), form), names, sample, whole)
            clocks.append((rank, clock, (*doubts, *more)))
    best = clocks[0][0] if clocks else len(Rank)
    if pair and best > 0:
        return ClockPlan({"column": pair})
    if not clocks and (found := _unnamed(names, sample, whole)):
        return found
    if not clocks and by_rise and not ranked and (found := _rising_first(names, units, sample)):
        return found
    if not clocks:
        falls = ((i, row) for _, i in ranked if (row := _backwards(sample[i])) is not None)
        return ClockPlan(findings=_no_clock(ranked, names, units, sample), backwards=next(falls, None))
    log = next((c for _, c, _ in clocks if names[c.columns[0]] == "%time"), None)
    if log is not None and best == 0:  # an export of rostopic: the header's stamp, and when it was received
        return ClockPlan({"header": clocks[0][1], "log": log})
    return ClockPlan({"column": clocks[0][1]}, clocks[0][2])


def _unnamed(names: Sequence[str], sample: Sequence[pa.Array], whole: Whole) -> ClockPlan | None:
    """Return the clock without such a name, but with unambiguous cells: a date with a time of day in each, which increase.

    Those of a column without a name may be times of day alone.
    """
    for i, cells in enumerate(sample):
        if not (_is_text(cells) or pa.types.is_timestamp(cells.type)):
            continue
        form, doubts = _form(names[i], None, cells, partial(whole, i))
        if form is None or not (_is_moment(form, cells) or (form == "day" and names[i] == f"column_{i}")):
            continue
        stamps, good = nanoseconds([cells], form)
        if _rising(stamps[good].astype(np.float64)) and len(np.unique(stamps[good])) > len(cells) / 2:
            taken = Finding(code="clock.guessed_by_dates", part=names[i])
            return ClockPlan({"column": ClockColumn((i,), form)}, (taken, *doubts))
    return None


def _rising_first(names: Sequence[str], units: Sequence[str | None], sample: Sequence[pa.Array]) -> ClockPlan | None:
    """Return the first column as the clock where it increases evenly, and differs from the row's number."""
    stated = units[0] if units else None
    if not sample or not is_numeric(sample[0]) or not (stated is None or stated.strip().lower() in UNITS):
        return None
    values = floats(sample[0])
    if not _rises_evenly(values) or float(np.median(np.diff(values))) == 1.0:
        return None
    form, doubts = (UNITS[stated.strip().lower()], []) if stated else guessed_unit(names[0], values)
    return ClockPlan(
        {"column": ClockColumn((0,), form)}, (Finding(code="clock.guessed_by_rise", part=names[0]), *doubts)
    )


def runs_backwards(column: str, where: str) -> Finding:
    """Return that the column with the name of the time runs backwards, in a line or row."""
    return Finding(code="clock.runs_backwards", part=printable_cell(column), evidence={"where": where})


def looks_like_clock(values: NDArray[np.float64]) -> bool:
    """Return whether values rise in even steps that are no whole numbers, as times do."""
    return _rises_evenly(values) and bool((values % 1 != 0).any())


def _rises_evenly(values: NDArray[np.float64]) -> bool:
    if len(values) < 8 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    return bool(steps.min() > 0 and steps.max() < 5 * np.median(steps))


def nanoseconds(columns: Sequence[pa.Array], form: str) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return a clock's stamps [ns], shape (n,), and which rows have one.

    Whole numbers and decimal fractions are converted exactly, without passing through floating point.

    Parameters
    ----------
    columns : sequence of pyarrow arrays, each of length n
        The clock's columns.
    form : str
        As in `ClockColumn`.
    """
    kind, _, order = form.partition(" ")
    if kind == "pair":
        seconds, good = scaled_up(columns[0], 9)
        fraction, also = scaled_up(columns[1], _DIGITS[order or "ns"])
        good &= also & (np.abs(seconds // 2 + fraction // 2) < 2**61)  # their sum fits into 64 bits, and is a time
        return np.where(good, seconds, 0) + np.where(good, fraction, 0), good
    if kind == "duration":
        return nanoseconds([pc.replace_substring_regex(trimmed(columns[0]), DURATION, r"\1")], order)
    if kind == "date+day":
        joined = pc.binary_join_element_wise(without_midnight(trimmed(columns[0])), trimmed(columns[1]), " ")
        return dates(joined, order)
    if kind == "date":
        return dates(columns[0], order)
    if kind in ("day", "minutes"):
        text = trimmed(columns[0])
        return of_day(pc.binary_join_element_wise("0:", text, "") if kind == "minutes" else text)
    if kind in SERIAL:
        return multiplied(columns[0], Nanoseconds.DAY, SERIAL[kind][2])
    if kind in _NANOSECONDS:
        return multiplied(columns[0], _NANOSECONDS[kind])
    return scaled_up(columns[0], _DIGITS[kind])


def digits_of(form: str) -> tuple[int, ...]:
    """Return the digits after the decimal point to which each numeric column of a clock is read exactly; () for other clocks."""
    kind, _, order = form.partition(" ")
    if kind == "pair":
        return _DIGITS["s"], _DIGITS[order or "ns"]
    return (_DIGITS[kind],) if kind in _DIGITS else ()


def _form(name: str, unit: str | None, sample: pa.Array, rest: Rest) -> tuple[str | None, list[Finding]]:
    """Return the form of a column's times, None where it has none, and the findings about it."""
    kind = sample.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        return "date", []
    if pa.types.is_time(kind) or pa.types.is_duration(kind):
        return "ns", []
    if _is_text(sample):
        return _written_form(name, sample, rest)
    values = floats(sample)
    values = values[np.isfinite(values)]
    if not len(values) or not (_rising(values) or _sortable(name, values)):
        return None, []
    stated = stated_unit(name, unit)
    if stated is not None:
        return UNITS.get(stated), []
    return guessed_unit(name, values if values.any() else _once_set(rest))


def _once_set(rest: Rest) -> NDArray[np.float64]:
    """Return a column's first numbers that are not zero, as they are until a clock is set."""
    for cells in rest():
        values = floats(cells)
        values = values[np.isfinite(values) & (values != 0)]
        if len(values):
            return np.asarray(values[:SAMPLE_ROWS], np.float64)
    return np.zeros(1)


def _is_text(sample: pa.Array) -> bool:
    return (pa.types.is_string(sample.type) or pa.types.is_large_string(sample.type)) and not is_numeric(sample)


def _written_form(name: str, sample: pa.Array, rest: Rest) -> tuple[str | None, list[Finding]]:
    """Return the format of dates or times of day, None where a text is neither, and the findings about it."""
    if _reads(sample, "date"):
        return "date", []
    order, doubts = _order(name, sample, rest)
    if order and _reads(sample, f"date {order}"):
        return f"date {order}", doubts
    if _reads(sample, "day"):
        return "day", []
    units = pc.struct_field(pc.extract_regex(sample, DURATION), "unit").drop_null().unique().to_pylist()
    if len(units) == 1 and _reads(sample, form := f"duration {UNITS[units[0]]}"):
        return form, []
    if _reads(sample, "minutes"):
        return "minutes", [Finding(code="clock.minutes_and_seconds", part=name)]
    return None, []


def _reads(sample: pa.Array, form: str) -> bool:
    """Return whether nearly all cells are times in a form."""
    _, good = nanoseconds([sample], form)
    return bool(good.any() and good.mean() > (1 - MOST_EXCEPTIONS))


def _order(name: str, sample: pa.Array, rest: Rest) -> tuple[str, list[Finding]]:
    """Return the format of a column's dates and the findings about it, see `format_of`."""
    dates = dict.fromkeys(dates_of(without_midnight(trimmed(sample))))
    if len(possible_formats(list(dates))) > 1:
        for cells in rest():
            dates |= dict.fromkeys(dates_of(without_midnight(trimmed(cells))))
            if len(dates) > SAMPLE_ROWS or len(possible_formats(list(dates))) < 2:
                break
    return format_of(name, list(dates))


def _rising(values: NDArray[np.float64]) -> bool:
    """Return whether values grow like a clock's: nearly always, and on the whole. All zero is a clock that was not set."""
    if len(values) < 2 or not values.any():
        return True
    steps = np.diff(values)
    grows = values[-1] > values[0] or values[0] > EPOCH[0]  # nanoseconds of today are too large to differ as floats
    return bool(np.count_nonzero(steps >= 0) >= (1 - MOST_EXCEPTIONS) * len(steps) and grows)


def _sortable(name: str, values: NDArray[np.float64]) -> bool:
    """Return whether a column that is surely the time by its name has the newest row first, or slightly late rows."""
    rank = rank_of(name)
    if rank is None or rank >= Rank.SHORT or len(values) < REPEATS:
        return False
    order = np.argsort(values, kind="stable")
    late = np.abs(order - np.arange(len(order))).max()
    return bool((np.diff(values) < 0).all() or late <= REPEATS)


def _backwards(sample: pa.Array) -> int | None:
    """Return the first row that is less than the one before."""
    values = floats(sample)
    rows = np.flatnonzero(np.isfinite(values))
    falls = np.flatnonzero(np.diff(values[rows]) < 0)
    return int(rows[falls[0] + 1]) if falls.size else None


def _second_and_fraction(names: Sequence[str], sample: Sequence[pa.Array]) -> ClockColumn | None:
    """Return the columns of a stamp that is split into seconds and nanoseconds."""
    lowered = {name.strip().lower(): i for i, name in enumerate(names)}
    for name, i in lowered.items():
        match = _SECONDS.match(name)
        if match is None or not (match["stem"] == "" or match["stem"].endswith(("stamp", "time", "tv"))):
            continue
        lead = name[: match.start(2)]
        for ending, form in _FRACTION.items():
            other = lowered.get(lead + ending)
            if other is not None and all(is_numeric(sample[c]) for c in (i, other)):
                return ClockColumn((i, other), form)
    return None


def _with_date(
    clock: ClockColumn, names: Sequence[str], sample: Sequence[pa.Array], whole: Whole
) -> tuple[ClockColumn, list[Finding]]:
    """Join a time of day with the date in another column, where there is one; return the findings about it, too."""
    if clock.form != "day":
        return clock, []
    unread: list[Finding] = []
    for i, name in enumerate(names[: len(sample)]):
        if rank_of(name) != Rank.DATED:
            continue
        order, doubts = _order(name, sample[i], partial(whole, i))
        both = ClockColumn((i, clock.columns[0]), f"date+day {order}".strip())
        _, good = nanoseconds([sample[c] for c in both.columns], both.form)
        if good.mean() > 0.5:
            return both, doubts
        if _is_text(sample[i]) or not plain(name).startswith("data"):
            evidence = {"first": _first(sample[i])}
            unread = unread or [Finding(code="clock.dates_unreadable", part=name, evidence=evidence)]
    return clock, unread


def _no_clock(
    ranked: Sequence[tuple[int, int]], names: Sequence[str], units: Sequence[str | None], sample: Sequence[pa.Array]
) -> tuple[Finding, ...]:
    """Return why columns with the name of a clock are none."""
    for rank, i in ranked:
        stated = stated_unit(names[i], units[i])
        if _is_text(sample[i]) and rank != Rank.DATED:
            evidence = {"first": _first(sample[i])}
            return (Finding(code="clock.times_unreadable", part=names[i], evidence=evidence),)
        if rank < Rank.SHORT and stated is not None and stated not in UNITS:
            return (Finding(code="clock.unit_unknown", part=names[i], evidence={"stated": stated}),)
    return ()


def _first(sample: pa.Array) -> str:
    cell = next((cell for cell in sample.to_pylist() if cell is not None), None)
    return "all are blank" if cell is None else f"the first: '{printable_cell(str(cell))}'"


def _is_moment(form: str, sample: pa.Array) -> bool:
    """Return whether a column named as a date contains the time of day as well."""
    if _is_text(sample):
        return form.startswith("date") and bool(pc.any(pc.match_substring(sample, ":")).as_py())
    return form in SERIAL or pa.types.is_timestamp(sample.type)
