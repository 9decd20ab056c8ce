"""Blocks → a recording."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.finding_texts import sentence
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.core.printable import plural
from vsalog.core.progress import Advanced, tell
from vsalog.core.recording import Channel, Recording, Stamps, Stream, Values
from vsalog.readers.base import Reader
from vsalog.readers.compression import FILE_RATIO
from vsalog.readers.reach import BEYOND, Stamp, within_reach
from vsalog.readers.sample_order import in_order
from vsalog.readers.stream_clock import choose_clock, delay_of
from vsalog.readers.stream_samples import Gathered, Samples
from vsalog.readers.values_by_turns import alternating


def _gather(path: Path, reader: Reader, wanted: Collection[str] | None, room: int | None) -> dict[str, Gathered]:
    """Read a log's blocks, stream by stream, without the columns that turned out to be text; parameters as for `collect`.

    Raises
    ------
    ReadError
        The log cannot be read, or contains far more samples than a log of its size can.
    """
    gathered: dict[str, Gathered] = {}
    in_file = False
    # An hour at rest compresses to almost nothing.
    size, most = 0, max(2 * AT_ONCE_BYTES, FILE_RATIO * _bytes_of(path))
    absurd = told = seen = 0
    for block in reader.blocks(wanted):
        block, lost = within_reach(block)
        absurd += lost
        one = gathered.setdefault(block.stream, Gathered(block.type, in_file))
        growth = one.growth(block)
        size += growth
        if size > most:
            raise ReadError(
                f"unfolds to more than {most // 2**20} MiB of samples, {FILE_RATIO} times its size, as no"
                " recording does; only some channels of it can be read, by their names",
                path,
            )
        rows = len(next(iter(block.clocks.values())))
        promised = growth // max(rows, 1) * block.expected if not one.count else 0
        if room is not None and not in_file and max(size, promised) > room:
            in_file = True
            for each in gathered.values():
                each.to_file()
        told += 0 if one.count else block.expected
        one.add(block)
        seen += rows
        if told:
            tell(Advanced("reading", min(seen / told, 1.0)))
    if not any(one.count for one in gathered.values()):
        if absurd:
            raise ReadError(f"the times of all samples {BEYOND}", path)
        if timeless := [one for one in reader.findings if one.code == "clock.rows_without_time"]:
            raise ReadError(
                f"its time column contains no readable time, or none within 292 years of 1970: {sentence(timeless[0])}",
                path,
            )
    if absurd:
        reader.findings.append(Finding(code="clock.beyond_reach", value=absurd))
    for one in gathered.values():
        for column in [column for column in one.columns if column in reader.unread]:
            del one.columns[column]  # only after the last block it is known that a column contains no number
    return gathered


def collect(
    path: Path, reader: Reader, wanted: Collection[str] | None, time: str, room: int | None = None
) -> Recording:
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
    room : int or None
        Bytes of samples beyond which they go to temporary files; None keeps all in memory.

    Raises
    ------
    ReadError
        The log cannot be read, or contains far more samples than a log of its size can.
    """
    gathered = _gather(path, reader, wanted, room)
    channels: dict[str, Channel] = {}
    streams: dict[str, Stream] = {}
    findings = Findings(reader.findings)
    dates: list[bool] = []
    for topic in list(gathered):
        for name, samples in gathered.pop(topic).streams(topic):
            stream, stamps, columns, found = _placed(name, samples, time)
            streams[name] = stream
            findings.add(*found, *alternating(name, columns))
            if len(stamps):
                dates.append(bool(stamps[0] >= Stamp.YEAR_2000))
            if stream.time_source == "column" and stream.conflicts > stream.count:
                # The rest would look like a log of few samples, far apart.
                reader.unread.update(dict.fromkeys(columns, _coarse(stream)))
                continue
            for column, values in columns.items():
                channels[column] = Channel(column, stamps, values, samples.units.get(column), name, samples.type)
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
    """Refuse a clock on which most samples share their stamp with others."""
    rows = stream.count + stream.conflicts + stream.duplicates
    return (
        f"its times are no clock: {plural(stream.count, 'stamp')} for {plural(rows, 'row')}, as when seconds since 1970 are"
        " rounded to 32 bits or a few digits; write the time with all its digits, or leave the column out and give --rate"
    )


def _bytes_of(path: Path) -> int:
    """Return how large a file is, or the files of a folder are; 0 for what is no file."""
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _placed(name: str, samples: Samples, time: str) -> tuple[Stream, Stamps, dict[str, Values], list[Finding]]:
    """Put a stream on its clock and in order: its properties, its stamps, its columns, and the findings about its time."""
    clock = choose_clock(samples.clocks, time)
    reason = samples.timeless if clock.source == "none" else clock.reason_for(name)
    samples = samples.without(clock.off)
    delay_median, delay_spread = delay_of(samples.clocks, clock.source)
    stamps, columns, order = in_order(samples.clocks[clock.source], samples.columns)
    stream = Stream(
        name=name,
        type=samples.type,
        count=len(stamps),
        time_source=clock.source,
        time_finding=reason,
        inversions=order.inversions,
        duplicates=order.duplicates,
        conflicts=order.conflicts,
        delay_median=delay_median,
        delay_spread=delay_spread,
    )
    left_out = "clock.times_left_out" if clock.source == "column" else "clock.stamps_left_out"
    counts = (
        Finding(code="clock.out_of_order", part=name, value=order.inversions),
        Finding(code="recording.copies_dropped", part=name, value=order.duplicates),
        Finding(code="recording.conflicts_dropped", part=name, value=order.conflicts),
        Finding(code=left_out, part=name, value=clock.off.size),
        Finding(code="recording.held_in_memory", part=name, value=order.late, unit="s"),
    )
    found = [] if reason is None or clock.source == "none" else [reason]
    return stream, stamps, columns, [*found, *(one for one in counts if one.value)]
