"""Opens and reads logs of any format."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from os import PathLike
from pathlib import Path
from types import MappingProxyType

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding
from vsalog.core.recording import Recording
from vsalog.readers.base import Reader
from vsalog.readers.container import Container
from vsalog.readers.matlab import MatlabReader
from vsalog.readers.mcap_file import McapContainer
from vsalog.readers.message_reader import BagReader
from vsalog.readers.own_files import refuse_toml
from vsalog.readers.parquet import ParquetReader
from vsalog.readers.recording_from_blocks import collect
from vsalog.readers.remote import downloaded, local
from vsalog.readers.rosbag1 import Rosbag1Container
from vsalog.readers.rosbag2 import bag_file, bag_folder, counted
from vsalog.readers.sniff import sniff
from vsalog.readers.table_folder import TableFolderReader
from vsalog.readers.tables.columnar import ColumnarReader
from vsalog.readers.tables.reader import TableReader
from vsalog.readers.time_window import Window, cut

TIMES = ("auto", "header", "log", "publish")


def open_reader(path: str | PathLike[str], rate: float | None = None) -> Reader:
    """Open a log of any format.

    Parameters
    ----------
    path : str or Path
        A file, the folder of a ROS 2 bag or of tables that belong together, or an address of a file, which is downloaded first.
    rate : float, optional
        Samples per second [Hz] of tables that have no time column.

    Raises
    ------
    ReadError
        There is no such file, it is empty, damaged at its head or of no known format, or `rate` is not positive.
    """
    path = local(Path(path))
    if rate is not None and not 0 < rate < float("inf"):
        raise ReadError(f"the sample rate has to be positive, not {rate} Hz")
    kind = sniff(path)
    if kind in ("table", "parquet"):
        return _open_table(path, kind, rate)
    if kind == "matlab":
        return MatlabReader(path, rate)
    if kind == "table-folder":
        return TableFolderReader(path, lambda file, units: _open_table(file, sniff(file), rate, units))
    return message_reader(open_container(path, kind), rate)


def _open_table(
    path: Path, kind: str, rate: float | None, units: Mapping[str, str] = MappingProxyType({})
) -> ColumnarReader:
    """Open a table; `units` are those of columns whose headers state none.

    Raises
    ------
    ReadError
        It cannot be opened, or is no table.
    """
    if kind == "table":
        refuse_toml(path)
        return TableReader(path, rate, units=units)
    if kind == "parquet":
        return ParquetReader(path, rate, units)
    raise ReadError("is no table", path)


def message_reader(container: Container, rate: float | None) -> BagReader:
    """Return the reader of a container's messages, which need no rate."""
    reader = BagReader(container)
    if rate is not None:
        reader.findings.append(Finding(code="clock.rate_not_used", value=rate, unit="Hz"))
    return reader


def read(
    path: str | PathLike[str],
    wanted: Collection[str] | None = None,
    time: str = "auto",
    rate: float | None = None,
    start: str | float | None = None,
    end: str | float | None = None,
    room: int | None = None,
    opened: Reader | None = None,
) -> Recording:
    """Read a log, or some channels of it.

    Parameters
    ----------
    path : str or Path
        A file, the folder of a ROS 2 bag or of tables that belong together, or an address of a file, which is downloaded first.
    wanted : collection of str, optional
        Names of the channels to decode and keep; None is all of them. Names that the log lacks are ignored.
    time : str
        ``auto``: header stamps, or log time for a whole stream where they are missing, zero or implausible in more than a few
        samples, which are left out; or one of ``header``, ``log`` and ``publish`` to insist on that clock where a stream has it.
        With ``header``, too, the few samples are left out that have no stamp to be placed by.
    rate : float, optional
        Samples per second [Hz] of tables that have no time column.
    start, end : str or float, optional
        Keep samples between these, both included: seconds from the log's beginning (the first sample of all its streams), a
        number with a unit such as ``"2 min"``, an ISO 8601 date (UTC where it has no zone), or a time since the epoch.
    room : int, optional
        Bytes of memory for samples; larger ones are in temporary memory-mapped files, see
        `vsalog.core.column`. None keeps all in memory.
    opened : Reader, optional
        The log, by `open_reader`, of which nothing was read yet.

    Returns
    -------
    Recording
        Stamps are strictly increasing int64 nanoseconds, values float64 in the channel's unit as recorded.

    Raises
    ------
    ReadError
        The log cannot be read, contains nothing from `start` to `end`, or one of the options is impossible.
    """
    if time not in TIMES:
        raise ReadError(f"time is one of {', '.join(TIMES)}, not '{time}'")
    path = Path(path)
    file = local(path)
    channels = None if wanted is None else frozenset(wanted)

    def recorded(reader: Reader) -> Recording:
        return collect(file, reader, channels, time, room)

    recording: Recording | None = None
    try:
        first = open_reader(file, rate) if opened is None else opened
        if start is None and end is None:
            recording = recorded(first)
        else:
            bounds = Window.parse(start, end).bounds(first, file, time)
            part = open_reader(file, rate)
            if isinstance(part, BagReader) and part.narrow(*bounds, time, channels):
                known = {name for name in first.catalogue().channels if channels is None or name in channels}
                with suppress(ReadError):  # the window is empty: read the whole log to report where its samples are
                    recording = cut(recorded(part), *bounds, known)
                part = open_reader(file, rate)
            recording = recording or cut(recorded(part), *bounds)
    except ReadError as error:
        raise error.moved(file, path) from None
    if file is path:
        return recording
    return replace(recording, path=path, findings=(downloaded(file), *recording.findings))


def open_container(path: Path, kind: str) -> Container:
    """Open a container of serialised messages: an MCAP file, a ROS 1 bag or a ROS 2 bag.

    Parameters
    ----------
    path : str or Path
        A file, or the folder of a ROS 2 bag.
    kind : str
        As by `vsalog.readers.sniff.sniff`.

    Raises
    ------
    ReadError
        It cannot be opened.
    """
    if kind == "rosbag1":
        return Rosbag1Container(path)
    if kind == "rosbag2-folder":
        return bag_folder(path)
    if kind == "mcap":
        return McapContainer(path)
    return counted(bag_file(path, shown=path), path)
