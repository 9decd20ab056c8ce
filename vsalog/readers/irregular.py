"""Messages that have no shape in common → columns of numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vsalog.core.spool import ABSENT
from vsalog.readers.definitions import Struct, is_placeholder
from vsalog.readers.layout import Field, Integers
from vsalog.readers.layout_values import column, stamps
from vsalog.readers.message_memory import Memory
from vsalog.readers.message_program import program_of
from vsalog.readers.message_scan import Found, scatter
from vsalog.readers.packets import Messages

_ROOM = 2**17  # numbers that are found at once


class Kind(IntEnum):
    """What a number is that has no column (yet)."""

    NEW, LEFT_OUT = range(-2, 0)


@dataclass(frozen=True, slots=True)
class Numbers:
    """The numbers of n messages.

    Attributes
    ----------
    rows : int64 array, shape (n,)
        Which messages they are.
    stamps : int64 array, shape (n,), or None
        Header stamps [ns]; None where the type has none.
    columns : dict of str to float64 array, shape (n,)
        By path, ABSENT where a message has no such value.
    units : dict of str to str
        By path, where the message type implies one.
    """

    rows: Integers
    stamps: Integers | None
    columns: dict[str, NDArray[np.float64]]
    units: dict[str, str]


class IrregularDecoder:
    """Decodes ROS messages each on its own, by compiled loops.

    Parameters
    ----------
    root : Struct
        The definition of the message type.
    cdr : bool
        ROS 2's encoding, or ROS 1's.
    wanted : function
        Tells of a number's path whether it is to be decoded.

    Attributes
    ----------
    able : bool
        The type is one that can be decoded so.
    unread : dict of str to str
        Paths that are no signal, with the reason.
    """

    def __init__(self, root: Struct, cdr: bool, wanted: Callable[[str], bool]) -> None:
        self.unread: dict[str, str] = {}
        self._cdr, self._wanted = cdr, wanted
        program = program_of(root)
        self.able = program is not None
        if program is None:
            return
        self._steps, self._places, self._stamp = program.steps, program.places, program.stamp
        self._codes = sorted({place.code for place in program.places if place.code})
        self._memory = Memory()
        self._paths: dict[int, str] = {0: ""}
        self._kind = np.full(len(self._memory.keys), Kind.NEW, dtype=np.int64)  # by number: which of the codes
        self._found = Found(np.empty(_ROOM, np.int64), np.empty(_ROOM, np.int64), np.empty(_ROOM, np.int64))

    def decode(self, messages: Messages) -> Iterator[Numbers]:
        """Yield the numbers of the messages that are sound and not odd, stretch by stretch."""
        begin = 0
        while begin < len(messages):
            start, length = messages.start[begin:], messages.length[begin:]
            good, found_at, count = self._memory.scan(self._steps, self._cdr, messages.data, start, length, self._found)
            number, row, at = (part[:count] for part in self._found)
            rows = np.flatnonzero(good)
            self._learn(number, at)
            row = (np.cumsum(good) - 1)[row]  # among the sound ones
            columns, units = self._columns(messages, number, row, at, rows.size)
            times = None
            if rows.size and found_at[rows[0]] >= 0:
                times = stamps(messages.data, found_at[rows], Field("", 0, self._stamp, "s"))
            yield Numbers(rows + begin, times, columns, units)
            begin += good.size

    def _learn(self, number: Integers, at: Integers) -> None:
        """Tell what was met for the first time; what is no signal is noted."""
        new = np.flatnonzero(self._kind[number] == Kind.NEW)
        for one, k in zip(*(part.tolist() for part in np.unique(number[new], return_index=True)), strict=True):
            _, place, name = self._memory.keys[one].tolist()
            path, detail = self._path(one), self._places[place]
            self._kind[one] = Kind.LEFT_OUT
            if detail.array and not name:
                self.unread.setdefault(path, f"array of {int(at[new[k]])} values")
            elif not detail.code:
                self.unread.setdefault(path, "text")
            elif self._wanted(path) and not is_placeholder(path.rpartition(".")[2]):
                self._kind[one] = self._codes.index(detail.code)

    def _columns(
        self, messages: Messages, number: Integers, row: Integers, at: Integers, count: int
    ) -> tuple[dict[str, NDArray[np.float64]], dict[str, str]]:
        """Return the numbers that lie at some places, by path, and their units."""
        here = np.flatnonzero(np.bincount(number, minlength=1))
        here = here[self._kind[here] >= 0]
        lines: dict[str, int] = {}
        units: dict[str, str] = {}
        line = np.empty(len(self._kind), dtype=np.int64)
        for one in here.tolist():
            path, unit = self._path(one), self._places[self._memory.keys[one, 1]].unit
            line[one] = lines.setdefault(path, len(lines))
            if unit is not None:
                units[path] = unit
        table = np.full((len(lines), count), ABSENT)
        kinds = self._kind[number]
        for kind in np.unique(self._kind[here]).tolist():
            own = np.flatnonzero(kinds == kind)
            values = column(messages.data, at[own], Field("", 0, self._codes[kind], None))
            scatter(values, line[number[own]], row[own], table)
        return {path: table[k] for path, k in lines.items()}, units

    def _path(self, number: int) -> str:
        """Return the path of something by its number."""
        if number not in self._paths:
            outer, place, name = self._memory.keys[number].tolist()
            label = "" if not name else f"[{self._memory.label(name) if name > 0 else -1 - name}]"
            self._paths[number] = f"{self._path(outer)}{self._places[place].path}{label}"
        return self._paths[number]
