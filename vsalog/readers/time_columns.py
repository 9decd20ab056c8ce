"""Which columns of a table are its clock, and what they say in nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.readers.time_dates import dates, in_nanoseconds, integers, scaled, trimmed
from vsalog.recording import Stamps

# Decimal digits from the unit to the nanosecond.
_DIGITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
_UNIT_NAMES = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "ms": "ms", "msec": "ms", "msecs": "ms", "millisecond": "ms", "milliseconds": "ms",
    "us": "us", "µs": "us", "μs": "us", "usec": "us", "microsecond": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nanosec": "ns", "nanosecond": "ns", "nanoseconds": "ns",
}  # fmt: skip
_WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}

# Best first. What follows the stem may be a unit: time_ms.
_STEMS = (
    r"(field\.)?header[._/]stamp",
    r"__time|%time|stamp|time_?stamp|unix_?time|ros_?time|epoch",
    r"time|date_?time|(elapsed|relative|rel)_time|time_elapsed|elapsed|(uhr)?zeit|zeitstempel|temps|tiempo|tempo",
    r"t|secs?|seconds",
)
_NAME = [re.compile(rf"^(?:{stem})(?:_(?P<unit>s|secs?|ms|msec|us|usec|ns|nsec))?$") for stem in _STEMS]
_SECONDS = re.compile(r"^(?P<stem>.*?)(?:^|[._/])(secs?)$")
_DATE_NAMES = ("date", "datum", "fecha", "data")
_FRACTION = ("nanosec", "nsec", "nsecs", "nanosecs")

# Epoch seconds between 2000 and 2100; in other units by powers of a thousand.
_EPOCH = (946_684_800, 4_102_444_800)


@dataclass(frozen=True, slots=True)
class ClockColumn:
    """Columns that give one clock.

    Attributes
    ----------
    columns : tuple of int
        One column, or seconds and nanoseconds, or date and time of day.
    form : str
        ``s``, ``ms``, ``us``, ``ns``, ``date`` (ISO 8601), ``day`` (time of day), ``pair`` or ``date+day``.
    """

    columns: tuple[int, ...]
    form: str


@dataclass(frozen=True, slots=True)
class ClockPlan:
    """The clocks of a table by kind, and what to tell about the choice.

    Attributes
    ----------
    clocks : dict of str to ClockColumn
        By kind; none where no column is a clock.
    notes : tuple of str
        What to tell.
    backwards : tuple of int, or None
        Where there is no clock: the column that is called one but runs backwards, and the row at which it does.
    """

    clocks: dict[str, ClockColumn] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    backwards: tuple[int, int] | None = None

    def columns(self) -> set[int]:
        """Return the columns that are clocks, not channels."""
        return {column for clock in self.clocks.values() for column in clock.columns}


def find_clocks(names: Sequence[str], units: Sequence[str | None], sample: Sequence[pa.Array]) -> ClockPlan:
    """Find the clocks of a table by its headers, checked against its first rows.

    Parameters
    ----------
    names, units : sequence of str
        Of all columns; units None where the header states none.
    sample : sequence of pyarrow arrays
        The columns' first rows.
    """
    pair = _second_and_fraction(names, sample)
    notes: list[str] = []
    ranked = sorted((rank, i) for i, name in enumerate(names) if (rank := _rank(name)) is not None and i < len(sample))
    clocks: list[tuple[int, ClockColumn]] = []
    for rank, i in ranked:
        form, note = _form(names[i], units[i], sample[i])
        if form is not None:
            clocks.append((rank, _with_date(ClockColumn((i,), form), names, sample)))
            notes.append(note)
    if not clocks and pair:
        return ClockPlan({"column": pair})
    if not clocks:
        falls = ((i, row) for _, i in ranked if (row := _backwards(sample[i])) is not None)
        return ClockPlan(backwards=next(falls, None))
    log = next((c for _, c in clocks if names[c.columns[0]] == "%time"), None)
    if log is not None and clocks[0][0] == 0:  # an export of rostopic: the header's stamp, and when it was received
        return ClockPlan({"header": clocks[0][1], "log": log})
    if pair and clocks[0][0] > 0:
        return ClockPlan({"column": pair})
    return ClockPlan({"column": clocks[0][1]}, tuple(note for note in notes[:1] if note))


def epoch_unit(size: float) -> str | None:
    """Return the unit (s, ms, us, ns) in which a number is a time since the epoch, None where it is none by its size."""
    for power, unit in enumerate(_DIGITS):
        low, high = (bound * 1000**power for bound in _EPOCH)
        if low <= size <= high:
            return unit
    return None


def looks_like_clock(values: NDArray[np.float64]) -> bool:
    """Tell whether values rise in even steps that are no whole numbers, as times do."""
    if len(values) < 8 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    return bool(steps.min() > 0 and steps.max() < 5 * np.median(steps) and (values % 1 != 0).any())


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
    if form == "pair":
        seconds, good = _scaled(columns[0], 9)
        fraction, also = _scaled(columns[1], 0)
        good &= also & (np.abs(seconds // 2 + fraction // 2) < 2**61)  # their sum fits into 64 bits, and is a time
        return np.where(good, seconds, 0) + np.where(good, fraction, 0), good
    if form == "date+day":
        joined = pc.binary_join_element_wise(trimmed(columns[0]), trimmed(columns[1]), " ")
        return dates(joined)
    if form == "date":
        return dates(columns[0])
    if form == "day":
        return dates(pc.binary_join_element_wise("1970-01-01", trimmed(columns[0]), " "))
    return _scaled(columns[0], _DIGITS[form])


def _rank(name: str) -> int | None:
    """Return how much a name looks like that of a clock: 0 is best, None is not at all."""
    lowered = name.strip().lower().replace(" ", "_")
    return next((rank for rank, pattern in enumerate(_NAME) if pattern.match(lowered)), None)


def _stated_unit(name: str, unit: str | None) -> str | None:
    if unit is not None:
        return unit.strip().lower()
    lowered = name.strip().lower().replace(" ", "_")
    match = next((match for pattern in _NAME if (match := pattern.match(lowered))), None)
    return match["unit"] if match else None


def _form(name: str, unit: str | None, sample: pa.Array) -> tuple[str | None, str]:
    """Return how a column tells the time and a note, or None where it does not."""
    kind = sample.type
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        return "date", ""
    if pa.types.is_time(kind) or pa.types.is_duration(kind):
        return "ns", ""
    if (pa.types.is_string(kind) or pa.types.is_large_string(kind)) and not _numeric(sample):
        for form in ("date", "day"):
            _, good = nanoseconds([sample], form)
            if good.any() and good.mean() > 0.9:
                return form, ""
        return None, ""
    values = _floats(sample)
    values = values[np.isfinite(values)]
    if not len(values) or not _rising(values):
        return None, ""
    stated = _stated_unit(name, unit)
    if stated is not None:
        return _UNIT_NAMES.get(stated), ""
    return _guessed_unit(name, values)


def _rising(values: NDArray[np.float64]) -> bool:
    """Tell whether values grow like a clock's: nearly always, and on the whole. All zero is a clock that was not set."""
    if len(values) < 2 or not values.any():
        return True
    steps = np.diff(values)
    grows = values[-1] > values[0] or values[0] > _EPOCH[0]  # nanoseconds of today are too large to differ as floats
    return bool(np.count_nonzero(steps >= 0) >= 0.9 * len(steps) and grows)


def _backwards(sample: pa.Array) -> int | None:
    """Return the first row that is less than the one before."""
    values = _floats(sample)
    rows = np.flatnonzero(np.isfinite(values))
    falls = np.flatnonzero(np.diff(values[rows]) < 0)
    return int(rows[falls[0] + 1]) if falls.size else None


def _guessed_unit(name: str, values: NDArray[np.float64]) -> tuple[str, str]:
    """Guess the unit of a clock: dates by their size, other times by their steps."""
    unit = epoch_unit(float(np.abs(values).max()))
    if unit is not None:
        return unit, ""
    steps = np.diff(values)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    limits = ((0.5, "s"), (500.0, "ms"), (5e5, "us"))
    unit = next((unit for limit, unit in limits if step <= limit), "ns")
    if unit == "s":
        return unit, ""
    note = (
        f"column '{name}' states no unit and is read as {_WORDS[unit]} because its steps are about {step:g};"
        f" call it '{name} [s]' if they are seconds"
    )
    return unit, note


def _second_and_fraction(names: Sequence[str], sample: Sequence[pa.Array]) -> ClockColumn | None:
    """Return the columns of a stamp that is split into seconds and nanoseconds."""
    lowered = {name.strip().lower(): i for i, name in enumerate(names)}
    for name, i in lowered.items():
        match = _SECONDS.match(name)
        if match is None or not (match["stem"] == "" or match["stem"].endswith(("stamp", "time"))):
            continue
        lead = name[: match.start(2)]
        for ending in _FRACTION:
            other = lowered.get(lead + ending)
            if other is not None and all(_numeric(sample[c]) for c in (i, other)):
                return ClockColumn((i, other), "pair")
    return None


def _with_date(clock: ClockColumn, names: Sequence[str], sample: Sequence[pa.Array]) -> ClockColumn:
    """Join a time of day with the date in another column, where there is one."""
    if clock.form != "day":
        return clock
    for i, name in enumerate(names):
        if name.strip().lower() in _DATE_NAMES:
            both = ClockColumn((i, clock.columns[0]), "date+day")
            _, good = nanoseconds([sample[c] for c in both.columns], both.form)
            if good.any():
                return both
    return clock


def _numeric(sample: pa.Array) -> bool:
    values = _floats(sample)
    return bool(len(values)) and np.count_nonzero(np.isfinite(values)) > 0.5 * (len(sample) - sample.null_count)


def _floats(array: pa.Array) -> NDArray[np.float64]:
    if pa.types.is_string(array.type) or pa.types.is_large_string(array.type):
        array = _cast_or_null(array, pa.float64())
    try:
        return np.asarray(pc.cast(array, pa.float64(), safe=False).to_numpy(zero_copy_only=False), np.float64)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        return np.full(len(array), np.nan)


def _cast_or_null(array: pa.Array, kind: Any) -> pa.Array:
    """Cast texts; those that cannot be become null."""
    array = trimmed(array)
    try:
        return pc.cast(array, kind)
    except pa.ArrowInvalid:
        cells = []
        for text in array.to_pylist():
            try:
                cells.append(pc.cast(pa.scalar(text, pa.string()), kind).as_py() if text else None)
            except pa.ArrowInvalid:
                cells.append(None)
        return pa.array(cells, kind)


def _scaled(array: pa.Array, digits: int) -> tuple[Stamps, NDArray[np.bool_]]:
    """Return numbers times ten to the power of `digits` as integers, exactly where they are written in decimals."""
    kind = array.type
    if pa.types.is_time(kind) or pa.types.is_duration(kind):
        return in_nanoseconds(array)
    if pa.types.is_integer(kind):
        return scaled(*integers(array), 10**digits)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        exact = _exact(trimmed(array), digits)
        if exact is not None:
            return exact
    # Nonsense becomes infinite, and no stamp; a NaN may be of the kind that signals.
    with np.errstate(over="ignore", invalid="ignore"):
        values = _floats(array) * 10.0**digits
    good = np.isfinite(values) & (np.abs(values) < 2.0**63)
    return np.rint(np.where(good, values, 0.0)).astype(np.int64), good


def _exact(text: pa.Array, digits: int) -> tuple[Stamps, NDArray[np.bool_]] | None:
    """Scale decimal numbers without floating point; None where some are written in another way."""
    try:
        number = pc.cast(text, pa.decimal128(38, 18))
        number = pc.cast(pc.round(number, digits), pa.decimal128(38, digits), safe=False)
    except pa.ArrowInvalid:
        return None
    good = np.asarray(pc.is_valid(number).to_numpy(zero_copy_only=False), bool)
    buffer = number.buffers()[1]
    if buffer is None:
        return np.zeros(len(number), np.int64), good
    halves = np.frombuffer(buffer, np.int64)[2 * number.offset : 2 * (number.offset + len(number))].reshape(-1, 2)
    fits = (halves[:, 1] == np.where(halves[:, 0] < 0, -1, 0)) | ~good
    if not fits.all():
        return None
    return np.where(good, halves[:, 0], 0), good
