"""A log as read: named channels, each with its own time stamps and unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import is_mapped
from vsalog.core.errors import BindingError, did_you_mean
from vsalog.core.finding import Finding
from vsalog.core.finding_texts import sentence
from vsalog.core.printable import command, plural, printable

Stamps = NDArray[np.int64]
Values = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Channel:
    """One numeric column of a recording on the clock of its stream.

    Attributes
    ----------
    name : str
        Full name, ``topic.field`` or a table's column, e.g. ``/joint_states.position[elbow_motor]``.
    stamps : int64 array, shape (n,)
        Strictly increasing nanoseconds; channels of one stream share one array. Since the epoch, or since the start
        where the log has only relative time (see `Recording.absolute_time`).
    values : float64 array, shape (n,)
        In `unit`, as recorded; NaN where the log has none.
    unit : str or None
        As the log states it; None where it states none.
    stream : str
        The topic, table or struct the channel belongs to.
    type : str
        Message type, or the column's type.
    """

    name: str
    stamps: Stamps
    values: Values
    unit: str | None
    stream: str
    type: str


@dataclass(frozen=True, slots=True)
class Stream:
    """One topic, table or struct: its rate, its clock, and its faults.

    Attributes
    ----------
    name, type : str
        Topic and message type, or the table's name and format.
    count : int
        Samples kept.
    time_source : str
        ``header``, ``log``, ``publish``, ``column`` or ``rate``: where the stamps come from.
    time_finding : Finding or None
        Why that source, when it was not the first choice.
    inversions, duplicates, conflicts : int
        Samples that came out of order, exact duplicates dropped, equal stamps with different values dropped.
    delay_median, delay_spread : float
        Log time minus stamp [s], median and 5–95 % spread; NaN where the log has one clock only.
    """

    name: str
    type: str
    count: int
    time_source: str
    time_finding: Finding | None = None
    inversions: int = 0
    duplicates: int = 0
    conflicts: int = 0
    delay_median: float = float("nan")
    delay_spread: float = float("nan")


@dataclass(frozen=True, slots=True, repr=False)
class Recording:
    """A log: the requested channels, and the findings about it.

    Attributes
    ----------
    path : Path
        The file or folder it came from.
    format : str
        ``mcap``, ``rosbag1``, ``rosbag2-sqlite3``, ``rosbag2-mcap``, ``csv``, ``parquet`` or ``matlab``.
    channels : mapping of str to Channel
        By full name, in the log's order.
    streams : mapping of str to Stream
        By name.
    unread : mapping of str to str
        Fields that are no signal, with the reason: ``text``, ``array of 921600 values``, an undecodable type …
    rig_text : str or None
        The rig the log carries (MCAP metadata record ``vsalog.rig``), as TOML.
    findings : tuple of Finding
        Findings of the reader: salvage counts, clocks, skipped lines.
    absolute_time : bool
        Whether stamps count from the epoch.
    """

    path: Path
    format: str
    channels: Mapping[str, Channel]
    streams: Mapping[str, Stream]
    unread: Mapping[str, str] = field(default_factory=dict)
    rig_text: str | None = None
    findings: tuple[Finding, ...] = ()
    absolute_time: bool = True

    def __repr__(self) -> str:
        about = f"{self.format}, {plural(len(self.channels), 'channel')}"
        return f"<vsalog Recording: {printable(self.path.name)}, {about}>"

    @property
    def notes(self) -> tuple[str, ...]:
        """The findings, in sentences."""
        return tuple(map(sentence, self.findings))

    @property
    def in_file(self) -> bool:
        """Whether it is too long for memory, and samples are in memory-mapped files."""
        return any(is_mapped(channel.values) for channel in self.channels.values())

    def channel(self, name: str) -> Channel:
        """Return the channel of that name.

        Raises
        ------
        BindingError
            The log has no such channel, or it is no signal; the nearest names are suggested.
        """
        found = self.channels.get(name)
        if found is not None:
            return found
        if name in self.unread:
            raise BindingError(f"{self.path.name}: channel '{name}' is no signal: {self.unread[name]}")
        hint = did_you_mean(name, self.channels)
        raise BindingError(
            f"{self.path.name}: there is no channel '{name}'{hint or '.'}"
            f" ('{command('inspect', self.path)}' lists all {len(self.channels)})"
        )
