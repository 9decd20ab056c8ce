"""Blocks → a recording."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from vsalog.readers.base import Block, Reader, plural
from vsalog.readers.timing import YEAR_2000, Clock, Order, choose_clock, put_in_order
from vsalog.recording import Channel, Recording, Stamps, Stream, Values


@dataclass(slots=True)
class _Gathered:
    """The blocks of one stream."""

    type: str
    counts: list[int] = field(default_factory=list)
    clocks: dict[str, list[Stamps]] = field(default_factory=dict)
    columns: dict[str, dict[int, Values]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    timeless: str = ""

    def add(self, block: Block) -> None:
        number = len(self.counts)
        self.counts.append(len(next(iter(block.clocks.values()))))
        for kind, stamps in block.clocks.items():
            self.clocks.setdefault(kind, []).append(stamps)
        for name, values in block.columns.items():
            self.columns.setdefault(name, {})[number] = values
        for name, unit in block.units.items():
            self.units.setdefault(name, unit)
        self.timeless = block.timeless

    def joined_clocks(self) -> dict[str, Stamps]:
        """Return the clocks that every block has."""
        complete = (kind for kind, parts in self.clocks.items() if len(parts) == len(self.counts))
        return {kind: np.concatenate(self.clocks[kind]) for kind in complete}

    def take_column(self, name: str) -> Values:
        """Return a column over all blocks, NaN where a block has none of it, and forget its parts."""
        parts = self.columns.pop(name)
        missing = (np.full(count, np.nan) if i not in parts else parts[i] for i, count in enumerate(self.counts))
        return np.concatenate(list(missing))


def collect(path: Path, reader: Reader, wanted: Collection[str] | None, time: str) -> Recording:
    """Read a log's blocks into a recording.

    Parameters
    ----------
    path : Path
        Where the log is.
    reader : Reader
        It, opened.
    wanted : collection of str or None
        Channels to read and keep; None is all of them.
    time : str
        ``auto``, ``header``, ``log`` or ``publish``, see `vsalog.readers.read`.

    Raises
    ------
    ReadError
        The log cannot be read.
    """
    gathered: dict[str, _Gathered] = {}
    for block in reader.blocks(wanted):
        gathered.setdefault(block.stream, _Gathered(block.type)).add(block)
    channels: dict[str, Channel] = {}
    streams: dict[str, Stream] = {}
    notes = list(reader.notes)
    dates: list[bool] = []
    for name, one in gathered.items():
        text = [column for column in one.columns if column in reader.unread]
        for column in text:  # only the last block tells that a column holds no number at all
            del one.columns[column]
        stream, stamps = _stream(name, one, channels, time)
        streams[name] = stream
        notes += _remarks(stream)
        if len(stamps):
            dates.append(bool(stamps[0] >= YEAR_2000))
    return Recording(
        path=path,
        format=reader.format,
        channels=channels,
        streams=streams,
        unread={name: reason for name, reason in reader.unread.items() if name not in channels},
        rig_text=reader.rig_text,
        notes=tuple(dict.fromkeys(notes)),
        absolute_time=all(dates),
    )


def _stream(name: str, one: _Gathered, channels: dict[str, Channel], time: str) -> tuple[Stream, Stamps]:
    """Put a stream on its clock and in order; its channels go to `channels`."""
    clock = choose_clock(one.joined_clocks(), time)
    if clock.source == "none":
        clock = replace(clock, reason=one.timeless)
    columns = {column: one.take_column(column) for column in list(one.columns)}
    order = put_in_order(clock.stamps, list(columns.values()))
    stamps = clock.stamps if order.keep is None else clock.stamps[order.keep]
    for column in list(columns):
        values = columns.pop(column)
        channels[column] = Channel(
            name=column,
            stamps=stamps,
            values=values if order.keep is None else values[order.keep],
            unit=one.units.get(column),
            stream=name,
            type=one.type,
        )
    return _summary(name, one.type, len(stamps), clock, order), stamps


def _summary(name: str, kind: str, count: int, clock: Clock, order: Order) -> Stream:
    return Stream(
        name=name,
        type=kind,
        count=count,
        time_source=clock.source,
        time_reason=clock.reason,
        inversions=order.inversions,
        duplicates=order.duplicates,
        conflicts=order.conflicts,
        delay_median=clock.delay_median,
        delay_spread=clock.delay_spread,
    )


def _remarks(stream: Stream) -> list[str]:
    """Return in words what is odd about a stream's time."""
    remarks = []
    if stream.time_reason and stream.time_source != "none":
        advice = "" if stream.time_reason.startswith("it has no") else "; --time header insists on the stamps"
        remarks.append(f"{stream.name}: {stream.time_source} time is used, as {stream.time_reason}{advice}")
    if stream.inversions:
        remarks.append(
            f"{stream.name}: {plural(stream.inversions, 'sample')} came out of order and were sorted by time"
        )
    if stream.duplicates:
        remarks.append(f"{stream.name}: {plural(stream.duplicates, 'exact copy')} of samples dropped")
    if stream.conflicts:
        remarks.append(
            f"{stream.name}: {plural(stream.conflicts, 'sample')} with the stamp of another but other values dropped,"
            " the first of each was kept"
        )
    return remarks
