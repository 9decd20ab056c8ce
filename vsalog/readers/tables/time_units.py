"""The unit of a clock: stated by its name or header, or else guessed from the size and the steps of its numbers."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding

UNITS = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "ms": "ms", "msec": "ms", "msecs": "ms", "millis": "ms", "millisecond": "ms", "milliseconds": "ms",
    "us": "us", "µs": "us", "μs": "us", "usec": "us", "micros": "us", "microsecond": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nanosec": "ns", "nanosecond": "ns", "nanoseconds": "ns",
    "min": "min", "mins": "min", "minute": "min", "minutes": "min", "minuten": "min",
    "h": "h", "hr": "h", "hrs": "h", "hour": "h", "hours": "h", "std": "h", "stunden": "h",
    "d": "d", "day": "d", "days": "d", "tage": "d",
}  # fmt: skip


class Rank(IntEnum):
    """The confidence that a name is a clock's, best first; SHORT ones may be others, as T, and DATED ones lack a time of day."""

    HEADER, STAMP, TIME, SHORT, DATED = range(5)


# By rank. What follows the stem may be a unit: time_ms, time [min].
STEMS = (
    r"(field\.)?header[._/]stamp",
    r"__time|%time|stamp|time_?stamp|unix_?time|ros_?time|gps_?time|epoch",
    r"time|date_?time|(elapsed|relative|rel)_time|time_elapsed|elapsed|(uhr)?zeit|zeitstempel|temps|tiempo|tempo",
    r"t|secs?|seconds|minutes|hours|millis|micros",
    r"date|datum|fecha|data",
)
_GLUED = re.compile(r"^time(?P<unit>us|ms|ns)$")
"""The name in logs of flight controllers."""
_ANY_UNIT = "|".join(UNITS)
_NAME = [re.compile(rf"^(?:{stem})(?:_(?P<unit>{_ANY_UNIT})|_?[\[(](?P<bracket>[^\])]*)[\])])?$") for stem in STEMS]


def plain(name: str) -> str:
    """Return a name in lower case, without blanks, a unit of time set apart."""
    return _GLUED.sub(r"time_\g<unit>", name.strip().lower().replace(" ", "_"))


def rank_of(name: str) -> int | None:
    """Return how much a name looks like that of a clock: 0 is best, None is not at all."""
    return next((rank for rank, pattern in enumerate(_NAME) if pattern.match(plain(name))), None)


def stated_unit(name: str, unit: str | None) -> str | None:
    """Return the unit that a column's header states, or its name; None where there is none."""
    if unit is not None:
        return unit.strip().lower()
    text = plain(name)
    match = next((match for pattern in _NAME if (match := pattern.match(text))), None)
    stated = (match["unit"] or match["bracket"]) if match else None
    return stated or (text if text in UNITS else None)


_WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
COUNTED = frozenset(_SECONDS)
"""Units in which a clock counts from some start."""
USUAL_STEP, LONGEST_STEP = 0.5, 10.0
"""Longest step of samples [s]: of nearly all logs, and of one whose clock is not named a date."""
QUICK_STEP = 0.15
"""Longest step [s] in a unit that suits short steps: 500 are rather microseconds at 2 kHz than milliseconds at 2 Hz."""
SHORTEST_STEP = 2e-5
"""Shortest step [s]: no log of a machine has more than 50 kHz."""
LONGEST_RUN = 10 * 86_400.0
"""Machines are seldom on for longer [s]."""
_SAYS_EPOCH = re.compile("epoch|unix")
# Days that spreadsheets and MATLAB count: those between 2000 and 2050, and the number of 1970-01-01.
SERIAL = {"serial": (36_526, 54_789, 25_569), "datenum": (730_486, 748_749, 719_529)}
SINCE = {
    "serial": "1899-12-30, as spreadsheets count",
    "datenum": "the year 0, as MATLAB counts",
}

# Epoch seconds between 2000 and 2100; in other units by powers of a thousand.
EPOCH = tuple(int(datetime(year, 1, 1, tzinfo=UTC).timestamp()) for year in (2000, 2100))

_LABVIEW = -int(datetime(1904, 1, 1, tzinfo=UTC).timestamp())
"""Seconds from 1904 to 1970."""


def epoch_unit(size: float) -> str | None:
    """Return the unit (s, ms, us, ns) in which a number is a time since the epoch, None where it is none by its size."""
    for power, unit in enumerate(_WORDS):
        low, high = (bound * 1000**power for bound in EPOCH)
        if low <= size <= high:
            return unit
    return None


def guessed_unit(name: str, values: NDArray[np.float64], written: str = "{} [{}]") -> tuple[str, list[Finding]]:
    """Guess the unit of a clock by its size and its steps, with findings about doubts.

    A number that is a date of this century in seconds is one of the first hour in microseconds, too: it is the former only if
    the samples of a log can be so far apart then.

    Parameters
    ----------
    name : str
        The clock's name.
    values : float64 array, shape (n,)
        Its first numbers, all finite.
    written : str
        How a clock's name states its unit, with braces for both.

    Returns
    -------
    unit : str
        As in `vsalog.readers.tables.time_columns.ClockColumn`.
    doubts : list of Finding
        Empty where there is no doubt.
    """
    steps = np.diff(np.sort(values))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    size = float(np.median(np.abs(values)))
    unit = epoch_unit(size)
    if unit is not None:
        apart = step * _SECONDS[unit]
        if apart <= USUAL_STEP or _SAYS_EPOCH.search(name.lower()):
            return unit, _on_labview(name, float(values.min())) if unit == "s" else []
        if apart <= LONGEST_STEP:
            return unit, _in_doubt(name, unit, apart, written)
    for form, (first, last, _) in SERIAL.items():
        if first <= values.min() and values.max() <= last and 0 < step < SHORTEST_STEP:
            evidence = {"since": SINCE[form], "otherwise": written.format(name, "s")}
            return form, [Finding(code="clock.counts_days", part=name, value=step, unit="d", evidence=evidence)]
    return _counted(name, step, size, written)


def _counted(name: str, step: float, size: float, written: str) -> tuple[str, list[Finding]]:
    """Guess the unit of a clock that counts from some start, in the coarsest whose steps a log may have."""
    limits = {unit: USUAL_STEP if unit == "s" else QUICK_STEP for unit in _SECONDS}
    likely = [unit for unit, second in _SECONDS.items() if step * second <= limits[unit]] or ["ns"]
    recent = [
        unit for unit in likely if size * _SECONDS[unit] <= LONGEST_RUN and step * _SECONDS[unit] >= SHORTEST_STEP
    ]
    unit = (recent or likely)[0]
    if unit == "s" and (step >= SHORTEST_STEP or not step):
        return unit, []
    evidence = {"read_as": _WORDS[unit], "otherwise": written.format(name, "ms" if unit == "s" else "s")}
    return unit, [Finding(code="clock.unit_by_steps", part=name, value=step, evidence=evidence)]


def _in_doubt(name: str, unit: str, apart: float, written: str) -> list[Finding]:
    """Return the finding for a date in steps that would suit a log better in the next smaller unit."""
    finer = dict(zip(_SECONDS, [*_SECONDS][1:], strict=False)).get(unit)
    if finer is None:
        return []
    evidence = {"read_as": _WORDS[unit], "otherwise": written.format(name, finer), "finer": _WORDS[finer]}
    return [Finding(code="clock.unit_by_size", part=name, value=apart, unit="s", evidence=evidence)]


def _on_labview(name: str, first: float) -> list[Finding]:
    """Return the finding for seconds that are of this century only if LabVIEW counted them."""
    if first < EPOCH[0] + _LABVIEW:
        return []
    return [Finding(code="clock.perhaps_since_1904", part=name, value=_LABVIEW, unit="s")]
