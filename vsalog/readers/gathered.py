"""The blocks of a stream, put together: in memory, or in a temporary file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.spool import ABSENT, Column, Kind, Spool, SpooledColumn, parts
from vsalog.readers.base import BLOCK_ROWS, Block
from vsalog.readers.carried import Together, carried, lacks_any, together

# Samples that room is made for at once where a log promises them; the room is no memory before it is filled.
_MOST_ROOM = 2**22

HEADER = ".header."
"""In names of what is in a message's header."""

T = TypeVar("T", np.int64, np.float64)


@dataclass(slots=True)
class _Column(Generic[T]):
    """Values that grow block by block.

    Memory that was never written to is zero and takes no room, so a column of zeros, as of covariances that nobody fills in,
    is not written before another number comes.
    """

    values: NDArray[T]
    filled: int = 0
    blocks: int = 0
    zero: bool = True

    def spooled(self, spool: Spool) -> SpooledColumn:
        """Return the same values in a temporary file, and forget them here."""
        column = SpooledColumn(spool, self.values.dtype.type)
        column.add(0, self.values[: self.filled])
        column.blocks = self.blocks
        self.values = self.values[:0]
        return column

    def add(self, at: int, new: NDArray[T]) -> None:
        """Put a block's values in place; what blocks before it had not is absent."""
        end = at + len(new)
        if end > self.values.size:
            smaller, self.values = self.values, np.zeros(max(end, 2 * self.values.size), dtype=self.values.dtype)
            for begin in range(0, self.filled, BLOCK_ROWS):
                self._put(begin, smaller[begin : min(begin + BLOCK_ROWS, self.filled)])
        if self.filled < at:
            self.values[self.filled : at] = ABSENT
        self._put(at, new)
        self.filled, self.blocks = end, self.blocks + 1

    def whole(self, count: int) -> NDArray[T]:
        """Return all values, absent at the end where the last blocks had none."""
        self.add(count, self.values[:0])
        self.values.resize(count, refcheck=False)
        return self.values

    def _put(self, at: int, new: NDArray[T]) -> None:
        self.zero = self.zero and not new.view(np.int64).any()
        if not self.zero:
            self.values[at : at + len(new)] = new


@dataclass(slots=True)
class Gathered:
    """The blocks of one stream; in `alike` of them publish times are the log's.

    Columns are arrays, or lie in `spool` where there is one. Those in `partial` are not in all messages.
    """

    type: str
    spool: Spool | None = None
    count: int = 0
    blocks: int = 0
    clocks: dict[str, _Column[np.int64] | SpooledColumn] = field(default_factory=dict)
    columns: dict[str, _Column[np.float64] | SpooledColumn] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    timeless: Finding | None = None
    alike: int = 0
    partial: set[str] = field(default_factory=set)

    def add(self, block: Block) -> None:
        """Take a block in."""
        room = min(block.expected, _MOST_ROOM)
        log = block.clocks.get("log")
        for kind, stamps in block.clocks.items():
            if kind == "publish" and stamps is log and kind not in self.clocks:
                self.alike += 1  # one array does for both, until they differ
                continue
            if kind not in self.clocks:
                self.clocks[kind] = self._new_clock(room)
                if kind == "publish" and self.alike:
                    self._as_the_log()
            # A clock that a block has not is none; the rest of it does not matter then.
            self.clocks[kind].add(self.clocks[kind].filled, stamps)
        for name, values in block.columns.items():
            if name not in self.columns:
                self.columns[name] = _Column(np.zeros(room)) if self.spool is None else self._spooled(np.float64)
            self.columns[name].add(self.count, values)
            if not block.whole and name not in self.partial and lacks_any(values):
                self.partial.add(name)
        for name, unit in block.units.items():
            self.units.setdefault(name, unit)
        self.timeless = block.timeless
        self.count += len(next(iter(block.clocks.values())))
        self.blocks += 1

    def _new_clock(self, room: int) -> _Column[np.int64] | SpooledColumn:
        return _Column(np.zeros(room, dtype=np.int64)) if self.spool is None else self._spooled(np.int64)

    def _spooled(self, kind: Kind) -> SpooledColumn:
        assert self.spool is not None
        return SpooledColumn(self.spool, kind)

    def _as_the_log(self) -> None:
        """Begin the publish times with those of the log, which they were so far."""
        log, publish = self.clocks["log"], self.clocks["publish"]
        for first, last in parts(self.count):
            publish.add(first, (log[first:last] if isinstance(log, SpooledColumn) else log.values[first:last]))
        publish.blocks = self.alike

    def to_disk(self, spool: Spool) -> None:
        """Put what there is and what is to come into a temporary file."""
        self.spool = spool
        self.clocks = {k: c.spooled(spool) if isinstance(c, _Column) else c for k, c in self.clocks.items()}
        for name, column in self.columns.items():
            if isinstance(column, _Column):
                self.columns[name] = column.spooled(spool)

    def growth(self, block: Block) -> int:
        """Return how many bytes more the samples take with another block."""
        new = block.columns.keys() - self.columns.keys()
        rows = len(next(iter(block.clocks.values())))
        return 8 * (rows * (len(self.columns) + len(new) + len(block.clocks)) + self.count * len(new))

    def joined_clocks(self) -> dict[str, Column]:
        """Return the clocks that every block has."""
        found: dict[str, Column] = {
            kind: clock if isinstance(clock, SpooledColumn) else clock.values[: self.count]
            for kind, clock in self.clocks.items()
            if clock.blocks == self.blocks
        }
        if "publish" not in self.clocks and self.alike == self.blocks and self.alike:
            found["publish"] = found["log"]
        return found

    def take_column(self, name: str) -> Column:
        """Return a column over all blocks, NaN where a block has none of it, and forget it here."""
        return self.columns.pop(name).whole(self.count)

    def parts(self) -> list[Together]:
        """Return which columns come in the same messages; headers are in all of them, and tell nothing of that."""
        self.partial |= {name for name, column in self.columns.items() if column.blocks < self.blocks}
        heads = [name for name in self.columns if HEADER in name]
        others = [name for name in self.columns if name not in heads]
        partial = [name for name in others if name in self.partial]
        if not partial:
            return [Together([*self.columns], self.count)]
        bits = {name: carried(self.columns[name].whole(self.count)) for name in partial}
        found = together(others, bits, self.count)
        max(found, key=lambda part: part.count).columns.extend(heads)
        return found

    def take_part(self, part: Together) -> Gathered:
        """Return some columns, in those messages that have any of them, and forget them here."""
        taken = Gathered(self.type, self.spool, part.count, 1, units=self.units, timeless=self.timeless)
        for kind, stamps in self.joined_clocks().items():
            taken.clocks[kind] = self._some(stamps, part, np.int64)
        for name in part.columns:
            taken.columns[name] = self._some(self.take_column(name), part, np.float64)
        return taken

    def _some(self, column: Column, part: Together, kind: Kind) -> _Column[Any] | SpooledColumn:
        """Return those rows of a column that are of a part."""
        chosen = (column[first:last][rows] for first, last, rows in part.pieces())
        if self.spool is None:
            values = np.concatenate([*chosen])
            return _Column(values, values.size, 1, zero=False)
        spooled = self._spooled(kind)
        for values in chosen:
            spooled.add(len(spooled), values)
        spooled.blocks = 1
        return spooled
