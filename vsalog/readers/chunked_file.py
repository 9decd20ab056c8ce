"""Files of records in which most messages are in chunks: the common part of MCAP files and ROS 1 bags."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, ClassVar

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import printable
from vsalog.readers.compression import beginning
from vsalog.readers.container import Chunk, Connection, Part, some_of
from vsalog.readers.limits import GLANCE_BYTES, MOST_STEPS
from vsalog.readers.packets import Bytes, Packet, RawMessage, ahead, in_packets
from vsalog.readers.record_walk import RecordWalk
from vsalog.readers.sampling_pieces import Piece, Sample, chosen_pieces

Spans = Sequence[tuple[int, ...]]
"""From which bytes of a file on, and up to which records begin that are read; () for all."""


class ChunkedFile(ABC):
    """One such file; see `vsalog.readers.container.Container`.

    Parameters
    ----------
    path : Path
        Where it is.

    Attributes
    ----------
    chunks : dict of int to Chunk
        Times and connections of each chunk by its position, from the index.
    counted : mapping of int to int
        Number of messages of each connection, from the index.

    Raises
    ------
    ReadError
        The file cannot be opened or is no such file.
    """

    WALK: ClassVar[type[RecordWalk]]
    DEFINITIONS: ClassVar[tuple[int, ...]]
    """Kinds of records that describe the messages outside of chunks."""
    NO_INDEX: ClassVar[str]
    """Code of the finding for a file without an index."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.findings = Findings()
        self.chunks: dict[int, Chunk] = {}
        self.counted: Mapping[int, int] = {}
        self._part: Part | None = None
        self._pieces: list[Piece] | None = None

    @abstractmethod
    def has_index(self) -> bool:
        """Return whether there is a sound index at the end, and read it."""

    @abstractmethod
    def connections(self) -> list[Connection]:
        """Return all connections, from the index or else by walking the file."""

    @abstractmethod
    def _check(self, file: IO[bytes]) -> None:
        """Raise ReadError where a file that was just opened is none of this kind."""

    @abstractmethod
    def _messages(self, data: Bytes, ids: Collection[int]) -> Packet:
        """Return the messages of some connections in what a chunk's data begin with."""

    @abstractmethod
    def _items(self, ids: Collection[int], spans: Spans | None) -> Iterator[Packet | RawMessage]:
        """Yield messages of some connections, those of a chunk together; damage is skipped, and noted without `spans`."""

    def size(self) -> int:
        """Return how many bytes there are, of a sample those that are read."""
        if self._pieces is not None:
            return sum(piece.size for piece in self._pieces)
        return self.path.stat().st_size

    def open(self) -> IO[bytes]:
        """Open the file; errors as for the class."""
        try:
            file = self.path.open("rb")
        except OSError as error:
            raise ReadError(f"cannot be opened: {error.strerror or error}", self.path) from error
        try:
            self._check(file)
        except ReadError:
            file.close()
            raise
        file.seek(0)
        return file

    def packets(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the messages of some connections in the order of the file; what is damaged is skipped and noted.

        Raises
        ------
        ReadError
            Only a part is read, and the index contradicts itself about it.
        """
        return ahead(in_packets(self._items(ids, None)))

    def beginnings(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the chunks with the first messages of connections, as far as there is an index."""
        self.connections()
        begins: dict[int, int] = {}
        for position in sorted(self.chunks, reverse=True):
            begins |= dict.fromkeys(self.chunks[position].connections or (), position)
        chosen = sorted({begins[number] for number in ids if number in begins})
        return in_packets(self._items(ids, [(position, position + 1) for position in chosen]))

    def narrow(self, part: Part) -> bool:
        """Skip chunks without a message in a part of the log, where the index lists chunks."""
        self.connections()
        self._part = part
        return bool(self.chunks)

    def glimpses(self, ids: Collection[int]) -> Iterator[Packet]:
        """Yield the first messages of chunks from all over the file."""
        self.connections()
        with self.open() as file:
            walk = self.WALK(file)
            for position in some_of(self.chunks, ids):
                found = walk.beginning(position)
                if found is not None:
                    yield self._messages(np.frombuffer(beginning(*found, GLANCE_BYTES), np.uint8), ids)

    def sample(self, budget: int) -> Sample | None:
        """From now on read stretches of chunks only, or the beginning of a file without any; see `Container`."""
        with self.open() as file:
            walk = self.WALK(file)
            indexed = self.has_index() and bool(self.chunks)
            heads = [head for at in sorted(self.chunks) for head in islice(walk.heads(at), 1)] if indexed else []
            if len(heads) < len(self.chunks) or any(kind != walk.CHUNK for kind, _, _ in heads) or not indexed:
                indexed = False
                heads = list(islice(walk.heads(), MOST_STEPS))
        chunks = [Piece(at, end - at) for kind, at, end in heads if kind == walk.CHUNK]
        if chunks:
            pieces, stretches = chosen_pieces(chunks, budget)
        else:
            pieces, stretches = [Piece(at, end - at) for _, at, end in heads if end <= heads[0][1] + budget], 1
        if not pieces:
            return None
        cut = Sample(
            sum(piece.size for piece in pieces),
            stretches,
            self._totals() if indexed else {},
            () if indexed else (Finding(code=self.NO_INDEX),),
        )
        chosen = {piece.position for piece in pieces}
        self.chunks = {at: chunk for at, chunk in self.chunks.items() if at in chosen}
        others = [Piece(at, end - at) for kind, at, end in heads if kind in self.DEFINITIONS and chunks]
        self._pieces = sorted([*pieces, *others])
        return cut

    def _spans(self) -> Spans:
        """Return from which byte on and up to which records are read; () for all of the file."""
        return [()] if self._pieces is None else [(at, at + size) for at, size in self._pieces]

    def _totals(self) -> dict[str, int]:
        """Return how many messages topics have; several publishers or types of one may be several streams."""
        connections = self.connections()
        often = Counter(one.topic for one in connections)
        return {printable(one.topic): self.counted.get(one.id, 0) for one in connections if often[one.topic] == 1}
