"""What holds of every log that was read, however hostile: the contract that the fuzz targets watch over."""

from __future__ import annotations

import math
import os
import shutil
import tempfile
import warnings
from pathlib import Path

import msgspec
import numpy as np

from vsalog.core.errors import ReadError, VsalogError
from vsalog.inspection.document import Inspection
from vsalog.inspection.run import inspect_recording
from vsalog.readers import read
from vsalog.rig.guess import guess_roles
from vsalog.rig.load import Rig
from vsalog.rig.template import rig_template
from vsalog.writers.repair import repair

GIB = 2**30
LONGEST = 4000
"""No message to a person is longer."""
FAST = "/dev/shm" if Path("/dev/shm").is_dir() else None
TIMES = ("auto", "header", "log", "publish")
CLOCKS = ("header", "log", "publish", "column", "rate", "none")

_folder = tempfile.TemporaryDirectory(prefix="vsalog-fuzz-", dir=FAST)


def put(content: bytes, name: str = "log") -> Path:
    """Write a file that the next call replaces."""
    path = Path(_folder.name) / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    return path


def empty(name: str) -> Path:
    """Return a new folder in the place of the one before."""
    folder = Path(_folder.name) / name
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir()
    return folder


def told(error: VsalogError, where: object = "") -> None:
    """See that an error's message is one that a person can read, and that it begins with what it is about."""
    text = str(error)
    assert 0 < len(text) < LONGEST, f"a message of {len(text)} characters"
    assert text.startswith(str(where)), text


def exercise(path: Path, how: int) -> None:
    """Read a log in one of the ways it may be read in; only `VsalogError` may come out of it."""
    rate = 100.0 if how & 1 else None
    time = TIMES[how >> 1 & 3]
    with warnings.catch_warnings():
        # A warning of a library would reach the terminal.
        warnings.simplefilter("error", RuntimeWarning)
        try:
            recording = read(path, time=time, rate=rate)
        except ReadError as error:
            told(error, path)
            return
        well_formed(recording)
        if how & 8:
            same_when_chosen(recording, path, time, rate)
        if how & 16:
            in_a_window(recording, path, time, rate)
        if how & 32:
            inspected(recording)
        if how & 64:
            repaired(path, rate)


def well_formed(recording) -> None:
    """See that a recording is what its documentation says."""
    for name, channel in recording.channels.items():
        assert channel.name == name
        assert channel.stamps.dtype == np.int64
        assert channel.values.dtype == np.float64
        assert channel.stamps.shape == channel.values.shape == (recording.streams[channel.stream].count,)
        # A difference may be beyond int64: compared, not subtracted.
        assert (channel.stamps[1:] > channel.stamps[:-1]).all(), f"{name}: stamps that do not rise"
        assert channel.unit is None or isinstance(channel.unit, str)
        assert name not in recording.unread
    for stream in recording.streams.values():
        assert stream.time_source in CLOCKS
        assert min(stream.count, stream.inversions, stream.duplicates, stream.conflicts) >= 0
        assert math.isnan(stream.delay_spread) or stream.delay_spread >= 0.0
    for text in (*recording.notes, *recording.unread.values()):
        assert 0 < len(text) < LONGEST, f"a note of {len(text)} characters"
    assert isinstance(recording.absolute_time, bool)


def same_when_chosen(recording, path, time, rate) -> None:
    """A channel has the same values whether it is read alone or with the others."""
    if recording.findings:
        return  # what is damaged, and which rows are none, is reported by what is read
    for name in list(recording.channels)[:3]:
        channel = recording.channels[name]
        # Copies and conflicts are reported by all values of a stream: those that are not read do not count.
        stream = recording.streams[channel.stream]
        # Nor do samples of which nothing else is there, where a table holds several streams.
        own = recording.format == "parquet" and channel.stream != path.stem
        if stream.duplicates or stream.conflicts or own:
            continue
        alone = read(path, wanted=[name], time=time, rate=rate)
        assert list(alone.channels) == [name], f"{name} is not found alone"
        np.testing.assert_array_equal(alone.channels[name].stamps, channel.stamps)
        np.testing.assert_array_equal(alone.channels[name].values, channel.values)


def in_a_window(recording, path, time, rate) -> None:
    """A part of a log is what is in it."""
    try:
        part = read(path, time=time, rate=rate, start=0.001, end="1 s")
    except ReadError as error:
        told(error)
        return
    well_formed(part)
    for name, channel in part.channels.items():
        whole = recording.channels[name]
        assert np.isin(channel.stamps, whole.stamps).all()


def inspected(recording) -> None:
    """What `inspect` says is a document, and the rig that `init` makes of a log can be loaded."""
    guess = guess_roles(recording)
    report = inspect_recording(recording, guess, None, 3)
    msgspec.json.decode(msgspec.json.encode(Inspection((report,), None)), type=Inspection)
    Rig.from_toml(rig_template(recording, guess))


def repaired(path, rate) -> None:
    """A repaired log is a sound one."""
    target = path.with_name("repaired.mcap")
    try:
        repair(path, target, rate)
    except VsalogError as error:
        told(error)
        return
    well_formed(read(target))


def peak() -> int:
    """Return the most memory this process has had [bytes]; 0 where nobody tells."""
    try:
        with open("/proc/self/status", encoding="ascii") as file:  # noqa: PTH123 (a thousand times a second)
            return next(int(line.split()[1]) * 1024 for line in file if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return 0


def bounded() -> None:
    """See that memory has stayed within what is promised."""
    assert peak() < GIB, f"{peak() / GIB:.2f} GiB of memory, process {os.getpid()}"
