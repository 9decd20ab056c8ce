"""Values that go back and forth from sample to sample: those of two publishers that nothing in the log tells apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vsalog.readers.spool import Column
from vsalog.recording import Values

STRETCHES, LENGTH = 8, 512
"""So many stretches of a channel are looked at, and how many samples each has."""

LEAST = 64  # samples of a stretch that tell anything
_FEW = 8  # different values that a switch may have, which goes back and forth by itself
_TIMES = 5  # so many times smaller is a step over two samples than one over one
_PART = 0.2  # of the range is a step at least: an encoder's last digit goes back and forth by itself, too


def alternating_note(stream: str, columns: Mapping[str, Column]) -> str:
    """Say that most channels of a stream that vary go back and forth; "" where they do not."""
    varying = [found for column in columns.values() if (found := _goes_back_and_forth(column)) is not None]
    if not varying or 2 * sum(varying) <= len(varying):
        return ""
    return (
        f"{stream}: its values go back and forth from sample to sample, as when two publishers of different values share a topic;"
        " if so, no values of it are those of either"
    )


def _goes_back_and_forth(column: Column) -> bool | None:
    """Tell whether a channel does so in most of its stretches, None where it hardly varies."""
    begins = np.unique(np.linspace(0, max(0, len(column) - LENGTH), STRETCHES).astype(np.int64)).tolist()
    found = [_alternates(column[begin : begin + LENGTH]) for begin in begins]
    known = [one for one in found if one is not None]
    return 2 * sum(known) > len(known) if known else None


def _alternates(values: Values) -> bool | None:
    values = values[np.isfinite(values)]
    if values.size < LEAST or np.unique(values).size <= _FEW:
        return None
    one, two = (float(np.median(np.abs(values[k:] - values[:-k]))) for k in (1, 2))
    return _TIMES * two < one and one > _PART * float(np.ptp(values))
