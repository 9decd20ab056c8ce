"""Which stream each message of a log belongs to: its topic, with type, publisher and frame where one topic has several."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.look import LOOK_BYTES
from vsalog.core.printable import LONGEST_TEXT, printable
from vsalog.core.significance import REPEATS
from vsalog.readers.compressed_messages import plain
from vsalog.readers.container import MOST_CONNECTIONS, Connection, Container
from vsalog.readers.decoders import decoder_of
from vsalog.readers.definitions import DefinitionError, normal_type
from vsalog.readers.limits import DECODED_BYTES, PACKED_BYTES
from vsalog.readers.packets import Packet
from vsalog.readers.publishers import FrameWatch, clashing, publisher_stream, told_apart


@dataclass(frozen=True, slots=True)
class Named:
    """A connection, its stream, and the frames in its messages that are streams of their own."""

    connection: Connection
    stream: str
    frames: tuple[str, ...]


class Streams:
    """Tells the streams of a container's messages apart.

    Parameters
    ----------
    container : Container
        Opened.
    first_of : function
        Yields the first messages of some connections.
    unread : dict of str to str
        To which topics are added that are none.
    """

    def __init__(
        self, container: Container, first_of: Callable[[Collection[int]], Iterator[Packet]], unread: dict[str, str]
    ) -> None:
        self._container, self._first_of, self._unread = container, first_of, unread
        self._mixed: dict[str, list[str]] = {}  # publishers of a stream that are streams of their own
        self._frames: dict[str, list[str]] = {}  # frames of a stream that are

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
        self._tell_publishers(by_topic)
        by_publisher = [
            (connection, publisher_stream(stream, connection.publisher) if apart else stream)
            for connection, stream in by_topic
            for apart in [connection.publisher in self._mixed[stream]]
        ]
        self._tell_frames(by_publisher)
        for what, mixed in ("publishers", self._mixed), ("frames", self._frames):
            for stream, names in mixed.items():
                if names:
                    self._container.findings.add(told_apart(stream, names, what))
        return [Named(connection, stream, tuple(self._frames.get(stream, ()))) for connection, stream in by_publisher]

    def seen_wholly(self) -> bool:
        """Tell whether all messages were looked at for frames."""
        return self._container.size() < PACKED_BYTES

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
        """Tell whether names in a connection are no longer than those of any recording; of others it is noted."""
        if max(len(connection.topic), len(connection.type), len(connection.publisher)) <= LONGEST_TEXT:
            return True
        shown = printable(connection.topic[:LONGEST_TEXT])
        self._unread.setdefault(shown, f"its name, type or publisher has more than {LONGEST_TEXT} characters")
        return False

    def _tell_publishers(self, named: list[tuple[Connection, str]]) -> None:
        """Find publishers that are streams of their own, in streams not looked at before."""
        streams = _grouped(named, self._mixed)
        self._mixed.update({stream: [] for stream in streams})
        several = {stream: own for stream, own in streams.items() if len({one.publisher for one in own}) > 1}
        if several:
            self._mixed.update(clashing(several, self._from_all_over(several)))

    def _from_all_over(self, streams: Mapping[str, Collection[Connection]]) -> Iterator[Packet]:
        """Yield messages of streams from all over the log; all of them where it is short."""
        ids = [one.id for connections in streams.values() for one in connections]
        if self._container.size() < LOOK_BYTES:
            return map(plain, self._container.packets(ids))
        return map(plain, chain(self._first_of(ids), self._container.glimpses(ids)))

    def _tell_frames(self, named: list[tuple[Connection, str]]) -> None:
        """Find frames that are streams of their own, in streams not looked at before."""
        streams = _grouped(named, self._frames)
        self._frames.update({stream: [] for stream in streams})
        watched = {one.id: (stream, one) for stream, own in streams.items() for one in own if _is_framed(one)}
        if not watched:
            return
        watches = {stream: FrameWatch() for stream, _ in watched.values()}
        # All connections, as when they are read: what is damaged of them is said once.
        ids = [one.id for own in streams.values() for one in own]
        for packet in map(plain, self._glance(ids)):
            for number in np.unique(packet.connection).tolist():
                if number in watched:
                    stream, connection = watched[number]
                    rows = np.flatnonzero(packet.connection == number)
                    watches[stream].add(connection, packet.messages.some(rows), packet.log[rows])
        self._frames.update({stream: watch.mixed() for stream, watch in watches.items()})

    def _glance(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield all messages of a short log, some from all over a long one, or its first where it has no index."""
        glimpses = iter(()) if self.seen_wholly() else self._container.glimpses(ids)
        first = next(glimpses, None)
        if first is not None:
            return chain([first], glimpses)
        packets = self._container.packets(ids)
        return packets if self.seen_wholly() else islice(packets, REPEATS)


def _refuse_absurd(named: list[tuple[Connection, str]]) -> None:
    several = {(stream, connection.encoding, connection.definition) for connection, stream in named}
    text = sum(map(len, {definition for _, _, definition in several}))
    if len(several) > MOST_CONNECTIONS or text > DECODED_BYTES:
        raise ReadError(
            f"the log has more than {MOST_CONNECTIONS} topics, or more than {DECODED_BYTES} characters of message definitions, as"
            " no recording has; only some channels of it can be read, by their names"
        )


def _grouped(named: list[tuple[Connection, str]], known: Collection[str]) -> dict[str, list[Connection]]:
    """Return the connections of each stream that is not known yet."""
    streams: dict[str, list[Connection]] = {}
    for connection, stream in named:
        if stream not in known:
            streams.setdefault(stream, []).append(connection)
    return streams


def _is_framed(connection: Connection) -> bool:
    try:
        return decoder_of(connection, "", None).framed
    except DefinitionError:
        return False
