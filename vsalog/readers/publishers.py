"""Publishers of one topic that give the same values at the same time, as of two arms, or of one that was started twice.

Mixed, their values would be those of nothing. Publishers of different values, or one after the other, are one stream.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vsalog.printable import printable
from vsalog.readers.container import Connection
from vsalog.readers.decoders import decoder_of
from vsalog.readers.definitions import DefinitionError
from vsalog.readers.packets import Messages, Packet

_DECODED = 20  # messages of a packet that tell which values a connection gives


@dataclass(slots=True)
class _Publisher:
    """From when to when a publisher gives values [ns], and their paths."""

    first: int
    last: int
    paths: set[str]

    def clashes(self, other: _Publisher) -> bool:
        """Tell whether both give the same values for a good part of the time; the end of one may overlap the other's begin."""
        both = min(self.last, other.last) - max(self.first, other.first)
        shorter = min(self.last - self.first, other.last - other.first)
        return both > 0 and 2 * both >= shorter and bool(self.paths & other.paths)


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
            first, last = int(packet.log[rows].min()), int(packet.log[rows].max())
            one = seen[stream].setdefault(connection.publisher, _Publisher(first, last, set()))
            one.first, one.last = min(one.first, first), max(one.last, last)
            if number not in told:
                one.paths |= _paths(connection, packet.messages.some(rows[:_DECODED]))
                told.add(number)
    return {stream: mixed for stream, publishers in seen.items() if (mixed := _clashing(publishers))}


def publisher_stream(stream: str, publisher: str) -> str:
    """Return the name of the stream that is one publisher's."""
    return f"{stream}@{printable(publisher)}"


def mixed_note(stream: str, publishers: Collection[str]) -> str:
    """Say that publishers of a stream were told apart."""
    names = [publisher_stream(stream, publisher) for publisher in publishers]
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return (
        f"{stream}: {len(names)} publishers give the same values at the same time; each is a stream of its own: {shown}"
    )


def _clashing(publishers: Mapping[str, _Publisher]) -> list[str]:
    pairs = combinations(publishers, 2)
    found = {name for pair in pairs if publishers[pair[0]].clashes(publishers[pair[1]]) for name in pair}
    return [name for name in publishers if name in found]


def _paths(connection: Connection, messages: Messages) -> set[str]:
    """Return the paths of the values in messages, but for those of the header, which all have."""
    try:
        columns = decoder_of(connection, "", None).decode(messages).columns
    except DefinitionError:
        return set()
    return {path for path, values in columns.items() if not path.startswith(".header.") and np.isfinite(values).any()}
