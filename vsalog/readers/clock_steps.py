"""Header clocks that are set back, or far ahead, while the log's time goes on, as NTP or a restarted controller does it.

Samples that merely come late are not meant: after those, stamps lie as far from the log's times as before them. After a step they
lie elsewhere, for good.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vsalog.recording import Stamps

AHEAD = 60_000_000_000
"""A clock that leaps farther ahead of the log's time [ns] was set; less may be messages that were lost on the way."""

_LEAST = 4  # samples that a step moves among others; fewer are jitter
_LEVEL = 64  # samples that tell how far stamps are from the log's times
_SPREAD = (10, 50, 90)  # percentiles of that: steps are beyond what it varies
_PIECE = 2**16  # samples that are looked at together, however they come
_KEPT = 4 * _LEVEL  # samples of a piece that are seen again with the next one, for steps at its end
_JUDGED = 64  # places in a piece that are looked at, the largest steps first

_NONE = np.empty(0, np.int64)


@dataclass(slots=True)
class ClockSteps:
    """The largest steps of a header clock [ns], found block by block: how far back, how far ahead, 0 for none."""

    back: int = 0
    ahead: int = 0
    _header: Stamps = field(default_factory=_NONE.copy)
    _log: Stamps = field(default_factory=_NONE.copy)

    def add(self, header: Stamps, log: Stamps) -> None:
        """Take a block of header stamps and log times [ns], shape (n,), into account."""
        header, log = np.concatenate((self._header, header)), np.concatenate((self._log, log))
        while header.size > _PIECE:
            self._look(header[:_PIECE], log[:_PIECE], 2 * _LEVEL)
            header, log = header[_PIECE - _KEPT :], log[_PIECE - _KEPT :]
        self._header, self._log = header, log

    def end(self) -> None:
        """Look at what is left."""
        self._look(self._header, self._log, 0)

    def _look(self, header: Stamps, log: Stamps, waiting: int) -> None:
        """Look for steps; those in as many samples at the end as are `waiting` are left for later."""
        if header.size <= _LEAST:
            return
        steps = np.diff(header)
        if steps.min() < 0:
            self._look_back(header, log, header.size - waiting)
        places = np.flatnonzero(steps > AHEAD)
        places = places[steps[places] - (log[places + 1] - log[places]) > AHEAD]
        for k in places[np.argsort(-steps[places], kind="stable")[:_JUDGED]].tolist():
            size = _moved(log - header, k, slice(k + 1, k + 1 + _LEVEL))
            if header.size - k > max(waiting, _LEAST) and -size > steps[k] // 2:
                self.ahead = max(self.ahead, -size)

    def _look_back(self, header: Stamps, log: Stamps, until: int) -> None:
        """Look for steps back, which begin before sample number `until`."""
        latest = np.maximum.accumulate(header)
        edges = np.diff((header < latest).astype(np.int8), prepend=0, append=0)
        # Where samples that are earlier than some before them begin, and where that is over.
        begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        depths = latest[begins] - header[begins]
        # A clock that was set back needs as long to catch up; late samples come all at once.
        lasts = np.minimum(ends, header.size - 1)
        long = (ends - begins >= _LEAST) & (begins < until)
        long &= (log[lasts] - log[begins - 1] > depths // 2) | (ends == header.size)
        places = np.flatnonzero(long)
        for k in places[np.argsort(-depths[places], kind="stable")[:_JUDGED]].tolist():
            begin, end = int(begins[k]), int(ends[k])
            after = slice(max(begin, end - _LEVEL) if end == header.size else end, end + _LEVEL)
            size = _moved(log - header, begin - 1, after)
            if size > depths[k] // 2:
                self.back = max(self.back, size)


def _moved(delay: Stamps, last: int, after: slice) -> int:
    """Return how much more delay [ns] samples have than those up to the `last` before them, 0 where that may be jitter."""
    low, level, high = np.percentile(delay[max(0, last + 1 - _LEVEL) : last + 1], _SPREAD)
    new_low, new_level, new_high = np.percentile(delay[after], _SPREAD)
    return int(new_level - level) if new_low > high or new_high < low else 0
