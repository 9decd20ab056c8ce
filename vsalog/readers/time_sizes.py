"""The unit of a clock that states none: dates are told by their size, other times by their steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
# Days that spreadsheets and MATLAB count: those between 2000 and 2050, and the number of 1970-01-01.
SERIAL = {"serial": (36_526, 54_789, 25_569), "datenum": (730_486, 748_749, 719_529)}
_SERIAL_WORDS = {
    "serial": "days since 1899-12-30, as spreadsheets count them",
    "datenum": "days since the year 0, as MATLAB counts them",
}
_SERIAL_STEP = 2e-5  # days; as seconds they would be samples of more than 50 kHz

# Epoch seconds between 2000 and 2100; in other units by powers of a thousand.
EPOCH = (946_684_800, 4_102_444_800)

_LABVIEW = 2_082_844_800
"""Seconds from 1904 to 1970."""


def epoch_unit(size: float) -> str | None:
    """Return the unit (s, ms, us, ns) in which a number is a time since the epoch, None where it is none by its size."""
    for power, unit in enumerate(_WORDS):
        low, high = (bound * 1000**power for bound in EPOCH)
        if low <= size <= high:
            return unit
    return None


def guessed_unit(name: str, values: NDArray[np.float64]) -> tuple[str, str]:
    """Guess the unit of a clock: dates by their size, other times by their steps."""
    unit = epoch_unit(float(np.abs(values).max()))
    if unit is not None:
        return unit, _on_labview(name, float(values.min())) if unit == "s" else ""
    steps = np.diff(values)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for form, (first, last, _) in SERIAL.items():
        if first <= values.min() and values.max() <= last and 0 < step < _SERIAL_STEP:
            return form, f"column '{name}' is read as {_SERIAL_WORDS[form]}; call it '{name} [s]' if it is in seconds"
    limits = ((0.5, "s"), (500.0, "ms"), (5e5, "us"))
    unit = next((unit for limit, unit in limits if step <= limit), "ns")
    if unit == "s":
        return unit, ""
    note = (
        f"column '{name}' states no unit and is read as {_WORDS[unit]} because its steps are about {step:g};"
        f" write the unit behind its name if it is another one, such as '{name} [s]' or '{name} [min]'"
    )
    return unit, note


def _on_labview(name: str, first: float) -> str:
    """Return what to tell of seconds that are of this century only if LabVIEW counted them."""
    if first < EPOCH[0] + _LABVIEW:
        return ""
    return (
        f"column '{name}' is read as seconds since 1970, and is far in the future then: LabVIEW counts from 1904, {_LABVIEW}"
        " seconds earlier; times within the log do not depend on it"
    )
