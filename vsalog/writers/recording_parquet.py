"""Recordings as Parquet tables, the units in the fields' metadata."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.column import PART
from vsalog.core.errors import WriteError
from vsalog.core.recording import Channel, Recording, Stamps
from vsalog.core.units import split_header
from vsalog.writers.atomic import atomic_path
from vsalog.writers.recording_csv import all_stamps

STAMP = "stamp"
RIG_KEY = "vsalog.rig"


def write_parquet(recording: Recording, path: Path | str, rig_text: str | None = None) -> None:
    """Write a recording as one table: the stamps as whole nanoseconds, then a column per channel.

    A field's metadata tell its ``unit`` and the ``stream`` it belongs to. Streams on different clocks share the table: every
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
    stamps = all_stamps(channels)
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


def _field(channel: Channel) -> pa.Field:
    name = channel.name
    if split_header(name) != (name, None):
        # A reader would take the end of such a name for a unit; with the unit behind it, it takes that one.
        if channel.unit is None or split_header(f"{name} [{channel.unit}]") != (name, channel.unit):
            raise WriteError(
                f"channel '{name}': its name ends like a unit, so it cannot name a column; rename it in the rig"
            )
        name = f"{name} [{channel.unit}]"
    if name.lower() == STAMP:
        raise WriteError(f"channel '{name}': is what the time column is called; rename it in the rig")
    metadata = {"stream": channel.stream}
    return pa.field(
        name, pa.float64(), metadata=metadata if channel.unit is None else {**metadata, "unit": channel.unit}
    )


def _column(channel: Channel, stamps: Stamps) -> pa.Array[Any]:
    if channel.stamps is stamps:
        return pa.array(channel.values)
    rows = np.searchsorted(stamps, channel.stamps)
    values, empty = np.zeros(stamps.shape), np.ones(stamps.shape, dtype=np.bool_)
    values[rows], empty[rows] = channel.values, False
    column: pa.Array[Any] = pa.array(values, mask=empty)
    return column
