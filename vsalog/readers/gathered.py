"""The blocks of a stream, put together."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import Column, let_go, parts
from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps, Values
from vsalog.readers.base import Block
from vsalog.readers.carried import Together, carried, lacks_any, together
from vsalog.readers.limits import MOST_WAITING

# Samples that room is made for at once where a log promises them; the room is no memory before it is filled.
HEADER = ".header."
"""In names of what is in a message's header."""

T = TypeVar("T", np.int64, np.float64)


@dataclass(slots=True)
class Gathered:
    """The blocks of one stream; in `alike` of them publish times are the log's.

    Columns lie in files where they are `in_file`. Those in `partial` are not in all messages.
    """

    type: str
    in_file: bool = False
    count: int = 0
    blocks: int = 0
    clocks: dict[str, Column[np.int64]] = field(default_factory=dict)
    columns: dict[str, Column[np.float64]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    timeless: Finding | None = None
    alike: int = 0
    partial: set[str] = field(default_factory=set)

    def add(self, block: Block) -> None:
        """Take a block in."""
        room = min(block.expected, MOST_WAITING)
        log = block.clocks.get("log")
        for kind, stamps in block.clocks.items():
            if kind == "publish" and stamps is log and kind not in self.clocks:
                self.alike += 1  # one array does for both, until they differ
                continue
            if kind not in self.clocks:
                self.clocks[kind] = Column(np.int64, room, in_file=self.in_file)
                if kind == "publish" and self.alike:
                    self._as_the_log()
            # A clock that a block has not is none; the rest of it does not matter then.
            self.clocks[kind].append(stamps)
        for name, values in block.columns.items():
            if name not in self.columns:
                self.columns[name] = Column(np.float64, room, in_file=self.in_file)
            self.columns[name].add(self.count, values)
            if not block.whole and name not in self.partial and lacks_any(values):
                self.partial.add(name)
        for name, unit in block.units.items():
            self.units.setdefault(name, unit)
        self.timeless = block.timeless
        self.count += len(next(iter(block.clocks.values())))
        self.blocks += 1

    def _as_the_log(self) -> None:
        """Begin the publish times with those of the log, which they were so far."""
        log, publish = self.clocks["log"].so_far(), self.clocks["publish"]
        for first, last in parts(log[: self.count]):
            publish.append(log[first:last])
        publish.blocks = self.alike

    def to_file(self) -> None:
        """Put what there is and what is to come into files."""
        self.in_file = True
        for clock in self.clocks.values():
            clock.to_file()
        for column in self.columns.values():
            column.to_file()

    def growth(self, block: Block) -> int:
        """Return how many bytes more the samples take with another block."""
        new = block.columns.keys() - self.columns.keys()
        rows = len(next(iter(block.clocks.values())))
        return 8 * (rows * (len(self.columns) + len(new) + len(block.clocks)) + self.count * len(new))

    def joined_clocks(self) -> dict[str, Stamps]:
        """Return the clocks that every block has."""
        found = {kind: clock.so_far() for kind, clock in self.clocks.items() if clock.blocks == self.blocks}
        if "publish" not in self.clocks and self.alike == self.blocks and self.alike:
            found["publish"] = found["log"]
        return found

    def take_column(self, name: str) -> Values:
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
        taken = Gathered(self.type, self.in_file, part.count, 1, units=self.units, timeless=self.timeless)
        for kind, stamps in self.joined_clocks().items():
            taken.clocks[kind] = self._some(stamps, part)
        for name in part.columns:
            taken.columns[name] = self._some(self.take_column(name), part)
        return taken

    def _some(self, column: NDArray[T], part: Together) -> Column[T]:
        """Return those rows of a column that are of a part."""
        some = Column(column.dtype.type, part.count, in_file=self.in_file)
        for first, last, rows in part.pieces():
            some.append(column[first:last][rows])
            let_go(column[first:last])
        some.blocks = 1
        return some
