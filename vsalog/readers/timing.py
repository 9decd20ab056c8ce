"""Which clock a stream is on, in what order its samples are, and which of them are copies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.readers.base import CLOCKS, plural
from vsalog.recording import Stamps

YEAR_2000 = 946_684_800_000_000_000
"""Nanoseconds since the epoch; stamps before it are not dates."""

ONE_DAY = 86_400_000_000_000


@dataclass(frozen=True, slots=True)
class Clock:
    """The time stamps a stream is put on.

    Attributes
    ----------
    source : str
        One of `vsalog.readers.base.CLOCKS`.
    stamps : int64 array, shape (n,)
        Nanoseconds, in the order of the log.
    reason : str
        Why not the first choice, "" where it is.
    delay_median, delay_spread : float
        Log time minus header stamp [s]: median and 5–95 % range; NaN where there is one clock only.
    """

    source: str
    stamps: Stamps
    reason: str
    delay_median: float
    delay_spread: float


@dataclass(frozen=True, slots=True)
class Order:
    """How to bring samples into strictly increasing order.

    Attributes
    ----------
    keep : int64 array, shape (m,), or None
        Indices of the samples to keep, in order; None means all as they are.
    inversions, duplicates, conflicts : int
        Samples earlier than the one before, exact copies, and samples with the stamp of another but other values.
    """

    keep: NDArray[np.intp] | None
    inversions: int
    duplicates: int
    conflicts: int


def choose_clock(clocks: Mapping[str, Stamps], time: str) -> Clock:
    """Choose the clock of a stream, for all of its samples.

    Parameters
    ----------
    clocks : mapping of str to int64 array, shape (n,)
        The stamps [ns] the log has, by kind.
    time : str
        ``auto`` for the header's stamps unless they make no sense, or the kind that is asked for: ``header``, ``log``,
        ``publish``.
    """
    available = [kind for kind in CLOCKS if kind in clocks]
    source, reason = available[0], ""
    if time == "auto":
        if source == "header" and "log" in clocks:
            reason = implausible(clocks["header"], clocks["log"])
            source = "log" if reason else "header"
    elif time in clocks:
        source = time
    elif source in ("header", "log", "publish"):
        source = "log" if "log" in clocks else source
        reason = f"it has no {time} time"
    median, spread = _delay(clocks, source)
    return Clock(source, clocks[source], reason, median, spread)


def implausible(header: Stamps, log: Stamps) -> str:
    """Return in words why header stamps cannot be the time of their samples, "" where they can.

    Parameters
    ----------
    header, log : int64 array, shape (n,)
        Header stamps and log times [ns].
    """
    if not len(header):
        return ""
    far = np.abs(header - log) > ONE_DAY
    if not far.any():
        if len(header) > 2 and np.ptp(header) == 0 and np.ptp(log) > 0:
            return "its header stamps are all the same"
        return ""
    zero = int(np.count_nonzero(header == 0))
    if zero == len(header):
        return "its header stamps are all zero"
    if zero:
        return f"{zero} of its {plural(len(header), 'header stamp')} are zero"
    worst = int(np.flatnonzero(far)[0])
    if header[worst] < YEAR_2000 <= log[worst]:
        return "its header stamps lie before the year 2000, unlike the log's times (a simulation's clock?)"
    return "its header stamps and the log's times are more than a day apart"


def _delay(clocks: Mapping[str, Stamps], source: str) -> tuple[float, float]:
    if source != "header" or "log" not in clocks or not len(clocks["log"]):
        return float("nan"), float("nan")
    delay = (clocks["log"] - clocks["header"]) * 1e-9
    low, median, high = np.percentile(delay, (5, 50, 95))
    return float(median), float(high - low)


def put_in_order(stamps: Stamps, columns: list[NDArray[np.float64]]) -> Order:
    """Tell how to make stamps strictly increasing.

    Of samples with equal stamps the first in the log is kept. The others are copies where all their values are the same,
    and conflicts otherwise.

    Parameters
    ----------
    stamps : int64 array, shape (n,)
        Nanoseconds.
    columns : list of float64 array, shape (n,)
        The stream's values.
    """
    steps = np.diff(stamps)
    if not len(steps) or steps.min() > 0:
        return Order(None, 0, 0, 0)
    inversions = int(np.count_nonzero(steps < 0))
    if not columns:  # nothing to keep or to compare
        return Order(None, inversions, 0, 0)
    order = np.argsort(stamps, kind="stable") if inversions else np.arange(len(stamps))
    ordered = stamps[order]
    first = np.concatenate([[True], np.diff(ordered) > 0])
    leader = order[np.flatnonzero(first)[np.cumsum(first) - 1]]  # the kept sample with the same stamp
    repeats = np.flatnonzero(~first)
    same = np.ones(len(repeats), dtype=bool)
    for values in columns:
        mine, kept = values[order[repeats]], values[leader[repeats]]
        same &= (mine == kept) | (np.isnan(mine) & np.isnan(kept))
    duplicates = int(np.count_nonzero(same))
    return Order(order[first], inversions, duplicates, len(repeats) - duplicates)
