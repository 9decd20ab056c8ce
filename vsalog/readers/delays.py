"""How far header stamps are from the log's times, told from samples of a log.

A part of a log is asked for by header stamps, and its index knows log times. Where the two are close in samples from all over
the log, only what lies around that part is read. What is read is held against what the samples promised, so that a stamp
farther off makes the whole log be read; only where a message is neither among the samples nor read, nobody sees its stamp.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.header_stamps import DELAY_VARIATION, LARGEST_LEAP
from vsalog.readers.reach import Nanoseconds, Stamp


@dataclass(slots=True)
class Delays:
    """Log time less header stamp [ns], from least to most, 0 included.

    By stream, `seen` counts the samples, `rows` their messages, `span` are their first and last stamp, and `level` is the median
    of the last sample [ns]; of streams in `stepping` it changed at once, so that only the whole log tells which clock to believe.
    """

    least: int = 0
    most: int = 0
    seen: Counter[str] = field(default_factory=Counter)
    rows: Counter[str] = field(default_factory=Counter)
    span: dict[str, tuple[int, int]] = field(default_factory=dict)
    level: dict[str, int] = field(default_factory=dict)
    stepping: set[str] = field(default_factory=set)

    def add(self, stream: str, stamps: Stamps, log: Stamps) -> bool:
        """Take note of a sample, shape (n,) [ns] each; tells whether its stamps can be times at all."""
        if not stamps.size:
            return True
        delay = log - stamps
        if delay.max() > Nanoseconds.DAY or delay.min() < -Nanoseconds.DAY:
            return False
        self.least, self.most = min(self.least, int(delay.min())), max(self.most, int(delay.max()))
        before, self.level[stream] = self.level.get(stream), int(np.median(delay))
        # A clock may have been set between them.
        if before is not None and abs(self.level[stream] - before) > DELAY_VARIATION:
            self.stepping.add(stream)
        self.seen[stream] += 1
        self.rows[stream] += stamps.size
        first, last = self.span.get(stream, (int(stamps[0]), int(stamps[0])))
        self.span[stream] = min(first, int(stamps.min())), max(last, int(stamps.max()))
        return True

    def standing(self) -> set[str]:
        """Return the streams that have always the same stamp."""
        return {stream for stream, (first, last) in self.span.items() if first == last and self.rows[stream] > 2}

    def rare(self, streams: Iterable[str]) -> set[str]:
        """Return those of some streams that are in too few samples to know them by."""
        return {stream for stream in streams if self.seen[stream] < REPEATS}

    def widened(self, low: int, high: int) -> tuple[int, int]:
        """Return between which log times [ns] all messages lie whose stamps are in a window."""
        return max(low + self.least - LARGEST_LEAP, -Stamp.FARTHEST), min(
            high + self.most + LARGEST_LEAP, Stamp.FARTHEST
        )


class Promise:
    """Holds what is read against the samples.

    Parameters
    ----------
    delays : Delays
        Of the samples.
    rare : collection of str
        Streams that are read throughout.
    """

    def __init__(self, delays: Delays, rare: Collection[str]) -> None:
        self._delays, self._rare = delays, rare
        self._read = Delays()

    def keep(self, stream: str, stamps: Stamps, log: Stamps) -> None:
        """Take note of stamps that were read.

        Raises
        ------
        ReadError
            They are farther from the log's times than they may be.
        """
        if stream in self._rare:
            return
        limits, read = self._delays, self._read
        sound = read.add(stream, stamps, log)
        if not sound or read.least < limits.least - LARGEST_LEAP or read.most > limits.most + LARGEST_LEAP:
            raise ReadError(f"{stream}: its header stamps are far from the log's times")

    def end(self) -> None:
        """Take note that all was read.

        Raises
        ------
        ReadError
            A stream has always the same stamp here, unlike elsewhere, so that it is not clear which time to believe.
        """
        for stream in self._read.standing():
            raise ReadError(f"{stream}: its header stamps are all the same in this part of the log")
