"""The interface of a file of serialised messages: connections, packets of messages, and an index of chunks."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from vsalog.core.finding import Findings
from vsalog.readers.limits import SAMPLE_ROWS
from vsalog.readers.packets import Packet
from vsalog.readers.sampling_pieces import Sample

MOST_CONNECTIONS = 2**14
"""Connections or topics that a log has at most; more would take minutes and memory to prepare for."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""The first bytes of messages and files that ROS 2 has compressed."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """The index entry of a chunk.

    Attributes
    ----------
    first, last : int
        Least and largest log time in it [ns].
    connections : frozenset of int, or None
        Which have messages in it; None where the index does not list them.
    """

    first: int
    last: int
    connections: frozenset[int] | None

    def may_hold(self, ids: Collection[int]) -> bool:
        """Return whether messages of some connections may be in it."""
        return self.connections is None or not self.connections.isdisjoint(ids)


@dataclass(frozen=True, slots=True)
class Part:
    """The part of a log that is read: from one log time to another [ns], and all messages of some connections."""

    low: int
    high: int
    throughout: frozenset[int] = frozenset()

    def leaves_out(self, chunk: Chunk) -> bool:
        """Return whether no message of this part is in a chunk."""
        outside = chunk.last < self.low or chunk.first > self.high
        return outside and not (self.throughout and chunk.may_hold(self.throughout))


def some_of(chunks: Mapping[int, Chunk], ids: Collection[int]) -> Iterator[int]:
    """Yield the positions of chunks that may hold messages of some connections, evenly spread, the last one too."""
    wanted = frozenset(ids)
    positions = [at for at, chunk in sorted(chunks.items()) if chunk.may_hold(wanted)]
    count = min(SAMPLE_ROWS, len(positions))
    for k in range(count):
        yield positions[k * (len(positions) - 1) // max(count - 1, 1)]


@dataclass(frozen=True, slots=True)
class Connection:
    """A publication: one per topic, type, definition and publisher.

    Attributes
    ----------
    id : int
        The container's own number.
    topic, type : str
        As in the log.
    encoding : str
        Of the messages: ``cdr``, ``ros1``, ``json``, ``protobuf`` …
    language : str
        Of the definition: ``msg``, ``idl``, ``protobuf`` or "".
    definition : str
        Text, "" where the log has none; descriptors of protobuf with a character for each byte.
    metadata : mapping of str to str
        Further metadata; ``unit`` and ``unit:FIELD`` are units.
    publisher : str
        The publisher, if the log has it: a node's name or a number.
    """

    id: int
    topic: str
    type: str
    encoding: str
    language: str
    definition: str
    metadata: Mapping[str, str] = field(default_factory=dict)
    publisher: str = ""


class Container(Protocol):
    """A file of serialised messages.

    `has_publish` is whether it keeps a publish time in addition to the log time.
    """

    format: str
    has_publish: bool
    findings: Findings

    @property
    def rig_text(self) -> str | None: ...  # noqa: D102

    def connections(self) -> list[Connection]:
        """Return all connections."""
        ...

    def counts(self) -> Mapping[int, int]:
        """Return how many messages connections have, at most, where the container says so at once."""
        ...

    def size(self) -> int:
        """Return how many bytes there are."""
        ...

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some connections in the order of the file."""
        ...

    def beginnings(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the first messages of connections, as far as an index has their positions."""
        ...

    def glimpses(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield some messages of connections from all over the file, where that is possible without reading it all."""
        ...

    def narrow(self, part: Part) -> bool:
        """From now on skip messages that are surely in no part of the log; return whether that is possible."""
        ...

    def sample(self, budget: int) -> Sample | None:
        """Limit reading to stretches spread over the log, of a given total size, and return them.

        None where that would be half of the log or more, or cannot be done; of several files some may be cut then.
        """
        ...
