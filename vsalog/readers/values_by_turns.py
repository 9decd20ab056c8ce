"""Values that alternate from sample to sample: those of two publishers that nothing in the log distinguishes.

Values two samples apart are close then, and neighbours are not.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.recording import Values
from vsalog.core.resolution import STRETCHES
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import SAMPLE_ROWS, TIMES_LARGER


def alternating(stream: str, columns: Mapping[str, Values]) -> list[Finding]:
    """Return that most channels of a stream that vary alternate; nothing where they do not."""
    looked_at = list(columns.values())[:: max(1, len(columns) // STRETCHES)]
    varying = [found for column in looked_at if (found := _goes_back_and_forth(column)) is not None]
    if not varying or 2 * sum(varying) <= len(varying):
        return []
    return [Finding(code="recording.values_alternate", part=stream)]


def _goes_back_and_forth(column: Values) -> bool | None:
    """Return whether a channel does so in most of its stretches, None where it hardly varies."""
    begins = np.unique(np.linspace(0, max(0, len(column) - SAMPLE_ROWS), STRETCHES).astype(np.int64)).tolist()
    found = [_alternates(column[begin : begin + SAMPLE_ROWS]) for begin in begins]
    known = [one for one in found if one is not None]
    return 2 * sum(known) > len(known) if known else None


def _alternates(values: Values) -> bool | None:
    values = values[np.isfinite(values)]
    if values.size < REPEATS**2 or np.unique(values).size <= REPEATS:
        return None
    values = values / np.abs(values).max()  # whose differences are finite
    if float(np.ptp(values)) == 0:
        return None
    one, two = (float(np.median(np.abs(values[k:] - values[:-k]))) for k in (1, 2))
    # An encoder's last digit alternates by itself, too, in a larger range.
    return TIMES_LARGER * two < one and TIMES_LARGER * one > float(np.ptp(values))
