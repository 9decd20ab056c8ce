"""Values that go back and forth from sample to sample: those of publishers that nothing in the log tells apart.

Where two publish by turns, values two samples apart are close and neighbours are not; where three do, or one does twice as often
as the other, it is values three samples apart, and so on. So are those of a vibration or a pulse that repeats in so many samples.
But its shape remains, while what publishers of different values are apart changes, gradually.
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
    """Return that most channels of a stream that vary go back and forth; nothing where they do not."""
    looked_at = list(columns.values())[:: max(1, len(columns) // STRETCHES)]
    varying = [found for column in looked_at if (found := _goes_back_and_forth(column)) is not None]
    if not varying or 2 * sum(varying) <= len(varying):
        return []
    return [Finding(code="recording.values_alternate", part=stream)]


def _goes_back_and_forth(column: Values) -> bool | None:
    """Tell whether a channel does so in most of its stretches, None where it hardly varies."""
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
    if _by_two(values):
        return True
    found = [_by_more(values, turns) for turns in range(3, REPEATS + 1)]
    return True if True in found else None if None in found else False


def _by_two(values: Values) -> bool:
    one, two = (float(np.median(np.abs(values[k:] - values[:-k]))) for k in (1, 2))
    # An encoder's last digit goes back and forth by itself, too, in a larger range.
    return TIMES_LARGER * two < one and TIMES_LARGER * one > float(np.ptp(values))


def _by_more(values: Values, turns: int) -> bool | None:
    """Tell whether values are alike after so many turns and not before, and are apart now more and now less.

    None where they are less and less apart: a vibration that fades would be, too.
    """
    one, all_turns = (np.abs(values[k:] - values[:-k]) for k in (1, turns))
    step, far = float(one.mean()), TIMES_LARGER
    if far * float(all_turns.mean()) >= step or far**2 * step <= float(np.ptp(values)) or all_turns.max() > step:
        return False
    rounds = values[: values.size // turns * turns].reshape(-1, turns)
    apart = [float(part.mean()) for part in np.array_split(rounds.var(axis=1), REPEATS)]
    if 2 * (max(apart) - min(apart)) <= float(np.mean(apart)):
        return False
    return True if any(np.diff(apart) > 0) else None
