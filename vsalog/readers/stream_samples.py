"""The blocks of a stream, put together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import Column, is_mapped, parts
from vsalog.core.finding import Finding
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.recording import Stamps, Values
from vsalog.readers.base import Block
from vsalog.readers.columns_together import carried, lacks_any, part_stream, together

HEADER = ".header."
"""A part of the names of fields in a message's header."""

T = TypeVar("T", np.int64, np.float64)

Rows = Callable[[int, int], NDArray[np.bool_]]
"""Returns which of the rows from one to another, the last excluded, are chosen."""


@dataclass(slots=True)
class Samples:
    """All samples of a stream in the order of the log: stamps of the clocks that all of them have, and columns by name."""

    type: str
    clocks: dict[str, Stamps]
    columns: dict[str, Values]
    units: dict[str, str]
    timeless: Finding | None = None

    def chosen(self, rows: Rows, names: Collection[str]) -> Samples:
        """Return some columns, which are forgotten here, in some rows."""
        clocks = {kind: _chosen(stamps, rows) for kind, stamps in self.clocks.items()}
        columns = {name: _chosen(self.columns.pop(name), rows) for name in list(names)}
        return Samples(self.type, clocks, columns, self.units, self.timeless)

    def without(self, rows: Stamps) -> Samples:
        """Return all columns, which are forgotten here, without some rows, which are given in order."""

        def others(first: int, last: int) -> NDArray[np.bool_]:
            kept = np.ones(last - first, np.bool_)
            kept[rows[slice(*np.searchsorted(rows, (first, last)))] - first] = False
            return kept

        return self.chosen(others, self.columns) if rows.size else self


def _chosen(column: NDArray[T], rows: Rows) -> NDArray[T]:
    some = Column(column.dtype.type, in_file=is_mapped(column))
    for first, last in parts(column):
        some.append(column[first:last][rows(first, last)])
    return some.whole(len(some))


@dataclass(slots=True)
class Gathered:
    """The blocks of one stream. Columns lie in files where they are `in_file`; those in `partial` are not in all messages."""

    type: str
    in_file: bool = False
    count: int = 0
    blocks: int = 0
    clocks: dict[str, Column[np.int64]] = field(default_factory=dict)
    columns: dict[str, Column[np.float64]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    timeless: Finding | None = None
    partial: set[str] = field(default_factory=set)

    def add(self, block: Block) -> None:
        """Append a block."""
        # Room for the announced samples takes no memory before it is filled.
        room = min(block.expected, AT_ONCE_BYTES // 8)
        for kind, stamps in block.clocks.items():
            if kind not in self.clocks:
                self.clocks[kind] = Column(np.int64, room, in_file=self.in_file)
            # A clock that a block lacks is none; the rest of it does not matter then.
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

    def to_file(self) -> None:
        """Put present and future samples into files."""
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

    def streams(self, name: str) -> Iterator[tuple[str, Samples]]:
        """Yield the groups of columns that come in the same messages, with their names; they are removed here."""
        self.partial |= {name for name, column in self.columns.items() if column.blocks < self.blocks}
        clocks = {kind: clock.so_far() for kind, clock in self.clocks.items() if clock.blocks == self.blocks}
        names = [*self.columns]
        columns = {column: self.columns.pop(column).whole(self.count) for column in names}
        whole = Samples(self.type, clocks, columns, self.units, self.timeless)
        heads = [column for column in names if HEADER in column]  # are in all messages, and so not informative
        others = [column for column in names if column not in heads]
        partial = {column: carried(columns[column]) for column in others if column in self.partial}
        parts = together(others, partial, self.count) if partial else []
        if not parts:
            yield name, whole
            return
        max(parts, key=lambda part: part.count).columns.extend(heads)
        for part in parts:
            yield part_stream(name, part), whole.chosen(part.has, part.columns)
