"""The stream of each message of a log: its topic, with type, publisher and frame where one topic has several."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.printable import LONGEST_TEXT, printable
from vsalog.core.significance import REPEATS
from vsalog.readers.compressed_messages import plain
from vsalog.readers.container import MOST_CONNECTIONS, Connection, Container
from vsalog.readers.limits import DECODED_BYTES, PACKED_BYTES
from vsalog.readers.message_definitions import normal_type
from vsalog.readers.packets import Packet
from vsalog.readers.publishers import TopicWatch, publisher_stream, told_apart


@dataclass(frozen=True, slots=True)
class Named:
    """A connection, its stream, and the frames in its messages that are streams of their own."""

    connection: Connection
    stream: str
    frames: tuple[str, ...]


class Streams:
    """Separates the streams of a container's messages.

    Parameters
    ----------
    container : Container
        Opened.
    first_of : function
        Yields the first messages of some connections.
    unread : dict of str to str
        Collects topics that are no streams.
    """

    def __init__(
        self, container: Container, first_of: Callable[[Collection[int]], Iterator[Packet]], unread: dict[str, str]
    ) -> None:
        self._container, self._first_of, self._unread = container, first_of, unread
        self._watches: dict[str, TopicWatch] = {}

    def named(self, wanted: frozenset[str] | None) -> list[Named]:
        """Return each connection that may hold wanted channels with its stream.

        Raises
        ------
        ReadError
            There are more than any recording has.
        """
        by_topic = [
            (connection, stream)
            for connection, stream in self._by_topic()
            if wanted is None or any(name.startswith((f"{stream}.", f"{stream}@")) for name in wanted)
        ]
        _refuse_absurd(by_topic)
        self._watch(by_topic)
        apart = {topic: self._watches[topic].apart() for topic in dict.fromkeys(topic for _, topic in by_topic)}
        for topic, (publishers, frames) in apart.items():
            if publishers or frames:
                what = "publishers" if publishers else "frames"
                self._container.findings.add(told_apart(topic, publishers or frames, what))
        return [
            Named(one, publisher_stream(topic, one.publisher) if one.publisher in publishers else topic, tuple(frames))
            for one, topic in by_topic
            for publishers, frames in [apart[topic]]
        ]

    def _by_topic(self) -> list[tuple[Connection, str]]:
        """Return each connection with its topic, and the type where a topic has several."""
        connections = [one for one in self._container.connections() if self._is_named(one)]
        types: dict[str, set[str]] = {}
        for connection in connections:
            types.setdefault(connection.topic, set()).add(normal_type(connection.type))
        named = []
        for connection in connections:
            name = printable(connection.topic)
            if len(types[connection.topic]) > 1:
                name = f"{name} ({normal_type(printable(connection.type))})"
            named.append((connection, name))
        return named

    def _is_named(self, connection: Connection) -> bool:
        """Return whether names in a connection are no longer than those of any recording; record others."""
        if max(len(connection.topic), len(connection.type), len(connection.publisher)) <= LONGEST_TEXT:
            return True
        shown = printable(connection.topic[:LONGEST_TEXT])
        self._unread.setdefault(shown, f"its name, type or publisher has more than {LONGEST_TEXT} characters")
        return False

    def _watch(self, by_topic: list[tuple[Connection, str]]) -> None:
        """Examine messages of topics that were not examined before."""
        topics: dict[str, list[Connection]] = {}
        for connection, topic in by_topic:
            if topic not in self._watches:
                topics.setdefault(topic, []).append(connection)
        found = {topic: TopicWatch(own) for topic, own in topics.items()}
        self._watches |= found
        looked_at = {one.id: (topic, one) for topic, own in topics.items() for one in own if found[topic].looks_at(one)}
        if not looked_at:
            return
        several = [number for number, (topic, _) in looked_at.items() if found[topic].several]
        # All connections, as when they are read: their damage is reported once.
        for packet in map(plain, self._glance([one.id for own in topics.values() for one in own], several)):
            for number in np.unique(packet.connection).tolist():
                if number in looked_at:
                    topic, connection = looked_at[number]
                    rows = np.flatnonzero(packet.connection == number)
                    found[topic].add(connection, packet.messages.some(rows), packet.log[rows])

    def _glance(self, ids: Collection[int], several: Collection[int]) -> Iterator[Packet]:
        """Yield all messages of a short log; of a long one the first of some connections, and some from all over it, or its first
        where it has no index.
        """
        if self._container.size() < PACKED_BYTES:
            yield from self._container.packets(ids)
            return
        yield from self._first_of(several)
        glimpses = self._container.glimpses(ids)
        first = next(glimpses, None)
        yield from islice(self._container.packets(ids), REPEATS) if first is None else chain([first], glimpses)


def _refuse_absurd(named: list[tuple[Connection, str]]) -> None:
    several = {(stream, connection.encoding, connection.definition) for connection, stream in named}
    text = sum(map(len, {definition for _, _, definition in several}))
    if len(several) > MOST_CONNECTIONS or text > DECODED_BYTES:
        raise ReadError(
            f"the log has more than {MOST_CONNECTIONS} topics, or more than {DECODED_BYTES} characters of message definitions, as"
            " no recording has; only some channels of it can be read, by their names"
        )
