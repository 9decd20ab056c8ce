"""The structures of an inspection, as `inspect --json` prints them."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct, structs

from vsalog.core.finding import Finding
from vsalog.core.finding_texts import sentence
from vsalog.rig.guess_types import JointGuess
from vsalog.writers.repaired import Repaired


class RoleReport(Struct, frozen=True):
    """The role a channel probably has, in which joint, and the confidence (0 … 1)."""

    joint: str
    role: str
    confidence: float
    reasons: tuple[str, ...]


class ChannelReport(Struct, frozen=True):
    """One channel.

    Attributes
    ----------
    name, unit, type : as in the log
    count : samples
    nan_share : share of them that are no finite number
    minimum, maximum : of the finite ones; None where there is none
    resolution : least significant step; None for a channel without steps
    noise : standard deviation of its white noise, from second differences; None where that is not known
    constant : it never changes
    role : the probable one
    """

    name: str
    unit: str | None
    type: str
    count: int
    nan_share: float
    minimum: float | None
    maximum: float | None
    resolution: float | None
    noise: float | None
    constant: bool
    role: RoleReport | None


class StreamReport(Struct, frozen=True):
    """One topic, table or struct, its clock and its channels; times in seconds.

    Attributes
    ----------
    name, type : as in the log
    count : samples that were read
    total : samples in the whole log; None where only a sample of it was read and it does not say so
    start : stamp of the first sample [ns]; None where there is none
    duration : last stamp minus first
    rate : [Hz], one over the median step
    jitter : half the 5–95 % range of the steps
    gaps, longest_gap : steps longer than 2.5 medians
    time_source, time_reason : which clock the stamps are, and why not a better one, in a sentence
    inversions, duplicates, conflicts : samples out of order, exact copies, equal stamps with other values
    delay_median, delay_spread : log time minus stamp; None where the log has one clock
    channels : its channels
    """

    name: str
    type: str
    count: int
    total: int | None
    start: int | None
    duration: float | None
    rate: float | None
    jitter: float | None
    gaps: int
    longest_gap: float
    time_source: str
    time_reason: str
    inversions: int
    duplicates: int
    conflicts: int
    delay_median: float | None
    delay_spread: float | None
    channels: tuple[ChannelReport, ...]


class SampleReport(Struct, frozen=True):
    """What was read instead of the whole of a large log.

    Attributes
    ----------
    size, of : bytes read, and of the log
    stretches : number of separate pieces; 1 is the log's beginning alone
    """

    size: int
    of: int
    stretches: int


class JointReport(JointGuess, frozen=True):
    """A joint as guessed; `warnings` are its findings in sentences."""

    warnings: tuple[str, ...] = ()

    @classmethod
    def of(cls, joint: JointGuess) -> JointReport:
        """Return a guess with its sentences."""
        return cls(**structs.asdict(joint), warnings=tuple(map(sentence, joint.findings)))


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


class LogReport(Struct, frozen=True):
    """One log: its streams, the joints guessed, and what a person should know.

    Attributes
    ----------
    path, format : of the log
    absolute_time : whether stamps count from the epoch
    duration : [s], from the first stamp of all streams to the last; None where no stream has a time
    has_rig : the log carries a rig
    sample : the part of the log that was read; None for the whole log
    streams : with their channels
    joints : as guessed
    head : the first samples of each stream, if requested
    unread : fields that are no signal, and why
    findings : of the reader and of the guess
    notes : those of the reader, in sentences
    warnings : those of the guess
    """

    path: str
    format: str
    absolute_time: bool
    duration: float | None
    has_rig: bool
    sample: SampleReport | None
    streams: tuple[StreamReport, ...]
    joints: tuple[JointReport, ...]
    head: tuple[HeadReport, ...]
    unread: Mapping[str, str]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


class Unreadable(Struct, frozen=True):
    """A log that cannot be read, and why."""

    path: str
    error: str


class Inspection(Struct, frozen=True):
    """The whole answer of `inspect --json`.

    Attributes
    ----------
    logs : in the order they were named
    repaired : what was written, if requested
    unreadable : those of the logs that cannot be read
    """

    logs: tuple[LogReport, ...]
    repaired: Repaired | None = None
    unreadable: tuple[Unreadable, ...] = ()
