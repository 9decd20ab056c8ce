"""A log that is too long for memory: its columns lie in a temporary file, and stretches of them are looked at."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vsalog.core.recording import Channel, Recording
from vsalog.core.spool import Column, ColumnPart, Values, parts, row_of
from vsalog.readers.window import cut

# What the stretches of a log that are looked at take in memory, and how many there are of each stream.
LOOK_BYTES, STRETCHES = 64 * 2**20, 16
# A stretch has so many samples at least, where the stream has them.
SHORTEST = 1024


@dataclass(frozen=True, slots=True)
class LongChannel:
    """The samples of a channel, in order: int64 nanoseconds, and float64 values as recorded; shape (n,) each."""

    stamps: Column
    values: Column


@dataclass(frozen=True, slots=True)
class LongRecording:
    """A log whose samples are read piece by piece.

    Attributes
    ----------
    look : Recording
        All that a recording says of a log, but of each stream's samples only stretches, spread evenly from the first sample to
        the last.
    columns : mapping of str to LongChannel
        The samples of each channel, by its name.
    """

    look: Recording
    columns: Mapping[str, LongChannel]

    @classmethod
    def of(cls, outline: Recording, columns: Mapping[str, LongChannel]) -> LongRecording:
        """Look at a log.

        Parameters
        ----------
        outline : Recording
            With the log's channels; their samples do not matter.
        columns : mapping of str to LongChannel
            The samples; channels of one stream share their stamps.
        """
        width = 8 * max(1, len(columns) + len(outline.streams))
        rows = max(STRETCHES * SHORTEST, LOOK_BYTES // width)
        channels: dict[str, Channel] = {}
        for stream in outline.streams:
            own = {name: c for name, c in columns.items() if outline.channels[name].stream == stream}
            if not own:
                continue
            first = next(iter(own.values()))
            stretches = _stretches(len(first.stamps), rows)
            values = {name: _joined(c.values, stretches) for name, c in own.items()}
            for name in [name for name, seen in values.items() if not np.isfinite(seen).any()]:
                # Of a channel that is mostly empty, what there is has to be seen.
                begin = _first_number(own[name].values)
                if begin is not None:
                    end = min(len(first.stamps), begin + rows // STRETCHES)
                    stretches = _merged([*stretches, (begin, end)])
                    values = {other: _joined(c.values, stretches) for other, c in own.items()}
            stamps = _joined(first.stamps, stretches)
            channels |= {
                name: replace(outline.channels[name], stamps=stamps, values=seen) for name, seen in values.items()
            }
        order = {name: channels[name] for name in outline.channels if name in channels}
        return cls(replace(outline, channels=order), columns)

    @classmethod
    def of_short(cls, recording: Recording) -> LongRecording:
        """Take a recording in memory for a long one."""
        columns = {name: LongChannel(c.stamps, c.values) for name, c in recording.channels.items()}
        return cls(recording, columns)

    @property
    def path(self) -> Path:
        """Where the log is."""
        return self.look.path

    def cut(self, low: int, high: int, known: Collection[str] = ()) -> LongRecording:
        """Return what the log holds from one stamp to another; see `vsalog.readers.window.cut`.

        Raises
        ------
        ReadError
            Nothing lies there.
        """
        # What is said of channels and streams is said by those of their samples that are next to the edges.
        edges: dict[str, Channel] = {}
        kept: dict[str, LongChannel] = {}
        counts: dict[str, int] = {}
        shared: dict[int, tuple[int, int, Column]] = {}
        for name, column in self.columns.items():
            if id(column.stamps) not in shared:
                first, last = row_of(column.stamps, low), row_of(column.stamps, high + 1)
                shared[id(column.stamps)] = first, last, ColumnPart(column.stamps, first, last)
            first, last, stamps = shared[id(column.stamps)]
            size = len(column.stamps)
            rows = sorted({r for r in (0, first, last - 1, size - 1) if 0 <= r < size})
            at = np.concatenate([column.stamps[r : r + 1] for r in rows]) if rows else np.empty(0, np.int64)
            edges[name] = replace(self.look.channels[name], stamps=at, values=np.zeros(len(rows)))
            kept[name] = LongChannel(stamps, ColumnPart(column.values, first, last))
            counts[self.look.channels[name].stream] = last - first
        outline = cut(replace(self.look, channels=edges), low, high, known)
        streams = {name: replace(stream, count=counts[name]) for name, stream in outline.streams.items()}
        return LongRecording.of(replace(outline, streams=streams), {name: kept[name] for name in outline.channels})


def _stretches(count: int, rows: int) -> list[tuple[int, int]]:
    """Return first and last row, that one excluded, of stretches that have about so many rows in all."""
    if count <= rows:
        return [(0, count)]
    length = rows // STRETCHES
    return [(int(first), int(first) + length) for first in np.linspace(0, count - length, STRETCHES)]


def _merged(stretches: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return stretches in order, those that overlap as one."""
    merged: list[tuple[int, int]] = []
    for first, last in sorted(stretches):
        if merged and first <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(last, merged[-1][1])
        else:
            merged.append((first, last))
    return merged


def _joined(column: Column, stretches: list[tuple[int, int]]) -> Values:
    return np.concatenate([column[first:last] for first, last in stretches])


def _first_number(values: Column) -> int | None:
    """Return the first row that holds a finite number; None where none does."""
    for first, last in parts(len(values)):
        finite = np.isfinite(values[first:last])
        if finite.any():
            return first + int(np.argmax(finite))
    return None
