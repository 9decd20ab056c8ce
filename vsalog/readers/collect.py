"""Blocks → a recording."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.finding_texts import sentence
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.printable import plural
from vsalog.core.recording import Channel, Recording, Stamps, Stream, Values
from vsalog.readers.alternating import alternating
from vsalog.readers.base import Reader
from vsalog.readers.carried import part_stream
from vsalog.readers.compression import FILE_RATIO
from vsalog.readers.gathered import Gathered
from vsalog.readers.order import Order, in_order
from vsalog.readers.reach import BEYOND, Stamp, within_reach
from vsalog.readers.timing import Clock, choose_clock, of_stream, without


@dataclass(frozen=True, slots=True)
class Placed:
    """A stream on its clock and in order: what is known of it, its stamps, and its columns by name.

    Of `left_out` samples the header stamp is none; `late` is of `Order`.
    """

    stream: Stream
    stamps: Stamps
    columns: dict[str, Values]
    left_out: int
    late: float


def gather(path: Path, reader: Reader, wanted: Collection[str] | None, room: int | None = None) -> dict[str, Gathered]:
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
        Bytes of samples beyond which they go to temporary files; None keeps all in memory.

    Returns
    -------
    dict of str to Gathered
        By stream, without the columns that turned out to be text.

    Raises
    ------
    ReadError
        The log cannot be read, or holds far more samples than a log of its size can.
    """
    gathered: dict[str, Gathered] = {}
    in_file = False
    # An hour at rest is packed into next to nothing.
    size, most = 0, max(2 * AT_ONCE_BYTES, FILE_RATIO * _bytes_of(path))
    absurd = 0
    for block in reader.blocks(wanted):
        block, lost = within_reach(block)
        absurd += lost
        one = gathered.setdefault(block.stream, Gathered(block.type, in_file))
        size += one.growth(block)
        if size > most:
            raise ReadError(
                f"unfolds to more than {most // 2**20} MiB of samples, {FILE_RATIO} times its size, as no"
                " recording does; only some channels of it can be read, by their names",
                path,
            )
        if room is not None and not in_file and size > room:
            in_file = True
            for each in gathered.values():
                each.to_file()
        one.add(block)
    if not any(one.count for one in gathered.values()):
        if absurd:
            raise ReadError(f"the times of all samples {BEYOND}", path)
        if timeless := [one for one in reader.findings if one.code == "clock.rows_without_time"]:
            raise ReadError(
                f"its time column holds no time that can be read, or none within 292 years of 1970: {sentence(timeless[0])}",
                path,
            )
    if absurd:
        reader.findings.append(Finding(code="clock.beyond_reach", value=absurd))
    for one in gathered.values():
        for column in [column for column in one.columns if column in reader.unread]:
            del one.columns[column]  # only the last block tells that a column holds no number at all
    return _apart(gathered)


def _apart(gathered: dict[str, Gathered]) -> dict[str, Gathered]:
    """Make streams of their own of what comes in messages of its own."""
    found: dict[str, Gathered] = {}
    for stream in list(gathered):
        one = gathered.pop(stream)
        parts = one.parts()
        if len(parts) == 1 and parts[0].bits is None:
            found[stream] = one
            continue
        for part in parts:
            found[part_stream(stream, part)] = one.take_part(part)
    return found


def collect(
    path: Path, reader: Reader, wanted: Collection[str] | None, time: str, room: int | None = None
) -> Recording:
    """Read a log's blocks into a recording; parameters and errors as for `gather`.

    Parameters
    ----------
    time : str
        ``auto``, ``header``, ``log`` or ``publish``, see `vsalog.readers.read`.
    """
    gathered = gather(path, reader, wanted, room)
    channels: dict[str, Channel] = {}
    streams: dict[str, Stream] = {}
    findings = Findings(reader.findings)
    dates: list[bool] = []
    for name, one in gathered.items():
        placed = _placed(name, one, time)
        streams[name] = placed.stream
        findings.add(*clock_findings(placed), *alternating(name, placed.columns))
        if len(placed.stamps):
            dates.append(bool(placed.stamps[0] >= Stamp.YEAR_2000))
        if placed.stream.time_source == "column" and placed.stream.conflicts > placed.stream.count:
            # What is left would look like a log of few samples, far apart.
            reader.unread.update(dict.fromkeys(placed.columns, _coarse(placed.stream)))
            continue
        for column, values in placed.columns.items():
            channels[column] = Channel(column, placed.stamps, values, one.units.get(column), name, one.type)
    return Recording(
        path=path,
        format=reader.format,
        channels=channels,
        streams=streams,
        unread={name: reason for name, reason in reader.unread.items() if name not in channels},
        rig_text=reader.rig_text,
        findings=tuple(findings),
        absolute_time=all(dates),
    )


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
    clock = choose_clock(one.joined_clocks(), time)
    if clock.source == "none":
        clock = replace(clock, reason=one.timeless)
    columns = {column: without(clock.bad, one.take_column(column)) for column in list(one.columns)}
    stamps, columns, order = in_order(clock.stamps, columns)
    return Placed(summary(name, one.type, len(stamps), clock, order), stamps, columns, clock.bad.size, order.late)


def summary(name: str, kind: str, count: int, clock: Clock, order: Order) -> Stream:
    """Return what is known of a stream."""
    return Stream(
        name=name,
        type=kind,
        count=count,
        time_source=clock.source,
        time_finding=of_stream(clock.reason, name, clock.source),
        inversions=order.inversions,
        duplicates=order.duplicates,
        conflicts=order.conflicts,
        delay_median=clock.delay_median,
        delay_spread=clock.delay_spread,
    )


def clock_findings(placed: Placed) -> list[Finding]:
    """Return what is odd about a stream's time."""
    stream = placed.stream
    found = [] if stream.time_finding is None or stream.time_source == "none" else [stream.time_finding]
    own_clock = stream.time_source == "column"
    counts = (
        Finding(code="clock.out_of_order", part=stream.name, value=stream.inversions),
        Finding(code="recording.copies_dropped", part=stream.name, value=stream.duplicates),
        Finding(code="recording.conflicts_dropped", part=stream.name, value=stream.conflicts),
        Finding(
            code="clock.times_left_out" if own_clock else "clock.stamps_left_out",
            part=stream.name,
            value=placed.left_out,
        ),
        Finding(code="recording.held_in_memory", part=stream.name, value=placed.late, unit="s"),
    )
    return [*found, *(one for one in counts if one.value)]
