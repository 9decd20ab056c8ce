"""Which vector of a MATLAB structure is its clock, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from vsalog.readers.time_sizes import epoch_unit
from vsalog.recording import Stamps, Values

_NANOSECONDS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
_STATED = re.compile(r"_(s|ms|us|ns)$", re.IGNORECASE)
_LIMITS = ((0.5, "s"), (500.0, "ms"), (5e5, "us"))
"""Steps of a clock up to which it is in a unit, as of the columns of tables."""

_RISING = 0.9
"""Fraction of the steps that are above zero; the others may be zero, where samples share a stamp."""

# Days since the year 0, as MATLAB's datenum and now give them, from 1900 to 2100; 719529 is 1970. In seconds, steps as short as
# such days have would be of 10 kHz and more, a little over eight days after the clock began.
_DAYS, _EPOCH, _SHORT = (693_962, 767_011), 719_529, 1e-4


def find_clock(vectors: Mapping[str, Values]) -> tuple[str | None, str]:
    """Return the vector that is the time, called so and rising, and why another one that is called so is not.

    What only has "time" in its name has to rise strictly. Values that are no numbers are passed over.
    """
    trouble = ""
    for test in (_is_time_name, _tells_of_time):
        for name, values in vectors.items():
            if test(name.rpartition(".")[2]):
                wrong = _trouble(values, strictly=test is not _is_time_name)
                if not wrong:
                    return name, ""
                if test is _is_time_name and not trouble:
                    trouble = f"'{name}' is not taken for the time: {wrong}"
    return None, trouble


def stamps_of(name: str, values: Values) -> tuple[Stamps, str]:
    """Return a clock's stamps [ns], and what to tell of its unit; all values are numbers."""
    step = float(np.median(np.diff(values))) if values.size > 1 else 0.0
    if _DAYS[0] <= values[0] and values[-1] <= _DAYS[1] and step < _SHORT:
        days = np.floor(values)
        stamps = (days - _EPOCH).astype(np.int64) * 86_400_000_000_000 + np.rint((values - days) * 86_400e9).astype(
            np.int64
        )
        return stamps, f"'{name}' is read as days since the year 0, MATLAB's datenum, by its size and steps"
    stated = _STATED.search(name)
    unit = stated[1].lower() if stated else epoch_unit(float(np.abs(values).max()))
    note = ""
    if unit is None:
        unit = next((unit for limit, unit in _LIMITS if step <= limit), "ns")
        if unit != "s":
            note = (
                f"'{name}' states no unit and is read as {unit} because its steps are about {step:g};"
                f" call it '{name}_s' if they are seconds"
            )
    return np.rint(values * _NANOSECONDS[unit]).astype(np.int64), note


def _trouble(values: Values, strictly: bool) -> str:
    """Return why values are no clock, "" where they may be one."""
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < min(2, values.size):
        return "its values are no numbers"
    steps = np.diff(values[rows])
    falls = np.flatnonzero(steps <= 0 if strictly or np.mean(steps > 0) < _RISING else steps < 0)
    if falls.size:
        return f"value {rows[falls[0] + 1] + 1} of it is not above the one before"
    # In nanoseconds, too, it has to fit into 64 bits.
    most = float(np.abs(values[rows]).max())
    return "" if most < 9e18 / _NANOSECONDS[epoch_unit(most) or "s"] else "its values are no times"


def _is_time_name(name: str) -> bool:
    return _STATED.sub("", name.lower()) in ("time", "t", "timestamp", "tout")


def _tells_of_time(name: str) -> bool:
    return "time" in name.lower()
