"""Fractions of seconds that are whole milli-, micro- or nanoseconds without leading zeros: ``12.7`` for 12.007 s.

Programs write them so that put seconds and milliseconds into a text one by one. As decimals, they would scramble the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import MOST_EXCEPTIONS
from vsalog.readers.time_dates import trimmed

Read = Callable[[Sequence[pa.Array]], tuple[Stamps, NDArray[np.bool_]]]
"""Reads a clock's columns."""

_PARTS = r"^(?P<whole>.*\d[.,])(?P<fraction>\d{1,9})(?P<rest>(?:\s*[AaPp]\.?[Mm]\.?)?(?:\s*(?:[zZ]|UTC|GMT|[+-]\d\d:?\d\d))?)$"
_UNITS = {3: "milliseconds", 6: "microseconds", 9: "nanoseconds"}


class Fractions:
    """Reads a clock's columns block by block, with leading zeros where they were left out."""

    def __init__(self) -> None:
        self._digits = 0
        self._begun = False

    def read(self, columns: Sequence[pa.Array], read: Read) -> tuple[Stamps, NDArray[np.bool_]]:
        """Return a block's stamps [ns], shape (n,), and which rows have one."""
        *others, last = columns
        if not pa.types.is_string(last.type):
            return read(columns)
        if self._digits:
            return read([*others, _padded(last, self._digits)])
        stamps, good = read(columns)
        if self._begun and not (np.diff(stamps[good]) < 0).any():  # to look at texts takes long
            return stamps, good
        self._begun = True
        digits, sure = _whole_numbers(last)
        if digits:
            padded, also = read([*others, _padded(last, digits)])
            falls, fewer = (int(np.count_nonzero(np.diff(one) < 0)) for one in (stamps[good], padded[also]))
            if (sure and fewer <= falls) or fewer < MOST_EXCEPTIONS * falls:
                self._digits = digits
                return padded, also
        return stamps, good

    def findings(self) -> list[Finding]:
        """Return what to tell."""
        if not self._digits:
            return []
        unit = _UNITS[self._digits]
        evidence = {"read_as": unit, "example": f"12.{'7':0>{self._digits}}"}
        return [Finding(code="clock.fractions_unpadded", evidence=evidence)]


def _whole_numbers(cells: pa.Array) -> tuple[int, bool]:
    """Return of how many digits fractions are if they are whole numbers, 0 where they are not, and whether nothing else can be.

    Whole numbers vary in length, and have zeros at their ends but none ahead; decimals have zeros ahead.
    """
    fractions = pc.struct_field(pc.extract_regex(trimmed(cells), _PARTS), "fraction").drop_null()
    lengths = np.asarray(pc.utf8_length(fractions).to_numpy(zero_copy_only=False))
    if lengths.size < REPEATS or lengths.min() == lengths.max() or lengths.max() not in _UNITS:
        return 0, False
    if pc.any(pc.match_substring_regex(fractions, r"^0\d")).as_py():
        return 0, False
    return int(lengths.max()), bool(pc.any(pc.match_substring_regex(fractions, r"\d0$")).as_py())


def _padded(cells: pa.Array, digits: int) -> pa.Array:
    """Return times whose fractions have leading zeros."""
    found = pc.extract_regex(trimmed(cells), _PARTS)
    whole, fraction, rest = (pc.struct_field(found, name) for name in ("whole", "fraction", "rest"))
    return pc.coalesce(pc.binary_join_element_wise(whole, pc.utf8_lpad(fraction, digits, "0"), rest, ""), cells)
