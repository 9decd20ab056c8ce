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

    Stamps up to the FARTHEST before and after 1970 have a difference of 64 bits. NEVER is an invalid header's stamp,
    as with more nanoseconds than a second has: so far away it is rejected. Stamps before YEAR_2000 are not dates.
    """

    FARTHEST = np.iinfo(np.int64).max // 2
    NEVER = -FARTHEST
    YEAR_2000 = 10_957 * Nanoseconds.DAY


BEYOND = "are before the year 1823 or after 2116, as no recording's can be"

# A recorder's own clock counts from 1970: earlier times exceeded 64 bits.
_LEAST = {"log": 0}
# Where these are absurd, there may be another valid clock.
_SECOND = ("header", "publish")


def within_reach(block: Block) -> tuple[Block, int]:
    """Leave out samples with impossible recording times; return how many.

    An absurd header stamp is clipped to the possible range: so far from the log's time it is rejected.

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
