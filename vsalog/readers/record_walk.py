"""A pass over the records of a file, past damage: the common part of walks over MCAP files and ROS 1 bags."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import IO, ClassVar, NamedTuple

from vsalog.core.finding import Evidence, Finding
from vsalog.core.memory import PIECE_BYTES
from vsalog.readers.compression import DamagedDataError
from vsalog.readers.limits import GLANCE_BYTES, SHOWN

Head = tuple[int, int, int]
"""A record's kind, and where it begins and ends in the file [bytes]."""

Header = Mapping[bytes, bytes]
"""The fields of a record's header, by name, in formats that name them."""

_NO_FIELDS: Header = MappingProxyType({})


class Place(NamedTuple):
    """The position of a record: its kind, the start and end of its content in the file [bytes], and its header."""

    kind: int
    start: int
    end: int
    header: Header = _NO_FIELDS


class Record(NamedTuple):
    """A record: its kind, where it begins in the file, its content, that of a chunk decompressed, and its header."""

    kind: int
    position: int
    content: bytes
    header: Header


class Damage(NamedTuple):
    """A chunk that cannot be read: its number, its position, how many messages of it were read, and the reason."""

    number: int
    position: int
    read: int
    reason: str


class RecordWalk(ABC):
    """One such pass.

    Parameters
    ----------
    file : binary file
        Opened.
    passed : function
        Returns for a chunk's position whether it is skipped unread.

    Attributes
    ----------
    chunks : int
        Chunks seen.
    passing : bool
        The last chunk was skipped.
    damage : list of Damage
        Those of them that cannot be read.
    skipped : list of (int, int)
        Stretches of bytes that are no records.
    cut : (int, int) or None
        Where reading ended and the size of the file, where no record follows up to its end.
    joined : int or None
        Where another file begins in this one, whose records are not those of this one.
    end : int or None
        Where the part after the data begins, once the record that ends them was reached.
    """

    MARK: ClassVar[bytes]
    """The first bytes of a file."""
    CHUNK: ClassVar[int]
    LAST: ClassVar[tuple[int, ...]] = ()
    """Kinds of records: chunks, and those that end the data, in formats that have such."""

    def __init__(self, file: IO[bytes], passed: Callable[[int], bool] = lambda position: False) -> None:
        self.chunks = 0
        self.passing = False
        self.damage: list[Damage] = []
        self.skipped: list[tuple[int, int]] = []
        self.cut: tuple[int, int] | None = None
        self.joined: int | None = None
        self.end: int | None = None
        self._file, self._passed = file, passed
        self._size = file.seek(0, 2)

    @abstractmethod
    def beginning(self, position: int) -> tuple[str, bytes] | None:
        """Return the compression and the first bytes of the data of the chunk at a position; None where there is none."""

    @abstractmethod
    def _head(self, position: int) -> Place | None:
        """Return the record whose head is at a position; None where there is none."""

    @abstractmethod
    def _sound(self, position: int) -> Place | None:
        """Return the record at a position; None where there is none whose parts agree."""

    @abstractmethod
    def _decompressed(self, chunk: Place, content: bytes) -> bytes:
        """Return the records in a chunk, or raise DamagedDataError."""

    @abstractmethod
    def _next_sure(self, data: bytes, position: int) -> int:
        """Return where the first record surely begins in a stretch of the file from a position on; -1 where none does."""

    def _content(self, place: Place) -> bytes | None:
        """Return a record's content; None where it is not handed over. DamagedDataError where it is too long."""
        self._file.seek(place.start)
        return self._file.read(place.end - place.start)

    def _follows(self, end: int) -> bool:
        """Return whether the end of a chunk is right, as far as its content shows."""
        return True

    def _finish(self, last: Place) -> None:
        """Record the record that ends the data."""
        self.end = last.end

    def records(self, position: int | None = None, until: int | None = None) -> Iterator[Record]:
        """Yield the records from a position on, or the first one, and `until` another.

        Without that up to the end of the data or of what there is. Chunks that cannot be decompressed are noted.
        """
        position = len(self.MARK) if position is None else position
        if until is None and not self.LAST:
            until = self._size
        while until is None or position < until:
            place = self._sound(position)
            if place is None:
                following = self._resume(position)
                if following < 0:
                    return
                self.skipped.append((position, following))
                position = following
                continue
            if place.kind in self.LAST:
                self._finish(place)
                return
            if place.kind == self.CHUNK:
                self.passing = self._passed(position) and self._follows(place.end)
                if self.passing:
                    position = place.end
                    continue
                self.chunks += 1
            try:
                content = self._content(place)
                if (
                    content is not None and len(content) < place.end - place.start
                ):  # the file has become shorter meanwhile
                    self.cut = (position, self._size)
                    return
                if content is not None and place.kind == self.CHUNK:
                    content = self._decompressed(place, content)
            except DamagedDataError as error:
                self.lose(position, str(error))
                position = place.end if self._follows(place.end) else self._resume(position)
                if position < 0:
                    return
                continue
            if content is not None:
                yield Record(place.kind, position, content, place.header)
            position = place.end

    def lose(self, position: int, reason: str, read: int = 0) -> None:
        """Note that the last chunk, at `position`, is damaged, and that `read` of its messages could be read."""
        self.damage.append(Damage(self.chunks, position, read, reason))

    def heads(self, position: int | None = None) -> Iterator[Head]:
        """Yield the records from a position on, or the first one, unread, up to the end of the data or to damage."""
        position = len(self.MARK) if position is None else position
        while (place := self._head(position)) is not None and place.kind not in self.LAST:
            yield place.kind, position, place.end
            position = place.end

    def findings(self) -> list[Finding]:
        """Return what was damaged."""
        found = walk_findings(self.skipped, self.cut)
        if self.damage:
            which = [f"chunk {one.number} at byte {one.position}: {one.reason}" for one in self.damage[:SHOWN]]
            where = "; ".join(which + ["…"] * (len(self.damage) > SHOWN))
            evidence: Evidence = {"chunks": self.chunks, "where": where}
            found.append(Finding(code="recording.chunks_damaged", value=len(self.damage), evidence=evidence))
        if self.joined is not None:
            found.append(Finding(code="recording.joined", value=self.joined, limit=self._size, unit="B"))
        return found

    def _resume(self, position: int) -> int:
        """Return where the next record surely begins after damage at a position; -1 for nowhere, or in another file after it."""
        start = position
        while start < self._size:
            self._file.seek(start)
            data = self._file.read(PIECE_BYTES + GLANCE_BYTES)
            found, mark = self._next_sure(data[1:], start + 1) + 1, data.find(self.MARK)
            behind = start + mark + len(self.MARK)  # nothing follows where a file ends with its mark
            if mark >= 0 and behind < self._size and not 0 < found < mark:
                self.joined = start + mark
                if position < self.joined:
                    self.skipped.append((position, self.joined))
                return -1
            if found > 0:
                return start + found
            start += PIECE_BYTES
        self.cut = (position, self._size)
        return -1


def walk_findings(skipped: Sequence[tuple[int, int]], cut: tuple[int, int] | None) -> list[Finding]:
    """Return the damage between records; see the attributes of `RecordWalk`."""
    found = []
    if skipped:
        where = ", ".join(str(start) for start, _ in skipped[:SHOWN]) + (", …" if len(skipped) > SHOWN else "")
        count = sum(end - start for start, end in skipped)
        found.append(Finding(code="recording.bytes_skipped", value=count, unit="B", evidence={"where": where}))
    if cut:
        found.append(Finding(code="recording.truncated", value=cut[0], limit=cut[1], unit="B"))
    return found
