"""The first samples of a log, as data and on a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from vsalog.core.printable import printable
from vsalog.core.recording import Recording
from vsalog.report.console import fits
from vsalog.report.inspect_text import headed


class HeadReport(Struct, frozen=True):
    """The first samples of a stream.

    Attributes
    ----------
    stream : its name
    stamps : [ns]; the numbers of the rows where the stream has no time
    channels : their names
    rows : of each sample a value per channel, in its unit; None for one that is no finite number
    """

    stream: str
    stamps: tuple[int, ...]
    channels: tuple[str, ...]
    rows: tuple[tuple[float | None, ...], ...]


def heads_of(recording: Recording, count: int) -> Iterator[HeadReport]:
    """Yield the first `count` samples of each stream."""
    for name in recording.streams:
        channels = [channel for channel in recording.channels.values() if channel.stream == name]
        if not channels:
            continue
        stamps = channels[0].stamps[:count].tolist()
        columns = [[v if abs(v) < float("inf") else None for v in c.values[:count].tolist()] for c in channels]
        yield HeadReport(name, tuple(stamps), tuple(c.name for c in channels), tuple(zip(*columns, strict=True)))


def head_parts(head: HeadReport, begin: int | None, console: Console) -> Iterator[RenderableType]:
    """Yield what to print of a stream's first samples.

    Parameters
    ----------
    head : these
    begin : stamp that times count from [ns]; None where the stream has row numbers
    console : as wide as this is
    """
    times = [str(s) if begin is None else f"{(s - begin) / 1e9:.6f}" for s in head.stamps]
    unit = "row" if begin is None else "time [s]"
    yield headed(head.stream, "bold cyan", f"the first {len(times)} as read")
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    table.add_column(f"  {unit}", no_wrap=True)
    for name in head.channels:
        table.add_column(Text(printable(name)), no_wrap=True, justify="right")
    for time, row in zip(times, head.rows, strict=True):
        table.add_row(f"  {time}", *map(_cell, row))
    if fits(table, console):
        yield table
        return
    for time, row in zip(times, head.rows, strict=True):
        yield Text(f"  {unit} {time}", style="dim")
        for name, value in zip(head.channels, row, strict=True):
            yield Text(f"    {printable(name)}  {_cell(value)}", overflow="fold")


def _cell(value: float | None) -> str:
    return "–" if value is None else repr(value)
