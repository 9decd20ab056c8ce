"""Inspects a recording: its clocks, its channels, and their probable roles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.grid import LONGEST_GAP
from vsalog.core.errors import VsalogError, words_of
from vsalog.core.finding import Findings
from vsalog.core.finding_texts import sentence
from vsalog.core.recording import Channel, Recording, Stream
from vsalog.core.resolution import noise_of, step_of
from vsalog.inspection.document import (
    ChannelReport,
    HeadReport,
    Inspection,
    JointReport,
    LogReport,
    RoleReport,
    SampleReport,
    StreamReport,
    Unreadable,
)
from vsalog.inspection.joint_faults import joint_faults
from vsalog.readers import read
from vsalog.readers.sampling import read_sample
from vsalog.readers.sampling_pieces import Sample
from vsalog.rig.checks import RUN
from vsalog.rig.guess import guess_roles
from vsalog.rig.guess_types import Guess


@dataclass(frozen=True, slots=True)
class Options:
    """The options of `inspect`, named as on the command line.

    Attributes
    ----------
    head : number of first samples of each stream in the report
    full : read all of a large log; a sample of it when absent
    rate, time, start, end : as for `vsalog.readers.read`; a part of a log is read whole
    """

    head: int = 0
    full: bool = False
    rate: float | None = None
    time: str = "auto"
    start: str | None = None
    end: str | None = None


def inspect(logs: Sequence[Path], options: Options, progress: Callable[[str], None] = lambda _: None) -> Inspection:
    """Inspect logs. Of several, one that cannot be read is reported, and the others are inspected.

    Parameters
    ----------
    logs : paths
    options : of the command
    progress : called with what is being done

    Raises
    ------
    VsalogError
        The only log cannot be read.
    """
    reports: list[LogReport] = []
    unreadable: list[Unreadable] = []
    for log in logs:
        progress(f"reading {log.name}")
        try:
            recording, sample = looked_at(log, options)
        except (VsalogError, OSError) as error:
            if len(logs) == 1:
                raise
            unreadable.append(Unreadable(str(log), words_of(error)))
            continue
        progress(f"inspecting {log.name}")
        reports.append(inspect_recording(recording, guess_roles(recording), sample, options.head))
    return Inspection(tuple(reports), None, tuple(unreadable))


def looked_at(log: Path, options: Options) -> tuple[Recording, Sample | None]:
    """Read the inspected part of a log, and return which part it is; None for the whole."""
    if options.full or options.start is not None or options.end is not None:
        return read(log, None, options.time, options.rate, options.start, options.end), None
    return read_sample(log, options.time, options.rate)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a log may hold any number
def inspect_recording(recording: Recording, guess: Guess, sample: Sample | None = None, head: int = 0) -> LogReport:
    """Return the contents of a recording.

    Parameters
    ----------
    recording : as read
    guess : the roles of its channels
    sample : which part of the log it is; None for the whole
    head : number of first samples of each stream in the report
    """
    roles = _roles(guess)
    found = Findings(recording.findings)
    found.add(*guess.findings, *joint_faults(recording, guess))
    by_stream: dict[str, list[Channel]] = {name: [] for name in recording.streams}
    for channel in recording.channels.values():
        by_stream.setdefault(channel.stream, []).append(channel)
    return LogReport(
        str(recording.path),
        recording.format,
        recording.absolute_time,
        _duration(recording),
        recording.rig_text is not None,
        None if sample is None else SampleReport(sample.size, sample.of, sample.stretches),
        tuple(
            _stream(recording.streams.get(name), name, channels, roles, sample) for name, channels in by_stream.items()
        ),
        tuple(map(JointReport.of, guess.joints)),
        tuple(heads_of(recording, head)) if head else (),
        dict(recording.unread),
        tuple(found),
        recording.notes,
        tuple(map(sentence, guess.findings)),
    )


def _roles(guess: Guess) -> dict[str, RoleReport]:
    """Return channel → role; a channel of a run stands for that of every run."""
    found = {}
    for joint in guess.joints:
        for role, given in joint.roles.items():
            report = RoleReport(joint.name, role, given.confidence, given.reasons)
            for name in [run.name for run in joint.runs] or [RUN]:
                found[given.channel.replace(RUN, name)] = report
    return found


def _duration(recording: Recording) -> float | None:
    timeless = {name for name, stream in recording.streams.items() if stream.time_source == "none"}
    stamps = [c.stamps for c in recording.channels.values() if c.stamps.size and c.stream not in timeless]
    if not stamps:
        return None if timeless else 0.0
    return float(max(int(s[-1]) for s in stamps) - min(int(s[0]) for s in stamps)) * 1e-9


def _stream(
    stream: Stream | None, name: str, channels: list[Channel], roles: Mapping[str, RoleReport], sample: Sample | None
) -> StreamReport:
    stream = stream or Stream(name, "", 0, "none")
    has_time = stream.time_source != "none" and bool(channels)
    # Channels of one stream share their stamps; the longest has most of them where a format splits them.
    stamps = max((c.stamps for c in channels), key=lambda s: s.size, default=np.empty(0, np.int64))
    seams = 0 if sample is None else sample.stretches - 1
    clock = clock_of(stamps, seams) if has_time else Clock(math.nan, math.nan, 0, 0.0, math.nan)
    return StreamReport(
        name,
        stream.type,
        stream.count,
        stream.count if sample is None else sample.totals.get(name),
        int(stamps[0]) if has_time and stamps.size else None,
        _known(clock.duration),
        _known(clock.rate),
        _known(clock.jitter),
        clock.gaps,
        clock.longest_gap,
        stream.time_source,
        "" if stream.time_finding is None else sentence(stream.time_finding),
        stream.inversions,
        stream.duplicates,
        stream.conflicts,
        _known(stream.delay_median),
        _known(stream.delay_spread),
        tuple(_channel(c, roles.get(c.name)) for c in channels),
    )


def _channel(channel: Channel, role: RoleReport | None) -> ChannelReport:
    values = channel.values
    is_finite = np.isfinite(values)
    finite = values if is_finite.all() else values[is_finite]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
    constant = finite.size > 0 and low == high
    return ChannelReport(
        channel.name,
        channel.unit,
        channel.type,
        int(values.size),
        float(1.0 - finite.size / values.size) if values.size else 0.0,
        low,
        high,
        None if constant else step_of(values),
        None if constant else noise_of(values),
        constant,
        role,
    )


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def heads_of(recording: Recording, count: int) -> Iterator[HeadReport]:
    """Yield the first `count` samples of each stream."""
    for name in recording.streams:
        channels = [channel for channel in recording.channels.values() if channel.stream == name]
        if not channels:
            continue
        stamps = channels[0].stamps[:count].tolist()
        columns = [[v if abs(v) < float("inf") else None for v in c.values[:count].tolist()] for c in channels]
        yield HeadReport(name, tuple(stamps), tuple(c.name for c in channels), tuple(zip(*columns, strict=True)))


@dataclass(frozen=True, slots=True)
class Clock:
    """How regularly a stream was sampled.

    Attributes
    ----------
    rate : [Hz], one over the median step; NaN below two samples
    jitter : half the 5–95 % range of the steps [s]
    gaps : steps longer than `LONGEST_GAP` medians
    longest_gap : [s], 0 where there is none
    duration : [s], last stamp minus first
    """

    rate: float
    jitter: float
    gaps: int
    longest_gap: float
    duration: float


def clock_of(stamps: NDArray[np.int64], seams: int = 0) -> Clock:
    """Return how regularly the stamps follow each other.

    Parameters
    ----------
    stamps : int64 array, shape (n,), increasing [ns]
    seams : number of gaps between the stretches of a sample; as many of the longest steps are left out
    """
    if stamps.size < 2:
        return Clock(float("nan"), float("nan"), 0, 0.0, 0.0)
    steps = np.diff(stamps)
    if seams:
        steps = np.sort(steps)[: max(steps.size - seams, 1)]
    median = float(np.median(steps))
    low, high = np.percentile(steps, (5.0, 95.0))
    is_gap = steps > LONGEST_GAP * median
    longest = float(steps.max()) if is_gap.any() else 0.0
    duration = float(stamps[-1] - stamps[0]) * 1e-9
    rate = 1e9 / median if median > 0.0 else float("nan")
    return Clock(rate, 0.5e-9 * float(high - low), int(np.count_nonzero(is_gap)), longest * 1e-9, duration)
