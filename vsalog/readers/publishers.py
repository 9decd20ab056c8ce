"""Publishers of one topic that give the same values at the same time, as of two arms, or of one that was started twice.

Mixed, their values would have no meaning. Publishers of different values, or one after the other, are one stream. Where a log
does not distinguish publishers, the frames in the headers of their messages may.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.core.recording import Stamps
from vsalog.readers.container import Connection
from vsalog.readers.header_frames import Frames
from vsalog.readers.limits import FIRST_ROWS
from vsalog.readers.message_decoders import decoder_of
from vsalog.readers.message_definitions import DefinitionError
from vsalog.readers.messages import Decoder
from vsalog.readers.packets import Integers, Messages

LEAST_RUNS = 3
"""Runs of messages of alternating frames; one publisher that is configured again changes its frame fewer times."""
_UNNAMED = "unnamed"  # the name of publishers without one


@dataclass(slots=True)
class _Publisher:
    """From when to when a publisher gives values [ns], their paths, and in how many runs of messages."""

    first: int
    last: int
    paths: set[str]
    runs: int = 0

    def clashes(self, other: _Publisher) -> bool:
        """Return whether both give the same values for most of the time; the end of one may overlap the other's beginning."""
        both = min(self.last, other.last) - max(self.first, other.first)
        shorter = min(self.last - self.first, other.last - other.first)
        return both > 0 and 2 * both >= shorter and bool(self.paths & other.paths)

    def alternates(self, other: _Publisher) -> bool:
        """Return whether messages of both alternate, or all of one come after all of the other, as when merged later."""
        return min(self.runs, other.runs) >= LEAST_RUNS or max(self.runs, other.runs) == 1


class _Publishers:
    """Publishers of a topic, or frames that represent them; `decoder` returns the decoder of a connection's messages."""

    def __init__(self, decoder: Callable[[Connection], Decoder]) -> None:
        self._decoder = decoder
        self._seen: dict[str, _Publisher] = {}
        self._last = -1

    def add(self, numbers: Integers, names: list[str], connection: Connection, messages: Messages, log: Stamps) -> None:
        """Record messages with log times [ns], shape (n,); `numbers` tell whose they are by `names`, -1 where none does."""
        begins = numbers != np.concatenate(([self._last], numbers[:-1]))
        self._last = int(numbers[-1])
        there = np.unique(numbers).tolist() if begins[1:].any() else [int(numbers[0])]
        for number in there:
            if number < 0:
                continue
            own = np.flatnonzero(numbers == number)
            first, last = int(log[own].min()), int(log[own].max())
            one = self._seen.get(names[number])
            if one is None:
                paths = self._paths(connection, messages.some(own[:FIRST_ROWS]))
                one = self._seen[names[number]] = _Publisher(first, last, paths)
            one.first, one.last = min(one.first, first), max(one.last, last)
            one.runs += int(np.count_nonzero(begins[own]))

    def mixed(self, by_turns: bool = False) -> list[str]:
        """Return those that give the same values at the same time; `by_turns` only those whose messages come by turns."""
        found: set[str] = set()
        for pair in combinations(self._seen, 2):
            one, other = (self._seen[name] for name in pair)
            if one.clashes(other) and (not by_turns or one.alternates(other)):
                found |= {*pair}
        return [name for name in self._seen if name in found]

    def _paths(self, connection: Connection, messages: Messages) -> set[str]:
        """Return the paths of the values in messages, but for those of the header, which all have."""
        try:
            columns = self._decoder(connection).decode(messages).columns
        except DefinitionError:
            return set()
        return {path for path, found in columns.items() if not path.startswith(".header.") and np.isfinite(found).any()}


class TopicWatch:
    """Finds publishers in the messages of one topic, or frames that represent them, that have to be separate streams.

    Parameters
    ----------
    connections : collection of Connection
        Of the topic.
    """

    def __init__(self, connections: Collection[Connection]) -> None:
        self.several = len({one.publisher for one in connections}) > 1
        self._decoders: dict[int, Decoder] = {}
        self._publishers = _Publishers(self._decoder)
        self._names = Frames()
        self._frames = _Publishers(self._decoder)
        self._framed = {one.id for one in connections if self._is_framed(one)}

    def looks_at(self, connection: Connection) -> bool:
        """Return whether messages of a connection are informative."""
        return self.several or connection.id in self._framed

    def add(self, connection: Connection, messages: Messages, log: Stamps) -> None:
        """Record a connection's messages, at least one, and their log times [ns], shape (n,)."""
        if self.several:
            self._publishers.add(np.zeros(log.size, np.int64), [connection.publisher], connection, messages, log)
        if connection.id in self._framed:
            numbers = self._names.numbers(self._decoder(connection).frames(messages))
            self._frames.add(numbers, self._names.names, connection, messages, log)

    def apart(self) -> tuple[list[str], list[str]]:
        """Return the publishers that are streams of their own; or else the frames that are."""
        publishers = self._publishers.mixed()
        return publishers, [] if publishers else self._frames.mixed(by_turns=True)

    def _decoder(self, connection: Connection) -> Decoder:
        if connection.id not in self._decoders:
            self._decoders[connection.id] = decoder_of(connection, "", None)
        return self._decoders[connection.id]

    def _is_framed(self, connection: Connection) -> bool:
        try:
            return self._decoder(connection).framed
        except DefinitionError:
            return False


def publisher_stream(stream: str, publisher: str) -> str:
    """Return the name of the stream that is one publisher's."""
    return f"{stream}@{printable(publisher) or _UNNAMED}"


def told_apart(stream: str, publishers: Collection[str], what: str) -> Finding:
    """Return that publishers of a stream, or frames, were separated."""
    names = [publisher_stream(stream, publisher) for publisher in publishers]
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    evidence = {"what": what, "streams": shown}
    return Finding(code="recording.publishers_apart", part=stream, value=len(names), evidence=evidence)
