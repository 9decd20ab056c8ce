"""A pass over the records of a file, past damage: what walks over MCAP files and ROS 1 bags have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import IO, ClassVar, NamedTuple

from vsalog.core.finding import Evidence, Finding
from vsalog.core.memory import PIECE_BYTES
from vsalog.readers.limits import GLANCE_BYTES, SHOWN

Head = tuple[int, int, int]
"""A record's kind, and where it begins and ends in the file [bytes]."""


class Damage(NamedTuple):
    """A chunk that cannot be read: which one, where it begins, how many messages of it were read, and why no more."""

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
        Tells of a chunk's position whether it is passed by unread.

    Attributes
    ----------
    chunks : int
        Chunks seen.
    damage : list of Damage
        Those of them that cannot be read.
    skipped : list of (int, int)
        Stretches of bytes that are no records.
    cut : (int, int) or None
        Where reading ended and the size of the file, where no record follows up to its end.
    joined : int or None
        Where another file begins in this one, whose records are not those of this one.
    """

    MARK: ClassVar[bytes]
    """With which bytes a file begins."""

    def __init__(self, file: IO[bytes], passed: Callable[[int], bool] = lambda position: False) -> None:
        self.chunks = 0
        self.damage: list[Damage] = []
        self.skipped: list[tuple[int, int]] = []
        self.cut: tuple[int, int] | None = None
        self.joined: int | None = None
        self._file, self._passed = file, passed
        self._size = file.seek(0, 2)

    @abstractmethod
    def _end(self, position: int) -> tuple[int, int] | None:
        """Return kind and end of the record whose head is at a position; None where there is none, or the data end."""

    @abstractmethod
    def _next_sure(self, data: bytes, position: int) -> int:
        """Return where the first record surely begins in a stretch of the file from a position on; -1 where none does."""

    def lose(self, position: int, reason: str, read: int = 0) -> None:
        """Note that the last chunk, at `position`, is damaged, and that `read` of its messages could be read."""
        self.damage.append(Damage(self.chunks, position, read, reason))

    def heads(self, position: int) -> Iterator[Head]:
        """Yield the records from a position on, unread, up to the end of the data or to damage."""
        while (found := self._end(position)) is not None:
            kind, end = found
            yield kind, position, end
            position = end

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
        """Return where the next record surely begins behind damage at a position; -1 for nowhere, or in another file behind."""
        start = position
        while start < self._size:
            self._file.seek(start)
            data = self._file.read(PIECE_BYTES + GLANCE_BYTES)
            found, mark = self._next_sure(data[1:], start + 1) + 1, data.find(self.MARK)
            if mark >= 0 and not 0 < found < mark:
                self.joined = start + mark
                return -1
            if found > 0:
                return start + found
            start += PIECE_BYTES
        self.cut = (position, self._size)
        return -1


def walk_findings(skipped: Sequence[tuple[int, int]], cut: tuple[int, int] | None) -> list[Finding]:
    """Return what was damaged between records; see the attributes of `RecordWalk`."""
    found = []
    if skipped:
        where = ", ".join(str(start) for start, _ in skipped[:SHOWN]) + (", …" if len(skipped) > SHOWN else "")
        count = sum(end - start for start, end in skipped)
        found.append(Finding(code="recording.bytes_skipped", value=count, unit="B", evidence={"where": where}))
    if cut:
        found.append(Finding(code="recording.truncated", value=cut[0], limit=cut[1], unit="B"))
    return found
