"""Publishers of one topic that give the same values at the same time, as of two arms, or of one that was started twice.

Mixed, their values would be those of nothing. Publishers of different values, or one after the other, are one stream. Where a log
tells no publishers apart, the frames in the headers of their messages may.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.core.recording import Stamps
from vsalog.readers.container import Connection
from vsalog.readers.decoders import decoder_of
from vsalog.readers.definitions import DefinitionError
from vsalog.readers.frames import Frames
from vsalog.readers.limits import FIRST_ROWS
from vsalog.readers.messages import Decoder
from vsalog.readers.packets import Messages, Packet

LEAST_RUNS = 3
"""Runs of messages that frames by turns have; one publisher that is set up again changes its frame fewer times."""
_UNNAMED = "unnamed"  # what publishers without a name are called


@dataclass(slots=True)
class _Publisher:
    """From when to when a publisher gives values [ns], their paths, and in how many runs of messages."""

    first: int
    last: int
    paths: set[str]
    runs: int = 0

    def clashes(self, other: _Publisher) -> bool:
        """Tell whether both give the same values for a good part of the time; the end of one may overlap the other's begin."""
        both = min(self.last, other.last) - max(self.first, other.first)
        shorter = min(self.last - self.first, other.last - other.first)
        return both > 0 and 2 * both >= shorter and bool(self.paths & other.paths)

    def alternates(self, other: _Publisher) -> bool:
        """Tell whether messages of both come by turns, or all of one behind all of the other, as when put together later."""
        return min(self.runs, other.runs) >= LEAST_RUNS or max(self.runs, other.runs) == 1


class Publishers:
    """Looks for publishers of one stream that give the same values at the same time."""

    def __init__(self) -> None:
        self._seen: dict[str, _Publisher] = {}
        self._decoders: dict[int, Decoder] = {}

    def add(self, name: str, connection: Connection, messages: Messages, log: Stamps, runs: int = 1) -> None:
        """Take note of messages of a publisher, at least one, and their log times [ns], shape (n,)."""
        one = self._seen.get(name)
        if one is None:
            one = self._seen[name] = _Publisher(int(log[0]), int(log[0]), self._paths(connection, messages))
        one.first, one.last = min(one.first, int(log.min())), max(one.last, int(log.max()))
        one.runs += runs

    def mixed(self, by_turns: bool = False) -> list[str]:
        """Return those that have to be streams of their own; `by_turns` only those whose messages come by turns."""
        found: set[str] = set()
        for pair in combinations(self._seen, 2):
            one, other = (self._seen[name] for name in pair)
            if one.clashes(other) and (not by_turns or one.alternates(other)):
                found |= {*pair}
        return [name for name in self._seen if name in found]

    def decoder(self, connection: Connection) -> Decoder:
        """Return what decodes messages of a connection; errors as for `decoder_of`."""
        if connection.id not in self._decoders:
            self._decoders[connection.id] = decoder_of(connection, "", None)
        return self._decoders[connection.id]

    def _paths(self, connection: Connection, messages: Messages) -> set[str]:
        """Return the paths of the values in messages, but for those of the header, which all have."""
        try:
            columns = self.decoder(connection).decode(messages.some(np.arange(len(messages))[:FIRST_ROWS])).columns
        except DefinitionError:
            return set()
        return {path for path, found in columns.items() if not path.startswith(".header.") and np.isfinite(found).any()}


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
    seen = {stream: Publishers() for stream in streams}
    for packet in packets:
        for number in np.unique(packet.connection).tolist():
            stream, connection = known[number]
            rows = np.flatnonzero(packet.connection == number)
            seen[stream].add(connection.publisher, connection, packet.messages.some(rows), packet.log[rows])
    return {stream: mixed for stream, publishers in seen.items() if (mixed := publishers.mixed())}


class FrameWatch:
    """Looks for frames in one stream's messages that give the same values at the same time."""

    def __init__(self) -> None:
        self._frames, self._publishers = Frames(), Publishers()
        self._last = -1

    def add(self, connection: Connection, messages: Messages, log: Stamps) -> None:
        """Take note of a connection's messages, which may name frames, and their log times [ns], shape (n,)."""
        numbers = self._frames.numbers(self._publishers.decoder(connection).frames(messages))
        if not numbers.size:
            return
        begins = numbers != np.concatenate(([self._last], numbers[:-1]))
        self._last = int(numbers[-1])
        names = self._frames.names
        for number in np.unique(numbers[numbers >= 0]).tolist():
            own = np.flatnonzero(numbers == number)
            runs = int(np.count_nonzero(begins[own]))
            self._publishers.add(names[number], connection, messages.some(own), log[own], runs)

    def mixed(self) -> list[str]:
        """Return the frames that have to be streams of their own."""
        return self._publishers.mixed(by_turns=True)


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
