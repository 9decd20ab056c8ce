"""Header clocks that are set back, or far ahead, while the log's time goes on, as NTP or a restarted controller does it.

Samples that merely come late are not meant: after those, stamps lie as far from the log's times as before them. After a step they
lie elsewhere, for good. Where stamps leap less far ahead, samples may have waited before, and others of them been lost: then the
log's times come in bursts, or the delay is again what it was. Where both go on as evenly as before, it was the clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vsalog.core.column import PART
from vsalog.core.recording import Stamps
from vsalog.core.resolution import LONGEST_OUTLIER
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import MOST_EXCEPTIONS, MOST_PARTS, TIMES_LARGER

LARGEST_LEAP = 60_000_000_000
"""A clock that leaps farther ahead of the log's time [ns] was set; less may be messages that were lost on the way."""

DELAY_VARIATION = 1_000_000_000
"""So much [ns] do the delays of samples vary by themselves."""

DELAY_SAMPLES = round(REPEATS / MOST_EXCEPTIONS)
"""Samples that tell how far stamps are from the log's times: on either side as many are exceptions as show a pattern."""


@dataclass(slots=True)
class ClockSteps:
    """The largest steps of a header clock [ns], found block by block: how far back, how far ahead, 0 for none."""

    back: int = 0
    ahead: int = 0
    _lowest: int = 2**63 - 1
    _headers: list[Stamps] = field(default_factory=list)
    _logs: list[Stamps] = field(default_factory=list)
    _waiting: int = 0

    def add(self, header: Stamps, log: Stamps) -> None:
        """Take a block of header stamps and log times [ns], shape (n,), into account."""
        self._headers.append(header)
        self._logs.append(log)
        self._waiting += header.size
        if self._waiting <= PART:
            return
        header, log = np.concatenate(self._headers), np.concatenate(self._logs)
        new = PART - TIMES_LARGER * DELAY_SAMPLES  # the others are seen again with the next piece, for steps at its end
        while header.size > PART:
            self._look(header[:PART], log[:PART], 2 * DELAY_SAMPLES)
            self._lowest = self._lowest_before(log[:PART] - header[:PART], new)
            header, log = header[new:], log[new:]
        self._headers, self._logs, self._waiting = [header], [log], header.size

    def end(self) -> None:
        """Look at what is left."""
        if self._headers:
            self._look(np.concatenate(self._headers), np.concatenate(self._logs), 0)

    def _look(self, header: Stamps, log: Stamps, waiting: int) -> None:
        """Look for steps; those in as many samples at the end as are `waiting` are left for later."""
        if header.size <= LONGEST_OUTLIER + 1:
            return
        steps = np.diff(header)
        if steps.min() < 0:
            self._look_back(header, log, header.size - waiting)
        leads = steps - np.diff(log)
        places = np.flatnonzero((steps > DELAY_VARIATION) & (leads > DELAY_VARIATION))
        for k in places[np.argsort(-leads[places], kind="stable")[:MOST_PARTS]].tolist():
            size = _moved(log - header, k, slice(k + 1, k + 1 + DELAY_SAMPLES))
            if header.size - k <= max(waiting, LONGEST_OUTLIER + 1) or -size <= leads[k] // 2:
                continue
            if leads[k] > LARGEST_LEAP or (_goes_on_evenly(header, log, k) and self._is_new(log - header, k)):
                self.ahead = max(self.ahead, -size)

    def _is_new(self, delay: Stamps, last: int) -> bool:
        """Tell whether samples behind the `last` have less delay than any before, not what it was before they had to wait."""
        before, after = delay[max(0, last + 1 - DELAY_SAMPLES) : last + 1], delay[last + 1 : last + 1 + DELAY_SAMPLES]
        return bool(2 * self._lowest_before(delay, last + 1) > np.median(before) + np.median(after))

    def _lowest_before(self, delay: Stamps, end: int) -> int:
        """Return the least delay [ns] that samples had for a while, up to one."""
        whole = (
            delay[: end // DELAY_SAMPLES * DELAY_SAMPLES].reshape(-1, DELAY_SAMPLES)
            if end >= DELAY_SAMPLES
            else delay[None, :end]
        )
        return min(self._lowest, int(np.median(whole, axis=1).min()))

    def _look_back(self, header: Stamps, log: Stamps, until: int) -> None:
        """Look for steps back, which begin before sample number `until`."""
        latest = np.maximum.accumulate(header)
        edges = np.diff((header < latest).astype(np.int8), prepend=0, append=0)
        # Where samples that are earlier than some before them begin, and where that is over.
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        depths = latest[begins] - header[begins]
        # A clock that was set back needs as long to catch up; late samples come all at once.
        lasts = np.minimum(ends, header.size - 1)
        long = (ends - begins > LONGEST_OUTLIER) & (begins < until)
        long &= (log[lasts] - log[begins - 1] > depths // 2) | (ends == header.size)
        places = np.flatnonzero(long)
        for k in places[np.argsort(-depths[places], kind="stable")[:MOST_PARTS]].tolist():
            begin, end = int(begins[k]), int(ends[k])
            after = slice(max(begin, end - DELAY_SAMPLES) if end == header.size else end, end + DELAY_SAMPLES)
            size = _moved(log - header, begin - 1, after)
            if size > depths[k] // 2:
                self.back = max(self.back, size)


def _moved(delay: Stamps, last: int, after: slice) -> int:
    """Return how much more delay [ns] samples have than those up to the `last` before them, 0 where that may be jitter."""
    low, level, high = _spread(delay[max(0, last + 1 - DELAY_SAMPLES) : last + 1])
    new_low, new_level, new_high = _spread(delay[after])
    return int(new_level - level) if new_low > high or new_high < low else 0


def _spread(delay: Stamps) -> tuple[float, float, float]:
    """Return between what delays vary, and their median."""
    low, level, high = np.quantile(delay, (MOST_EXCEPTIONS, 0.5, 1 - MOST_EXCEPTIONS)).tolist()
    return low, level, high


def _goes_on_evenly(header: Stamps, log: Stamps, last: int) -> bool:
    """Tell whether stamps and log times follow one another as before behind the `last` sample ahead of a step."""
    before, after = slice(max(0, last + 1 - DELAY_SAMPLES), last + 1), slice(last + 1, last + 1 + DELAY_SAMPLES)
    if min(last, header[after].size - 1) <= LONGEST_OUTLIER:
        return False
    usual = [float(np.median(np.diff(stamps[part]))) for stamps in (header, log) for part in (before, after)]
    leap = header[last + 1] - header[last]
    most = max(TIMES_LARGER * max(usual), leap // TIMES_LARGER)
    return 0 < max(usual) <= 2 * min(usual) and log[last + 1] - log[last] <= most
