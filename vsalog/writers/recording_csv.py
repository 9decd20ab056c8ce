"""Recordings as CSV tables, the units in the header."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from vsalog.core.recording import Channel, Recording, Stamps
from vsalog.writers.atomic import atomic_path


def write_csv(recording: Recording, path: Path | str, time: Literal["s", "ns"] = "ns") -> None:
    """Write a recording as one table: a time column, then a column per channel, ``name [unit]``.

    Numbers are written with as many digits as it takes to read the same number back. Channels on different clocks share
    the table: every stamp of any of them has a row, and a cell is empty where a channel has no sample.

    Parameters
    ----------
    recording : any
    path : appears when all is written; replaced when it is there
    time : ``ns`` writes the stamps as whole nanoseconds, ``s`` seconds from the first stamp, with nine decimals

    Raises
    ------
    WriteError
        The file cannot be written.
    """
    channels = list(recording.channels.values())
    stamps = all_stamps(channels)
    columns = [_time_column(stamps, time), *(_column(channel, stamps) for channel in channels)]
    header = [f"time [{time}]", *(_heading(channel) for channel in channels)]
    # Names by position, since a table's names must not repeat and are not written.
    table = pa.Table.from_arrays(columns, names=[str(i) for i in range(len(columns))])
    options = pa_csv.WriteOptions(include_header=False, quoting_style="none")
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        file.write((",".join(map(_quoted, header)) + "\n").encode())
        pa_csv.write_csv(table, file, options)


def all_stamps(channels: list[Channel]) -> Stamps:
    """Return every stamp of any channel, in order; the very array of a clock that all share."""
    distinct = {id(channel.stamps): channel.stamps for channel in channels}
    if not distinct:
        return np.zeros(0, dtype=np.int64)
    # np.unique sorts; one clock is sorted already.
    return next(iter(distinct.values())) if len(distinct) == 1 else np.unique(np.concatenate(list(distinct.values())))


def _time_column(stamps: Stamps, time: Literal["s", "ns"]) -> pa.Array[Any]:
    if time == "ns":
        return pa.array(stamps)
    since = stamps - stamps[0] if stamps.size else stamps
    # Decimal by integer arithmetic: exact, whatever the length of the log.
    return pa.array([f"{ns // 10**9}.{ns % 10**9:09d}" for ns in since.tolist()], pa.string())


def _column(channel: Channel, stamps: Stamps) -> pa.Array[Any]:
    if channel.stamps is stamps:
        return pa.array(channel.values)
    rows = np.searchsorted(stamps, channel.stamps)
    values = np.full(stamps.shape, np.nan)
    empty = np.ones(stamps.shape, dtype=np.bool_)
    values[rows], empty[rows] = channel.values, False
    column: pa.Array[Any] = pa.array(values, mask=empty)
    return column


def _heading(channel: Channel) -> str:
    return f"{channel.name} [{channel.unit}]" if channel.unit else channel.name


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n\r') else text
