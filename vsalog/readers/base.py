"""The interface of every reader, and the structures it returns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from vsalog.core.finding import Finding, Findings
from vsalog.core.recording import Stamps, Values

DOUBTFUL = frozenset(
    (
        "compressed.bad_checksum",
        "compressed.damaged",
        "compressed.rows_left_out",
        "compressed.rows_doubtful",
    )
)
"""Codes of damage of which there may be many, so that it is reported before the numbers."""

CLOCKS = ("header", "log", "publish", "column", "rate", "none")
"""Kinds of time stamps, best first."""


@dataclass(frozen=True, slots=True)
class ChannelInfo:
    """The properties of a channel that are known before its values are read.

    Attributes
    ----------
    stream : str
        Topic, table or struct it belongs to.
    type : str
        Message type, or the column's type.
    unit : str or None
        As the log states it.
    """

    stream: str
    type: str
    unit: str | None = None


@dataclass(frozen=True, slots=True)
class Catalogue:
    """The contents of a log, from its head and its definitions without decoding everything.

    Attributes
    ----------
    channels : mapping of str to ChannelInfo
        By full name, in the log's order.
    unread : mapping of str to str
        Fields that are no signal, with the reason.
    """

    channels: Mapping[str, ChannelInfo]
    unread: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of one stream, in the order of the log.

    Attributes
    ----------
    stream, type : str
        Name of the stream and its message type.
    clocks : mapping of str to int64 array, shape (n,)
        Nanoseconds by kind of clock (one of `CLOCKS`), each where the format has it.
    columns : mapping of str to float64 array, shape (n,)
        By channel name, NaN where a sample has no such value (`vsalog.core.column.ABSENT` where a message lacks it).
    units : mapping of str to str
        Units of the columns that state one.
    timeless : Finding or None
        The reason if there is no clock, where it is worth reporting.
    expected : int
        Samples of the stream in all according to the log, which may be wrong; 0 where it does not state them.
    whole : bool
        Each message surely contains every one of the columns.
    """

    stream: str
    type: str
    clocks: Mapping[str, Stamps]
    columns: Mapping[str, Values]
    units: Mapping[str, str] = field(default_factory=dict)
    timeless: Finding | None = None
    expected: int = 0
    whole: bool = False


class Reader(Protocol):
    """A log that is read from the start, block by block.

    Attributes
    ----------
    format : str
        ``mcap``, ``rosbag1``, ``rosbag2-sqlite3``, ``rosbag2-mcap``, ``csv``, ``parquet`` or ``matlab``.
    rig_text : str or None
        The rig the log carries, as TOML; known at once.
    findings : Findings
        Salvage counts and the like; complete once the blocks are read.
    unread : dict of str to str
        Fields that are no signal, with the reason; complete once the blocks are read.
    """

    format: str
    findings: Findings
    unread: dict[str, str]

    @property
    def rig_text(self) -> str | None: ...  # noqa: D102

    def catalogue(self) -> Catalogue:
        """Return the contents of the log, without decoding all of it.

        Raises
        ------
        ReadError
            The log cannot be read.
        """
        ...

    def heads(self) -> Iterator[Block]:
        """Yield the first samples of each stream; of one that begins late perhaps none.

        Raises
        ------
        ReadError
            The log cannot be read.
        """
        ...

    def blocks(self, wanted: Collection[str] | None) -> Iterator[Block]:
        """Yield the log's blocks, each with those of its channels that are in `wanted` (None: all of them).

        Raises
        ------
        ReadError
            The log cannot be read.
        """
        ...


def first_of_each(blocks: Iterator[Block]) -> Iterator[Block]:
    """Yield blocks until one of a stream comes again."""
    seen: set[str] = set()
    for block in blocks:
        if block.stream in seen:
            return
        seen.add(block.stream)
        yield block
