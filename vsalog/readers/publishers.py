"""Publishers of one topic that give the same values at the same time, as of two arms, or of one that was started twice.

Mixed, their values would be those of nothing. Publishers of different values, or one after the other, are one stream. Where a log
tells no publishers apart, the frames in the headers of their messages may.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.core.recording import Stamps
from vsalog.readers.container import Connection
from vsalog.readers.decoders import decoder_of
from vsalog.readers.definitions import DefinitionError
from vsalog.readers.frames import Frames
from vsalog.readers.header_stamps import MOST_BAD_STAMPS
from vsalog.readers.limits import BLOCK_ROWS, FIRST_ROWS, MOST_EXCEPTIONS
from vsalog.readers.messages import Decoder
from vsalog.readers.packets import Integers, Messages, Packet

LEAST_RUNS = 3
"""Runs of messages that are by turns of two publishers; one that is set up again changes its frame fewer times. A frame that is
`MOST_BAD_STAMPS` of another may be its slip: then it stands where one of the other would have been, two intervals
apart if these are regular."""
_UNNAMED = "unnamed"  # what publishers without a name are called


@dataclass(slots=True)
class _Publisher:
    """From when to when a publisher gives values [ns], their paths, in how many messages, and in how many runs of these.

    `usual` are intervals of its messages [ns], `across` those with messages of others in between.
    """

    first: int
    last: int
    paths: set[str]
    count: int = 0
    runs: int = 0
    usual: list[int] = field(default_factory=list)
    across: list[int] = field(default_factory=list)

    def add(self, log: Stamps) -> None:
        """Take note of log times [ns] of messages."""
        self.first, self.last = min(self.first, int(log.min())), max(self.last, int(log.max()))
        self.count += log.size

    def go_on(self, log: Stamps) -> None:
        """Take note of log times [ns] of messages that have none of others in between."""
        self.add(log)
        if len(self.usual) < BLOCK_ROWS:
            self.usual += np.diff(log[: BLOCK_ROWS - len(self.usual) + 1]).tolist()

    def clashes(self, other: _Publisher) -> bool:
        """Tell whether both give the same values for a good part of the time; the end of one may overlap the other's begin."""
        both = min(self.last, other.last) - max(self.first, other.first)
        shorter = min(self.last - self.first, other.last - other.first)
        return both > 0 and 2 * both >= shorter and bool(self.paths & other.paths)

    def note_intervals(self, log: Stamps, rows: Integers) -> None:
        """Take note of how far log times [ns] are apart that are in some rows of a packet, shape (n,)."""
        alone = int(rows[-1] - rows[0]) + 1 == rows.size
        if len(self.usual) == BLOCK_ROWS and (alone or len(self.across) == BLOCK_ROWS):
            return
        steps, lone = np.diff(log), np.diff(rows) == 1
        for known, found in (self.usual, steps[lone]), (self.across, steps[~lone]):
            known += found[: BLOCK_ROWS - len(known)].tolist()

    def gives_way(self) -> bool | None:
        """Tell whether messages of others stand where its own would have been; None where that is not clear."""
        if not self.usual or not self.across:
            return None
        usual, late = np.quantile(self.usual, (0.5, 1.0 - MOST_EXCEPTIONS))
        if not usual:
            return None
        across = np.median(self.across)
        # By whole intervals: regular messages are one apart, and two with another one in between.
        return bool(round(across / usual) > 1) if round(late / usual) == 1 else None

    def alternates(self, other: _Publisher) -> bool:
        """Tell whether messages of both come by turns, and neither is a slip of the other or what it became."""
        rarer, more = sorted((self, other), key=lambda one: one.count)
        if rarer.runs >= LEAST_RUNS:
            return rarer.count > MOST_BAD_STAMPS * more.count or not more.gives_way()
        # All of one and then all of the other, though at the same time: they were put together later.
        return more.runs == 1 or more.gives_way() is False


def clashing(streams: Mapping[str, Collection[Connection]], packets: Iterable[Packet]) -> dict[str, list[str]]:
    """Return those publishers of each stream that give the same values as another one of it at the same time.

    Parameters
    ----------
    streams : mapping of str to collection of Connection
        The connections of each.
    packets : iterable of Packet
        Messages of these from all over the log.
    """
    known = {one.id: (stream, one) for stream, connections in streams.items() for one in connections}
    seen: dict[str, dict[str, _Publisher]] = {stream: {} for stream in streams}
    told: set[int] = set()
    for packet in packets:
        for number in np.unique(packet.connection).tolist():
            stream, connection = known[number]
            rows = np.flatnonzero(packet.connection == number)
            log = packet.log[rows]
            one = seen[stream].setdefault(connection.publisher, _Publisher(int(log[0]), int(log[0]), set()))
            one.add(log)
            if number not in told:
                one.paths |= _paths(connection, packet.messages.some(rows[:FIRST_ROWS]))
                told.add(number)
    return {stream: mixed for stream, publishers in seen.items() if (mixed := _clashing(publishers))}


class FrameWatch:
    """Looks for frames in one stream's messages that give the same values at the same time."""

    def __init__(self) -> None:
        self._frames = Frames()
        self._decoders: dict[int, Decoder] = {}
        self._seen: dict[int, _Publisher] = {}
        self._last = -1

    def add(self, connection: Connection, messages: Messages, log: Stamps) -> None:
        """Take note of a connection's messages, which may name frames, and their log times [ns], shape (n,)."""
        if connection.id not in self._decoders:
            self._decoders[connection.id] = decoder_of(connection, "", None)
        numbers = self._frames.numbers(self._decoders[connection.id].frames(messages))
        if not numbers.size:
            return
        if len(self._seen) == 1 and self._last in self._seen and (numbers == self._last).all():
            self._seen[self._last].go_on(log)  # as nearly always
            return
        begins = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
        here = np.unique(numbers).tolist() if begins.size else [int(numbers[0])]
        if numbers[0] != self._last:
            begins = np.concatenate(([0], begins))
        self._last = int(numbers[-1])
        rows = {number: np.flatnonzero(numbers == number) for number in here if number >= 0}
        for number, own in rows.items():
            one = self._seen.setdefault(number, _Publisher(int(log[own[0]]), int(log[own[0]]), set()))
            one.add(log[own])
            one.note_intervals(log[own], own)
            one.runs += int(np.count_nonzero(numbers[begins] == number))
        for number, own in rows.items() if len(self._seen) > 1 else ():
            if not self._seen[number].paths:
                self._seen[number].paths = _paths(connection, messages.some(own[:FIRST_ROWS]))

    def mixed(self) -> list[str]:
        """Return the frames that have to be streams of their own."""
        names = self._frames.names
        return _clashing({names[k]: one for k, one in self._seen.items()}, _Publisher.alternates)


def publisher_stream(stream: str, publisher: str) -> str:
    """Return the name of the stream that is one publisher's."""
    return f"{stream}@{printable(publisher) or _UNNAMED}"


def told_apart(stream: str, publishers: Collection[str], what: str) -> Finding:
    """Return that publishers of a stream, or frames, were told apart."""
    names = [publisher_stream(stream, publisher) for publisher in publishers]
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    evidence = {"what": what, "streams": shown}
    return Finding(code="recording.publishers_apart", part=stream, value=len(names), evidence=evidence)


def mixed_up(stream: str, frames: list[str]) -> Finding:
    """Return that frames of a stream were found too late to tell them apart."""
    shown = ", ".join(map(repr, map(printable, frames[:5])))
    return Finding(code="recording.frames_mixed", part=stream, value=len(frames), evidence={"frames": shown})


def _clashing(
    publishers: Mapping[str, _Publisher], also: Callable[[_Publisher, _Publisher], bool] = lambda one, other: True
) -> list[str]:
    """Return which of some publishers clash with another one, where that is also so."""
    found: set[str] = set()
    for pair in combinations(publishers, 2):
        one, other = (publishers[name] for name in pair)
        if one.clashes(other) and also(one, other):
            found |= {*pair}
    return [name for name in publishers if name in found]


def _paths(connection: Connection, messages: Messages) -> set[str]:
    """Return the paths of the values in messages, but for those of the header, which all have."""
    try:
        columns = decoder_of(connection, "", None).decode(messages).columns
    except DefinitionError:
        return set()
    return {path for path, values in columns.items() if not path.startswith(".header.") and np.isfinite(values).any()}
