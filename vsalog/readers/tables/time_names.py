"""What columns are called that tell the time, and the units their names state."""

from __future__ import annotations

import re
from enum import IntEnum

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
    """How surely a name is a clock's, best first; SHORT ones may be others, as T is, and DATED columns lack the time of day."""

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
"""As flight controllers call it."""
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
