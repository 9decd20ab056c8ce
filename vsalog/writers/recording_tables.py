"""Recordings as tables: CSV with the units in the header, Parquet with the units in the fields' metadata."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from vsalog.core.column import PART
from vsalog.core.errors import WriteError
from vsalog.core.recording import Channel, Recording, Stamps
from vsalog.core.units import split_header
from vsalog.writers.atomic import atomic_path

STAMP = "stamp"
RIG_KEY = "vsalog.rig"


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
    stamps = _all_stamps(channels)
    columns = [_time_column(stamps, time), *(_column(channel, stamps) for channel in channels)]
    header = [f"time [{time}]", *(_heading(channel) for channel in channels)]
    # Names by position, since a table's names must not repeat and are not written.
    table = pa.Table.from_arrays(columns, names=[str(i) for i in range(len(columns))])
    options = pa_csv.WriteOptions(include_header=False, quoting_style="none")
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        file.write((",".join(map(_quoted, header)) + "\n").encode())
        pa_csv.write_csv(table, file, options)


def write_parquet(recording: Recording, path: Path | str, rig_text: str | None = None) -> None:
    """Write a recording as one table: the stamps as whole nanoseconds, then a column per channel.

    A field's metadata contain its ``unit`` and its ``stream``. Streams on different clocks share the table: every
    stamp of any of them has a row, and a cell is null where a channel has no sample.

    Parameters
    ----------
    recording : any
    path : appears when all is written; replaced when it is there
    rig_text : the rig as TOML, kept in the schema's metadata as ``vsalog.rig``; the recording's own when absent

    Raises
    ------
    WriteError
        The file cannot be written, or a channel's name cannot be a column's.
    """
    channels = list(recording.channels.values())
    stamps = _all_stamps(channels)
    fields = [pa.field(STAMP, pa.int64(), nullable=False, metadata={"unit": "ns"}), *map(_field, channels)]
    text = rig_text or recording.rig_text
    schema = pa.schema(fields, metadata=None if text is None else {RIG_KEY: text})
    table = pa.Table.from_arrays([pa.array(stamps), *(_column(channel, stamps) for channel in channels)], schema=schema)
    # Numbers that hardly ever repeat gain nothing from a dictionary.
    encodings = {f.name: "BYTE_STREAM_SPLIT" for f in fields[1:]} | {STAMP: "DELTA_BINARY_PACKED"}
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        pq.write_table(
            table,
            file,
            row_group_size=PART,
            compression="zstd",
            use_dictionary=False,
            column_encoding=encodings,
            write_page_checksum=True,
        )


def _all_stamps(channels: list[Channel]) -> Stamps:
    """Return every stamp of any channel, in order; without a copy where all share a clock."""
    distinct = {id(channel.stamps): channel.stamps for channel in channels}
    if not distinct:
        return np.zeros(0, dtype=np.int64)
    # np.unique sorts; one clock is sorted already.
    return next(iter(distinct.values())) if len(distinct) == 1 else np.unique(np.concatenate(list(distinct.values())))


def _column(channel: Channel, stamps: Stamps) -> pa.Array[Any]:
    """Return a channel's values [its unit] as a column of a table with a row for each stamp, null where it has no sample."""
    if channel.stamps is stamps:
        return pa.array(channel.values)
    rows = np.searchsorted(stamps, channel.stamps)
    values, empty = np.zeros(stamps.shape), np.ones(stamps.shape, dtype=np.bool_)
    values[rows], empty[rows] = channel.values, False
    column: pa.Array[Any] = pa.array(values, mask=empty)
    return column


def _time_column(stamps: Stamps, time: Literal["s", "ns"]) -> pa.Array[Any]:
    if time == "ns":
        return pa.array(stamps)
    since = stamps - stamps[0] if stamps.size else stamps
    # Decimal by integer arithmetic: exact, whatever the length of the log.
    return pa.array([f"{ns // 10**9}.{ns % 10**9:09d}" for ns in since.tolist()], pa.string())


def _heading(channel: Channel) -> str:
    return f"{channel.name} [{channel.unit}]" if channel.unit else channel.name


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n\r') else text


def _field(channel: Channel) -> pa.Field:
    name = channel.name
    if split_header(name) != (name, None):
        # A reader would read the end of such a name as a unit; with the unit after it, it reads that one.
        if channel.unit is None or split_header(f"{name} [{channel.unit}]") != (name, channel.unit):
            raise WriteError(
                f"channel '{name}': its name ends like a unit, so it cannot name a column; rename it in the rig"
            )
        name = f"{name} [{channel.unit}]"
    if name.lower() == STAMP:
        raise WriteError(f"channel '{name}': is the name of the time column; rename it in the rig")
    metadata = {"stream": channel.stream}
    return pa.field(
        name, pa.float64(), metadata=metadata if channel.unit is None else {**metadata, "unit": channel.unit}
    )
