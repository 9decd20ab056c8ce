"""Serialised messages by the thousand: positions in a buffer, instead of one object each."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.readers.limits import BLOCK_ROWS

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

Item = TypeVar("Item")

RawMessage = tuple[int, int, int, bytes]
"""Connection, log time [ns], publish time [ns], the serialised message."""

SWITCH = 2e-4
"""How long a thread may hold Python's lock while another makes the next item [s]."""


@dataclass(frozen=True, slots=True)
class Messages:
    """Serialised messages in a buffer.

    Attributes
    ----------
    data : uint8 array
        The buffer.
    start, length : int64 arrays, shape (n,)
        The position of each message.
    """

    data: Bytes
    start: Integers
    length: Integers

    @classmethod
    def of(cls, messages: Sequence[bytes]) -> Messages:
        """Put messages behind one another."""
        length = np.fromiter(map(len, messages), dtype=np.int64, count=len(messages))
        return cls(np.frombuffer(b"".join(messages), np.uint8), _behind_one_another(length), length)

    @classmethod
    def joined(cls, parts: Sequence[Messages]) -> Messages:
        """Put the messages of several compact buffers behind one another."""
        if len(parts) == 1:
            return parts[0]
        length = np.concatenate([part.length for part in parts])
        return cls(np.concatenate([part.data for part in parts]), _behind_one_another(length), length)

    def __len__(self) -> int:
        return int(self.start.size)

    def __iter__(self) -> Iterator[bytes]:
        for start, length in zip(self.start.tolist(), self.length.tolist(), strict=True):
            yield self.data[start : start + length].tobytes()

    def take(self, rows: Integers) -> Messages:
        """Return some of the messages in a buffer of their own, behind one another."""
        start, length = self.start[rows], self.length[rows]
        at = _behind_one_another(length)
        out = np.empty(int(length.sum()), dtype=np.uint8)
        _gather(self.data, start, length, at, out)
        return Messages(out, at, length)

    def some(self, rows: Integers) -> Messages:
        """Return some of the messages where they lie."""
        return Messages(self.data, self.start[rows], self.length[rows])

    def by_length(self) -> Iterator[Integers]:
        """Yield the indices of the messages of each length, in order."""
        if np.all(self.length == self.length[:1]):
            if self.length.size:
                yield np.arange(self.length.size)
            return
        order = np.argsort(self.length, kind="stable")
        ends = np.flatnonzero(np.diff(self.length[order])) + 1
        yield from np.split(order, ends)

    def beginning_with(self, magic: bytes) -> NDArray[np.bool_]:
        """Return which messages begin with some bytes."""
        out = self.length >= len(magic)
        for i, byte in enumerate(magic):
            out[out] = self.data[self.start[out] + i] == byte
        return out


@dataclass(frozen=True, slots=True)
class Packet:
    """Messages as they follow one another in a file.

    Attributes
    ----------
    connection : int64 array, shape (n,)
        The container's own numbers.
    log, publish : int64 arrays, shape (n,)
        Times [ns]; the formats count them unsigned, invalid ones beyond int64 are negative.
    messages : of these
    compressed : bool
        Some of them may be compressed one by one.
    """

    connection: Integers
    log: Integers
    publish: Integers
    messages: Messages
    compressed: bool = True

    @classmethod
    def joined(cls, parts: Sequence[Packet]) -> Packet:
        """Put the messages of several packets, compact ones, behind one another; there is at least one."""
        columns = zip(*((part.connection, part.log, part.publish) for part in parts), strict=True)
        connection, log, publish = map(np.concatenate, columns)
        return cls(connection, log, publish, Messages.joined([part.messages for part in parts]))

    def some(self, rows: Integers) -> Packet:
        """Return some of the messages where they lie."""
        connection, log, publish = self.connection[rows], self.log[rows], self.publish[rows]
        return Packet(connection, log, publish, self.messages.some(rows), self.compressed)

    def take(self, rows: Integers) -> Packet:
        """Return some of the messages in a buffer of their own."""
        return replace(self.some(rows), messages=self.messages.take(rows))


def ahead(items: Iterator[Item]) -> Iterator[Item]:
    """Yield items while the next one is already made in a thread of its own: decompression and checksums leave Python free."""
    end, usual = object(), sys.getswitchinterval()
    # Neither thread is at rest for long: with Python's usual 5 ms each would wait for the other most of the time.
    sys.setswitchinterval(SWITCH)
    try:
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(next, items, end)
            while (item := waiting.result()) is not end:
                waiting = pool.submit(next, items, end)
                yield item  # type: ignore[misc]
    finally:
        sys.setswitchinterval(usual)


def in_packets(items: Iterator[Packet | RawMessage]) -> Iterator[Packet]:
    """Yield packets with messages as they are, and messages that come one by one in packets of some."""
    loose: list[RawMessage] = []
    for item in items:
        if loose and (isinstance(item, Packet) or len(loose) >= BLOCK_ROWS):
            yield packet_of(loose)
            loose = []
        if not isinstance(item, Packet):
            loose.append(item)
        elif len(item.messages):
            yield item
    if loose:
        yield packet_of(loose)


def packet_of(messages: Sequence[RawMessage]) -> Packet:
    """Make one packet of messages; there is at least one."""
    connection, log, publish, content = zip(*messages, strict=True)
    return Packet(np.array(connection, dtype=np.int64), _stamps(log), _stamps(publish), Messages.of(content))


def _stamps(times: Sequence[int]) -> Integers:
    return np.array(times, dtype=np.uint64).view(np.int64)


def _behind_one_another(length: Integers) -> Integers:
    return np.cumsum(length) - length


@njit(cache=True, nogil=True)
def _gather(data: Bytes, start: Integers, length: Integers, at: Integers, out: Bytes) -> None:
    for k in range(start.size):
        out[at[k] : at[k] + length[k]] = data[start[k] : start[k] + length[k]]
