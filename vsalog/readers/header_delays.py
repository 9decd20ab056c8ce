"""The differences of header stamps from the log's times, estimated from samples of a log.

A part of a log is requested by header stamps, but its index has log times. Where the two are close in samples from all over
the log, only the surroundings of that part are read. They are compared with the samples, and a stamp farther from the log's
time makes the whole log be read; only the stamp of a message that is neither in the samples nor read is not checked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.header_stamps import DELAY_VARIATION, LARGEST_LEAP
from vsalog.readers.reach import Nanoseconds, Stamp

_Range = tuple[int, int]


class Delays:
    """Log time less header stamp [ns], from `least` to `most`, 0 included, over samples: messages that follow one another."""

    def __init__(self) -> None:
        self.least, self.most = 0, 0
        self._samples: Counter[str] = Counter()
        self._rows: Counter[str] = Counter()
        # By stream, its stamps, and the medians of its samples: a clock may have been set between them.
        self._stamps: dict[str, _Range] = {}
        self._levels: dict[str, _Range] = {}

    def add(self, stream: str, stamps: Stamps, log: Stamps) -> None:
        """Record a sample, shape (n,) [ns] each."""
        if not stamps.size:
            return
        delay = log - stamps
        self.least, self.most = min(self.least, int(delay.min())), max(self.most, int(delay.max()))
        self._samples[stream] += 1
        self._rows[stream] += stamps.size
        level = int(np.median(delay))
        for ranges, low, high in (self._stamps, stamps.min(), stamps.max()), (self._levels, level, level):
            before = ranges.get(stream, (low, high))
            ranges[stream] = min(before[0], int(low)), max(before[1], int(high))

    def standing(self) -> set[str]:
        """Return the streams whose stamp is always the same."""
        return {stream for stream, (low, high) in self._stamps.items() if low == high and self._rows[stream] > 2}

    def locate_messages(self) -> bool:
        """Return whether header stamps and log times are close enough in all samples to find messages by the log's index.

        Otherwise the whole log has to be read to choose a clock.
        """
        near = max(-self.least, self.most) <= Nanoseconds.DAY
        return near and not self.standing() and all(b - a <= DELAY_VARIATION for a, b in self._levels.values())

    def rare(self, streams: Iterable[str]) -> set[str]:
        """Return those of some streams that are in too few samples."""
        return {stream for stream in streams if self._samples[stream] < REPEATS}

    def widened(self, low: int, high: int) -> tuple[int, int]:
        """Return the range of log times [ns] of all messages whose stamps are in a window."""
        return max(low + self.least - LARGEST_LEAP, -Stamp.FARTHEST), min(
            high + self.most + LARGEST_LEAP, Stamp.FARTHEST
        )

    def promised(self, read: Delays) -> bool:
        """Return whether the stamps that were read are no farther from the log's times than those of the samples."""
        return self.least - LARGEST_LEAP <= read.least and read.most <= self.most + LARGEST_LEAP
