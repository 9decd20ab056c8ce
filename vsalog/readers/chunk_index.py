"""What a log's index tells of its chunks, and which of them need not be read."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from vsalog.readers.limits import SAMPLE_ROWS


@dataclass(frozen=True, slots=True)
class Chunk:
    """What the index tells of a chunk.

    Attributes
    ----------
    first, last : int
        Least and largest log time in it [ns].
    connections : frozenset of int, or None
        Which have messages in it; None where that is not told.
    """

    first: int
    last: int
    connections: frozenset[int] | None

    def may_hold(self, ids: Collection[int]) -> bool:
        """Tell whether messages of some connections may be in it."""
        return self.connections is None or not self.connections.isdisjoint(ids)


@dataclass(frozen=True, slots=True)
class Part:
    """The part of a log that is read: from one log time to another [ns], and all messages of some connections."""

    low: int
    high: int
    throughout: frozenset[int] = frozenset()

    def leaves_out(self, chunk: Chunk) -> bool:
        """Tell whether no message of this part is in a chunk."""
        outside = chunk.last < self.low or chunk.first > self.high
        return outside and not (self.throughout and chunk.may_hold(self.throughout))


def some_of(chunks: Mapping[int, Chunk], ids: Collection[int]) -> Iterator[int]:
    """Yield the positions of chunks that may hold messages of some connections, evenly spread, the last one too."""
    wanted = frozenset(ids)
    positions = [at for at, chunk in sorted(chunks.items()) if chunk.may_hold(wanted)]
    count = min(SAMPLE_ROWS, len(positions))
    for k in range(count):
        yield positions[k * (len(positions) - 1) // max(count - 1, 1)]
