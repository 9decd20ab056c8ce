"""The clock of a MATLAB structure, and its unit."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps, Values
from vsalog.readers.limits import MOST_EXCEPTIONS
from vsalog.readers.tables.time_columns import nanoseconds
from vsalog.readers.tables.time_units import guessed_unit

_STATED = re.compile(r"_(s|ms|us|ns)$", re.IGNORECASE)


def find_clock(vectors: Mapping[str, Values]) -> tuple[str | None, Finding | None]:
    """Return the vector that is the time, by its name and because it increases, and why another one with such a name is not.

    A vector with "time" only as a part of its name has to increase strictly. Values that are no numbers are ignored.
    """
    trouble = None
    for test in (_is_time_name, _tells_of_time):
        for name, values in vectors.items():
            if test(name.rpartition(".")[2]):
                wrong = _trouble(name, values, strictly=test is not _is_time_name)
                if wrong is None:
                    return name, None
                if test is _is_time_name:
                    trouble = trouble or wrong
    return None, trouble


def stamps_of(name: str, values: Values, whole: Stamps | None = None) -> tuple[Stamps, list[Finding]]:
    """Return a clock's stamps [ns], and findings about its unit; all values are numbers.

    Parameters
    ----------
    name : str
        Its name.
    values : float64 array, shape (n,)
        Its values.
    whole : int64 array, shape (n,), or None
        The same as whole numbers, where they are stored as such: floating point rounds those of 64 bits.
    """
    unit, doubts = _unit(name, values)
    stamps, _ = nanoseconds([pa.array(values if whole is None else whole)], unit)
    return stamps, doubts


def is_called_time(name: str) -> bool:
    """Return whether a vector may be a clock by its path."""
    return _tells_of_time(name) or _is_time_name(name.rpartition(".")[2])


def _unit(name: str, values: Values) -> tuple[str, list[Finding]]:
    """Return the unit of a clock, or how it counts days, and findings about it."""
    stated = _STATED.search(name)
    return (stated[1].lower(), []) if stated else guessed_unit(name, values, "{}_{}")


def _trouble(name: str, values: Values, strictly: bool) -> Finding | None:
    """Return why values are no clock, None where they may be one."""
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < min(2, values.size):
        return Finding(code="clock.no_times", part=name)
    steps = np.diff(values[rows])
    falls = np.flatnonzero(steps <= 0 if strictly or np.mean(steps > 0) < (1 - MOST_EXCEPTIONS) else steps < 0)
    if falls.size:
        return Finding(code="clock.not_rising", part=name, value=int(rows[falls[0] + 1]) + 1)
    _, fits = nanoseconds([pa.array(values[rows])], _unit(name, values[rows])[0])
    return None if fits.all() else Finding(code="clock.no_times", part=name)


def _is_time_name(name: str) -> bool:
    return _STATED.sub("", name.lower()) in ("time", "t", "timestamp", "tout")


def _tells_of_time(name: str) -> bool:
    return "time" in name.lower()
