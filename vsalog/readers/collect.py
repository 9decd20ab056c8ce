"""Blocks → a recording."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.errors import ReadError
from vsalog.readers.alternating import alternating_note
from vsalog.readers.base import NO_TIME, Block, Reader, plural
from vsalog.readers.reach import BEYOND, within_reach
from vsalog.readers.spool import Column, Kind, Spool, SpooledColumn, in_memory, parts
from vsalog.readers.timing import ASKED_FOR, YEAR_2000, Clock, Order, choose_clock, put_in_order
from vsalog.recording import Channel, Recording, Stream

# Beyond so many bytes of samples, a log that grows so many times is a bomb.
FREE_BYTES, MOST_TIMES = 256 * 2**20, 60

# So many samples are made room for at once where a log promises them; the room is no memory before it is filled.
_MOST_ROOM, _PIECE = 2**22, 2**13

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
        """Put a block's values in place; what blocks before it had not is NaN."""
        end = at + len(new)
        if end > self.values.size:
            smaller, self.values = self.values, np.zeros(max(end, 2 * self.values.size), dtype=self.values.dtype)
            for begin in range(0, self.filled, _PIECE):
                self._put(begin, smaller[begin : min(begin + _PIECE, self.filled)])
        if self.filled < at:
            self.values[self.filled : at] = np.nan
        self._put(at, new)
        self.filled, self.blocks = end, self.blocks + 1

    def whole(self, count: int) -> NDArray[T]:
        """Return all values, NaN at the end where the last blocks had none."""
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

    Columns are arrays, or lie in `spool` where there is one.
    """

    type: str
    spool: Spool | None = None
    count: int = 0
    blocks: int = 0
    clocks: dict[str, _Column[np.int64] | SpooledColumn] = field(default_factory=dict)
    columns: dict[str, _Column[np.float64] | SpooledColumn] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    timeless: str = ""
    alike: int = 0

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


@dataclass(frozen=True, slots=True)
class Placed:
    """A stream on its clock and in order: what is known of it, its stamps, and its columns by name.

    Of `left_out` samples the header stamp is none.
    """

    stream: Stream
    stamps: Column
    columns: dict[str, Column]
    left_out: int


def gather(
    path: Path, reader: Reader, wanted: Collection[str] | None, room: int | None = None
) -> tuple[dict[str, Gathered], Spool | None]:
    """Read a log's blocks, stream by stream.

    Parameters
    ----------
    path : Path
        Where the log is.
    reader : Reader
        It, opened.
    wanted : collection of str or None
        Channels to read and keep; None is all of them.
    room : int or None
        Bytes of samples beyond which they go to a temporary file; None keeps all in memory.

    Returns
    -------
    gathered : dict of str to Gathered
        By stream, without the columns that turned out to be text.
    spool : Spool or None
        The file they are in, where they went to one.

    Raises
    ------
    ReadError
        The log cannot be read, or holds far more samples than a log of its size can.
    """
    gathered: dict[str, Gathered] = {}
    spool: Spool | None = None
    size, most = 0, max(FREE_BYTES, MOST_TIMES * _bytes_of(path))
    absurd = 0
    for block in reader.blocks(wanted):
        block, lost = within_reach(block)
        absurd += lost
        one = gathered.setdefault(block.stream, Gathered(block.type, spool))
        size += one.growth(block)
        if size > most:
            raise ReadError(
                f"{path}: unfolds to more than {most // 2**20} MiB of samples, {MOST_TIMES} times its size, as no"
                " recording does; only some channels of it can be read, by their names"
            )
        if room is not None and spool is None and size > room:
            spool = Spool()
            for each in gathered.values():
                each.to_disk(spool)
        one.add(block)
    if not any(one.count for one in gathered.values()):
        if absurd:
            raise ReadError(f"{path}: the times of all samples {BEYOND}")
        if timeless := [note for note in reader.notes if note.endswith(NO_TIME)]:
            raise ReadError(
                f"{path}: its time column holds no time that can be read, or none within 292 years of 1970: {timeless[0]}"
            )
    if absurd:
        reader.notes.append(f"{plural(absurd, 'sample')} left out whose times {BEYOND}")
    for one in gathered.values():
        for column in [column for column in one.columns if column in reader.unread]:
            del one.columns[column]  # only the last block tells that a column holds no number at all
    return gathered, spool


def collect(path: Path, reader: Reader, wanted: Collection[str] | None, time: str) -> Recording:
    """Read a log's blocks into a recording; parameters and errors as for `gather`.

    Parameters
    ----------
    time : str
        ``auto``, ``header``, ``log`` or ``publish``, see `vsalog.readers.read`.
    """
    return recording_of(path, reader, gather(path, reader, wanted)[0], time)


def recording_of(path: Path, reader: Reader, gathered: Mapping[str, Gathered], time: str) -> Recording:
    """Put gathered streams, in memory, on their clocks and in order."""
    outline, samples = assembled(path, reader, gathered, partial(_placed, time=time))
    filled = {
        name: replace(outline.channels[name], stamps=in_memory(stamps), values=in_memory(values))
        for name, (stamps, values) in samples.items()
    }
    return replace(outline, channels=filled)


def assembled(
    path: Path, reader: Reader, gathered: Mapping[str, Gathered], place: Callable[[str, Gathered], Placed]
) -> tuple[Recording, dict[str, tuple[Column, Column]]]:
    """Make a recording of gathered streams.

    Parameters
    ----------
    path, reader, gathered : as `gather` has them
    place : function
        Puts a stream, by its name, on its clock and in order.

    Returns
    -------
    outline : Recording
        Without samples.
    samples : dict of str to (Column, Column)
        Stamps and values of its channels.
    """
    channels: dict[str, Channel] = {}
    samples: dict[str, tuple[Column, Column]] = {}
    streams: dict[str, Stream] = {}
    notes = list(reader.notes)
    dates: list[bool] = []
    for name, one in gathered.items():
        placed = place(name, one)
        streams[name] = placed.stream
        notes += remarks(placed.stream)
        if note := alternating_note(name, placed.columns):
            notes.append(note)
        if placed.left_out:
            notes.append(
                f"{name}: {plural(placed.left_out, 'sample')} left out whose header"
                f" {'stamp is' if placed.left_out == 1 else 'stamps are'} missing, zero, impossible or far from those around;"
                " --time log keeps all samples"
            )
        if len(placed.stamps):
            dates.append(bool(placed.stamps[:1][0] >= YEAR_2000))
        if placed.stream.time_source == "column" and placed.stream.conflicts > placed.stream.count:
            # What is left would look like a log of few samples, far apart.
            reader.unread.update(dict.fromkeys(placed.columns, _coarse(placed.stream)))
            continue
        for column, values in placed.columns.items():
            none = np.empty(0, np.int64), np.empty(0)
            channels[column] = Channel(column, *none, one.units.get(column), name, one.type)
            samples[column] = placed.stamps, values
    outline = Recording(
        path=path,
        format=reader.format,
        channels=channels,
        streams=streams,
        unread={name: reason for name, reason in reader.unread.items() if name not in channels},
        rig_text=reader.rig_text,
        notes=tuple(dict.fromkeys(notes)),
        absolute_time=all(dates),
    )
    return outline, samples


def _coarse(stream: Stream) -> str:
    """Say why a clock cannot be used that most samples share their stamp with others on."""
    rows = stream.count + stream.conflicts + stream.duplicates
    return (
        f"its times are no clock: {plural(stream.count, 'stamp')} for {plural(rows, 'row')}, as when seconds since 1970 are"
        " rounded to 32 bits or a few digits; write the time with all its digits, or leave the column out and give --rate"
    )


def _bytes_of(path: Path) -> int:
    """Return how large a file is, or the files of a folder are; 0 for what is no file."""
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _placed(name: str, one: Gathered, time: str) -> Placed:
    """Put a stream on its clock and in order."""
    clock = choose_clock({kind: in_memory(stamps) for kind, stamps in one.joined_clocks().items()}, time)
    if clock.source == "none":
        clock = replace(clock, reason=one.timeless)
    columns = {column: in_memory(one.take_column(column)) for column in list(one.columns)}
    left_out = 0
    if clock.bad is not None:
        left_out = int(np.count_nonzero(clock.bad))
        for column in columns:
            columns[column] = columns[column][~clock.bad]
    order = put_in_order(clock.stamps, list(columns.values()))
    stamps = order.kept(clock.stamps)
    # Taken one by one, so that there are not two of each at once.
    kept: dict[str, Column] = {column: order.kept(columns.pop(column)) for column in list(columns)}
    return Placed(summary(name, one.type, len(stamps), clock, order), stamps, kept, left_out)


def summary(name: str, kind: str, count: int, clock: Clock, order: Order) -> Stream:
    """Return what is known of a stream."""
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


def remarks(stream: Stream) -> list[str]:
    """Return in words what is odd about a stream's time."""
    remarks = []
    if stream.time_reason and stream.time_source != "none":
        plain = stream.time_reason.startswith(("it has no", ASKED_FOR))
        advice = "" if plain else "; --time header insists on the stamps"
        remarks.append(f"{stream.name}: {stream.time_source} time is used, as {stream.time_reason}{advice}")
    if stream.inversions:
        remarks.append(
            f"{stream.name}: {plural(stream.inversions, 'sample')} came out of order and"
            f" {'was' if stream.inversions == 1 else 'were'} sorted by time"
        )
    if stream.duplicates:
        remarks.append(f"{stream.name}: {plural(stream.duplicates, 'exact copy')} of samples dropped")
    if stream.conflicts:
        remarks.append(
            f"{stream.name}: {plural(stream.conflicts, 'sample')} with the stamp of another but other values dropped,"
            " the first of each was kept"
        )
    return remarks
