"""The clock of a stream."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from msgspec import structs

from vsalog.core.column import is_mapped
from vsalog.core.finding import Finding
from vsalog.core.look import joined, stretches
from vsalog.core.recording import Stamps
from vsalog.core.resolution import STRETCHES
from vsalog.readers.base import CLOCKS
from vsalog.readers.header_stamps import HeaderStamps, stand_still
from vsalog.readers.limits import BLOCK_ROWS
from vsalog.readers.table_stamps import stamps_that_are_none

STANDING = Finding(code="clock.log_stands")
"""The finding for a stream on another clock than the log's, which does not advance."""

_NONE = np.empty(0, np.int64)


@dataclass(frozen=True, slots=True)
class Clock:
    """The clock whose stamps a stream is put on.

    Attributes
    ----------
    source : str
        One of `vsalog.readers.base.CLOCKS`.
    reason : Finding or None
        Why not the first choice, or the doubts about it where it was requested.
    off : int64 array
        Samples with an invalid stamp, which are left out, by their places in the log, in order.
    """

    source: str
    reason: Finding | None
    off: Stamps

    def reason_for(self, stream: str) -> Finding | None:
        """Return why a stream is on this clock, as a finding, where it is not the first choice."""
        if self.reason is None:
            return None
        return structs.replace(self.reason, part=stream, evidence={**self.reason.evidence, "used": self.source})


def choose_clock(clocks: Mapping[str, Stamps], time: str) -> Clock:
    """Choose the clock of a stream, for all of its samples except a few with an invalid stamp.

    Parameters
    ----------
    clocks : mapping of str to int64 array, shape (n,)
        The stamps [ns] the log has, by kind.
    time : str
        ``auto`` for the header's stamps unless they are implausible, or the requested kind: ``header``, ``log``,
        ``publish``.
    """
    running = _running(clocks, time)
    doubt, off = None, _NONE
    if time in ("auto", "header") and {"header", "log"} <= running.keys():
        stamps = HeaderStamps.of(running["header"], running["log"])
        doubt, off = stamps.doubt(), stamps.rows_off
    elif "column" in running:
        off = stamps_that_are_none(running["column"])
    source = next(kind for kind in CLOCKS if kind in running)
    reason = doubt if source == "header" else None
    if time in running:
        source = time
    elif time == "auto":
        source = "log" if reason else source
    elif source in ("header", "log", "publish"):
        source = "log" if "log" in running else source
        reason = Finding(code="clock.not_recorded", evidence={"asked": time})
    if len(running) < len(clocks):
        reason = STANDING
    if source not in ("header", "column"):
        off = _NONE
    return Clock(source, reason, off)


def _running(clocks: Mapping[str, Stamps], time: str) -> dict[str, Stamps]:
    """Return the clocks of a stream; where the log's does not advance and is not requested, those that do, if any."""
    if time not in ("auto", "header") or "log" not in clocks or not stand_still(clocks["log"]):
        return dict(clocks)
    return {kind: stamps for kind, stamps in clocks.items() if not stand_still(stamps)} or dict(clocks)


def delay_of(clocks: Mapping[str, Stamps], source: str) -> tuple[float, float]:
    """Return log time minus header stamp [s], median and 5-95 % range; NaN where the stream is not on header stamps."""
    if source != "header" or "log" not in clocks or not len(clocks["log"]):
        return float("nan"), float("nan")
    header, log = clocks["header"], clocks["log"]
    if is_mapped(log):
        some = stretches(len(log), STRETCHES * BLOCK_ROWS)
        header, log = joined(header, some), joined(log, some)
    delay = (log - header) * 1e-9
    low, median, high = np.percentile(delay, (5, 50, 95))
    return float(median), float(high - low)
