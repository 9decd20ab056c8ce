"""Times that no recording can have: beyond them, differences of stamps would not fit into 64 bits."""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum

import numpy as np

from vsalog.core.recording import Stamps
from vsalog.readers.base import Block


class Nanoseconds(IntEnum):
    """Spans of time."""

    SECOND = 10**9
    MINUTE = 60 * SECOND
    HOUR = 60 * MINUTE
    DAY = 24 * HOUR


class Stamp(IntEnum):
    """Nanoseconds since 1970.

    Stamps up to the FARTHEST before and after 1970 have a difference of 64 bits. NEVER stands for a header's stamp that is none,
    as with more nanoseconds than a second has: so far off it is not believed. Stamps before YEAR_2000 are not dates.
    """

    FARTHEST = np.iinfo(np.int64).max // 2
    NEVER = -FARTHEST
    YEAR_2000 = 10_957 * Nanoseconds.DAY


BEYOND = "lie before the year 1823 or after 2116, as no recording's can"

# A recorder's own clock counts from 1970: what is ahead of that was beyond 64 bits.
_LEAST = {"log": 0}
# Where these are absurd, there may be another clock that is not.
_SECOND = ("header", "publish")


def within_reach(block: Block) -> tuple[Block, int]:
    """Leave out samples that a recorder cannot have recorded when it says so; returns how many.

    A header's stamp that is absurd is brought to the border of what can be: so far from the log's time it is not believed.

    Parameters
    ----------
    block : Block
        As a reader gives it.
    """
    if all(_near(stamps, kind) for kind, stamps in block.clocks.items()):
        return block, 0
    clocks = dict(block.clocks)
    if len(clocks) > 1:
        for kind in _SECOND:
            if kind in clocks:
                clocks[kind] = np.clip(clocks[kind], -Stamp.FARTHEST, Stamp.FARTHEST)
    good = np.all(
        [(s >= _LEAST.get(kind, -Stamp.FARTHEST)) & (s <= Stamp.FARTHEST) for kind, s in clocks.items()], axis=0
    )
    return (
        replace(
            block,
            clocks={kind: stamps[good] for kind, stamps in clocks.items()},
            columns={name: values[good] for name, values in block.columns.items()},
        ),
        int(good.size - np.count_nonzero(good)),
    )


def _near(stamps: Stamps, kind: str) -> bool:
    return not stamps.size or (
        int(stamps.min()) >= _LEAST.get(kind, -Stamp.FARTHEST) and int(stamps.max()) <= Stamp.FARTHEST
    )
