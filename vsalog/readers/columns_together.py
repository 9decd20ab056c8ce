"""Groups the values of a stream that come in the same messages into streams.

Several nodes may publish on one topic, each for its own joints, and one may send a message per joint. Values that come together
then have their own clock: with the messages of the others in between, every second sample of a joint would be missing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import ABSENT_BITS, PART, let_go
from vsalog.core.recording import Values
from vsalog.readers.limits import MOST_PARTS

LEAST_TOGETHER = 0.75
"""Values form a group if they share this part of the messages that have either; in the other messages they are NaN."""


_Bits = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Together:
    """Columns of a stream that come in the same messages.

    Attributes
    ----------
    columns : list of str
        Names, in the log's order.
    messages : int
        Of the stream.
    bits : uint8 array, or None
        A bit for each of its messages: any of the columns is in it; None where that is so in all of them.
    """

    columns: list[str]
    messages: int
    bits: _Bits | None = None

    @property
    def count(self) -> int:
        """In how many messages any of the columns is."""
        return self.messages if self.bits is None else _count(self.bits)

    def has(self, first: int, last: int) -> NDArray[np.bool_]:
        """Return which rows from one to another, that one excluded, any of the columns is in."""
        if self.bits is None:
            return np.ones(last - first, np.bool_)
        return np.unpackbits(self.bits[first // 8 : -(-last // 8)])[first % 8 :][: last - first].astype(np.bool_)


def lacks_any(values: Values) -> bool:
    """Return whether a message lacks a value."""
    return bool((values.view(np.int64) == ABSENT_BITS).any())


def carried(column: Values) -> _Bits:
    """Return in which messages a value is, a bit each."""
    found = []
    for some in (column[first : first + PART] for first in range(0, len(column), PART)):
        found.append(np.packbits(some.view(np.int64) != ABSENT_BITS))
        let_go(some)
    return np.concatenate(found)


def together(columns: Sequence[str], partial: Mapping[str, _Bits], messages: int) -> list[Together]:
    """Group columns that come in the same messages.

    Parameters
    ----------
    columns : sequence of str
        All of a stream.
    partial : mapping of str to uint8 array
        Those that some messages do not carry, with a bit for each message that does.
    messages : int
        Of the stream.
    """
    # Nearly all columns are in the same messages as another one.
    alike: dict[bytes, list[str]] = {}
    every = np.packbits(np.ones(messages, np.bool_))
    for name in columns:
        alike.setdefault(partial.get(name, every).tobytes(), []).append(name)
    counts = {raw: _count(np.frombuffer(raw, np.uint8)) for raw in alike}
    groups: list[list[bytes]] = []
    for raw in sorted(alike, key=lambda raw: -counts[raw]):
        fitting = (group for group in groups if _are_together(group[0], raw, counts[group[0]] + counts[raw]))
        group = next(fitting, groups[-1] if len(groups) == MOST_PARTS else None)
        if group is None:
            groups.append([raw])
        else:
            group.append(raw)
    place = {name: k for k, name in enumerate(columns)}
    found = []
    for group in groups:
        bits = np.bitwise_or.reduce([np.frombuffer(raw, np.uint8) for raw in group])
        names = sorted((name for raw in group for name in alike[raw]), key=place.__getitem__)
        found.append(Together(names, messages, None if _count(bits) == messages else bits))
    return sorted(found, key=lambda one: place[one.columns[0]])


def _are_together(one: bytes, other: bytes, counts: int) -> bool:
    """Return whether most messages with either of two columns have both; `counts` is the sum of their numbers."""
    both = _count(np.frombuffer(one, np.uint8) & np.frombuffer(other, np.uint8))
    return both >= LEAST_TOGETHER * (counts - both)


def _count(bits: _Bits) -> int:
    return int(np.bitwise_count(bits).sum(dtype=np.int64))


def part_stream(stream: str, part: Together) -> str:
    """Return the name of a stream's part: the stream's name for the part in most of its messages."""
    if part.count >= LEAST_TOGETHER * part.messages:
        return stream
    return f"{stream} ({part.columns[0].removeprefix(f'{stream}.')} …)"
