"""What a log's index tells of its chunks, and which of them need not be read."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from vsalog.core.errors import ReadError
from vsalog.readers.limits import SAMPLE_ROWS

Needed = Callable[[int], bool]
"""Tells of a connection whether messages of it are still asked for."""


class IndexContradictsError(ReadError):
    """A log's index says two things of what is in a chunk: all of the log has to be read."""


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

    def may_hold(self, needed: Needed) -> bool:
        """Tell whether messages of connections that are needed may be in it."""
        return self.connections is None or any(map(needed, self.connections))


@dataclass(frozen=True, slots=True)
class Part:
    """The part of a log that is read: from one log time to another [ns], and all messages of some connections."""

    low: int
    high: int
    throughout: frozenset[int] = frozenset()

    def leaves_out(self, chunk: Chunk) -> bool:
        """Tell whether no message of this part is in a chunk."""
        outside = chunk.last < self.low or chunk.first > self.high
        return outside and not (self.throughout and chunk.may_hold(self.throughout.__contains__))


def some_of(chunks: Mapping[int, Chunk], ids: Collection[int]) -> Iterator[int]:
    """Yield the positions of chunks that may hold messages of some connections, evenly spread, the last one too."""
    positions: Sequence[int] = [
        at for at, chunk in sorted(chunks.items()) if chunk.may_hold(frozenset(ids).__contains__)
    ]
    count = min(SAMPLE_ROWS, len(positions))
    for k in range(count):
        yield positions[k * (len(positions) - 1) // max(count - 1, 1)]
