"""Documents of `inspect` and `init`: streams with their clocks, channels, guessed joints, and faults."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType

from vsalog._version import __version__
from vsalog.core.finding import Finding
from vsalog.core.finding_texts import sentence
from vsalog.core.notation import between, number, percent
from vsalog.core.printable import command, plural, printable, size_text
from vsalog.estimation.job import sha256
from vsalog.figures.recorded import recorded_chart
from vsalog.inspection.document import ChannelReport, HeadReport, Inspection, LogReport, StreamReport
from vsalog.inspection.run import Options, looked_at
from vsalog.readers.base import DOUBTFUL
from vsalog.report.document import (
    SEVERITIES,
    Block,
    Cell,
    Document,
    Facts,
    Figures,
    Section,
    Table,
    Tone,
    Verdict,
    Words,
    with_severity,
)
from vsalog.report.plot import Drawn
from vsalog.rig.guess import LEAST_CHANNELS
from vsalog.rig.guess_gaps import Answers, Command, Gap, command_for, gaps_of, waits_for
from vsalog.rig.guess_types import Guess, JointGuess
from vsalog.rig.template import named_joints, toml_key
from vsalog.writers.repaired import Repaired

TONES: dict[str, Tone] = {"info": "", "warning": "open", "invalidates": "bad"}
# From how many seconds on a unit is used instead of the next smaller one, and its length [s].
_LONG = ((172_800.0, "d", 86_400.0), (7_200.0, "h", 3_600.0), (120.0, "min", 60.0))


def inspection_document(found: Inspection) -> Document:
    """Return what is in several logs."""
    logs = (Section(_title(report), tuple(_log(report))) for report in found.logs)
    title = f"Inspection of {', '.join(log.path for log in found.logs)}"
    return Document(title, "Contents, faults and probable roles", tuple(logs), found)


def inspection_page(found: Inspection, options: Options) -> Document:
    """Return the page of `inspection_document`: with figures of the joints' channels, or of all where no joint is guessed."""
    document, logs = inspection_document(found), []
    for report, section in zip(found.logs, document.items, strict=True):
        assert isinstance(section, Section)
        figures = (Figures((drawn.chart,)) for drawn in inspection_charts(report, options))
        logs.append(replace(section, items=(*section.items, *figures)))
    read = [(report.path, f"SHA-256 {sha256(Path(report.path))}") for report in found.logs]
    origin = Section("Provenance", (Facts((*read, ("vsalog", __version__))),), where="page")
    return replace(document, items=(*logs, origin))


def inspection_charts(report: LogReport, options: Options) -> Iterator[Drawn]:
    """Yield figures of each guessed joint's channels over time, or of each stream's where no joint is guessed."""
    recording, _ = looked_at(Path(report.path), options)
    for joint in report.joints:
        named = [
            (f"{c.role.role}: {c.name}", recording.channels[c.name])
            for stream in report.streams
            for c in stream.channels
            if c.role is not None and c.role.joint == joint.name and c.name in recording.channels
        ]
        if named:
            yield Drawn(
                recorded_chart(f"Joint {joint.name}, as guessed", recording, named), joint.name, log=report.path
            )
    for stream in () if report.joints else report.streams:
        own = [(c.name, recording.channels[c.name]) for c in stream.channels if c.name in recording.channels]
        if own:
            yield Drawn(recorded_chart(stream.name, recording, own), stream.name, log=report.path)


def repair_words(repaired: Repaired) -> str:
    """Describe what `--repair` wrote."""
    words = f"{repaired.path}: {plural(repaired.messages, 'message')} of {plural(repaired.channels, 'channel')} written"
    return "; ".join([words, *repaired.notes])


def _log(report: LogReport) -> Iterator[Block]:
    doubts = [one for one in report.findings if one.code in DOUBTFUL]
    yield from _sample(report)
    yield from _findings(doubts)
    for stream in report.streams:
        yield Section(_stream_line(stream, bool(doubts)), (*_trouble(stream), *_channels(stream)))
    begin = min((s.start for s in report.streams if s.start is not None), default=0)
    timeless = {s.name for s in report.streams if s.start is None}
    for head in report.head:
        yield Section("", (_head(head, None if head.stream in timeless else begin),))
    yield from _joints(report)
    for why, names in _by_words(report.unread.items()).items():
        yield Words(f"not read: {', '.join(names)}: {why}")
    yield from _findings(finding for finding in report.findings if finding not in doubts)


def _findings(findings: Iterable[Finding]) -> Iterator[Verdict]:
    for severity, words in with_severity(findings):
        yield Verdict(SEVERITIES[severity], words, TONES[severity])


def _title(report: LogReport) -> str:
    count = sum(len(s.channels) for s in report.streams)
    samples = plural(max((stream.count for stream in report.streams), default=0), "sample")
    facts = [report.format, samples if report.duration is None else seconds(report.duration)]
    facts += [plural(len(report.streams), "stream"), plural(count, "channel")]
    starts = [s.start for s in report.streams if s.start is not None]
    if report.absolute_time and starts:
        facts.append(f"from {datetime.fromtimestamp(min(starts) // 1_000_000_000, UTC):%Y-%m-%d %H:%M:%S} UTC")
    if report.has_rig:
        facts.append("carries a rig")
    return f"{report.path}  {', '.join(facts)}"


def _sample(report: LogReport) -> Iterator[Verdict]:
    """Yield what was read of a large log, and the consequences."""
    sample = report.sample
    if sample is None:
        return
    if sample.stretches == 1:
        where, extent = "its beginning", "The duration is that of the beginning"
    else:
        where, extent = (
            f"{sample.stretches} stretches from its beginning to its end",
            "Duration and begin are the log's",
        )
    yield Verdict(
        "a sample was read, " + f"{size_text(sample.size)} of {size_text(sample.of)}",
        f"{where}. {extent}; samples, ranges and gaps are those of the sample, and damage elsewhere was not checked."
        " --full reads all of it",
        "open",
    )


def _stream_line(stream: StreamReport, doubtful: bool) -> str:
    count = plural(stream.count, "sample")
    if stream.total is not None and stream.total != stream.count:
        count = f"{count} of {stream.total}"
    facts = [stream.type, count]
    if stream.rate is not None:
        jitter = f" ± {seconds(stream.jitter)}" if stream.jitter else ""
        facts.append(f"{stream.rate:.4g} Hz{jitter}")
    if stream.gaps:
        facts.append(f"{plural(stream.gaps, 'gap')}, the longest {seconds(stream.longest_gap)}")
    facts.append("no time" if stream.time_source == "none" else f"time: {stream.time_source}")
    if stream.delay_median is not None:
        spread = f", spread {seconds(stream.delay_spread)}" if stream.delay_spread is not None else ""
        facts.append(f"log time minus stamp {seconds(stream.delay_median)}{spread}")
    facts += ["values may be wrong"] if doubtful else []
    return f"{stream.name}  {', '.join(filter(None, facts))}"


def _trouble(stream: StreamReport) -> Iterator[Words]:
    """Yield the faults of the stream's stamps."""
    if stream.time_reason:
        yield Words(stream.time_reason)
    found = (
        (stream.inversions, "out of order"),
        (stream.duplicates, "dropped as exact copies"),
        (stream.conflicts, "dropped because another has the same stamp"),
    )
    wrong = [f"{plural(count, 'sample')} {what}" for count, what in found if count]
    if wrong:
        yield Words("; ".join(wrong))


def _channels(stream: StreamReport) -> Iterator[Table]:
    has_nan = any(c.nan_share for c in stream.channels)
    rows: list[tuple[Cell | str, ...]] = [
        (
            c.name,
            c.unit or "–",
            _range(c),
            _role(c),
            *((percent(c.nan_share) if c.nan_share else "",) if has_nan else ()),
            number(c.resolution),
            number(c.noise),
        )
        for c in stream.channels
    ]
    heads = ("channel", "unit", "range", "probably", *(("NaN",) if has_nan else ()), "step", "noise")
    yield Table("", heads, tuple(rows), texts=4)


def _range(channel: ChannelReport) -> str:
    if channel.minimum is None:
        return "no numbers"
    return f"always {number(channel.minimum, 5)}" if channel.constant else between(channel.minimum, channel.maximum, 5)


def _role(channel: ChannelReport) -> str:
    role = channel.role
    return "" if role is None else f"{role.joint}.{role.role} ({round(100 * role.confidence)} %)"


def _head(head: HeadReport, begin: int | None) -> Table:
    """Return the first samples of a stream, with times from `begin` [ns] on; with row numbers where that is None."""
    times = (str(s) if begin is None else f"{(s - begin) / 1e9:.6f}" for s in head.stamps)
    rows = tuple(
        (time, *("–" if v is None else repr(v) for v in row)) for time, row in zip(times, head.rows, strict=True)
    )
    heads = ("row" if begin is None else "time [s]", *head.channels)
    return Table(f"{head.stream}  the first {len(rows)} as read", heads, rows)


def _joints(report: LogReport) -> Iterator[Block]:
    if not report.joints:
        words = "no channel looks like a joint's position, so no joint was guessed"
        moving = sum(not channel.constant for stream in report.streams for channel in stream.channels)
        more = "; 'vsalog init LOG' writes a rig to fill in" if moving >= LEAST_CHANNELS else ""
        yield Section("", (Words(words + more),))
        return
    yield from guessed_joints(report.joints)
    yield Words("'vsalog init LOG' writes these guesses into a rig file")


def guessed_joints(joints: Iterable[JointGuess]) -> Iterator[Section]:
    """Yield the joints that a log seems to contain, why, and which important signals are missing.

    Joints with the same text share a paragraph: the seven of an arm need no seven paragraphs.
    """
    alike: dict[tuple[object, ...], list[JointGuess]] = {}
    for joint in joints:
        content = (joint.kind, joint.confidence, joint.reason, *_reasons(joint), *map(sentence, joint.findings))
        alike.setdefault(content, []).append(joint)
    for same in alike.values():
        first, names = same[0], ", ".join(joint.name for joint in same)
        head = f"{'joint' if len(same) == 1 else 'joints'} {names}"
        title = f"{head}  {first.kind} ({round(100 * first.confidence)} %): {first.reason}"
        yield Section(title, (*map(Words, _reasons(first)), *_findings(first.findings)))


def init_document(
    guess: Guess,
    log: Path,
    written: Path | None,
    answers: Mapping[str, Answers] = MappingProxyType({}),
    preset: str | None = None,
    lacking: Sequence[str] = (),
    reading: Sequence[str] = (),
) -> Document:
    """Return the evidence for a guessed rig, and what to do with it.

    Parameters
    ----------
    guess : of the log's joints
    log : its path
    written : the rig's file; None where it is printed
    answers : per joint, the answers about its gaps
    preset : whose numbers the rig has
    lacking : keys of the preset's roles whose channels the log lacks
    reading : the options with which the log was read
    """
    if is_timeless := any(finding.code == "clock.missing" for finding in guess.findings):
        reading = (*reading, "--rate", "HZ")
    items: list[Block] = [*guessed_joints(guess.joints), *_findings(guess.findings)]
    file = "RIG" if written is None else str(written)
    if preset is None:
        items += _uses(guess, log, file, answers, reading)
    elif written is not None:
        first = f"fill in the channels of {', '.join(lacking)}" if lacking else "check it"
        line = command("estimate", log, "--rig", file, *reading)
        items.append(Words(f"{printable(file)} written; {first}, then run '{line}'"))
    items += [Words("HZ stands for the sample rate, which the log does not contain")] if is_timeless else []
    return Document(f"A rig for {log.name}", "Guesses", tuple(items))


_WHAT_FOR = {
    "estimate": "estimates the stiffness",
    "identify": "fits the rig's initial values",
    "simulate": "simulates the rig's initial values; the log lacks signals that a stiffness needs",
}
_WAITED_FOR = {
    "counts_per_turn": "the counts per turn are",
    "gear_ratio": "the gear ratio is",
    "signals": "its channels are",
}
_ASKED = {
    "counts_per_turn": "counts per turn of '{channel}'",
    "side": "the side of the gear on which '{channel}' is: rotor on the motor's shaft, joint behind the gear",
    "sign": "sign of '{channel}': 1, or -1 where it counts the other way round (deflection = link - motor)",
    "gear_ratio": "gear ratio, turns of '{channel}' per turn of the joint",
    "torque_constant": "torque constant that converts the current '{channel}' to a torque [{unit}]",
    "inertia": "inertia of the motor, on the joint's side of the gear [{unit}]",
}


def question_of(joint: str, gap: Gap) -> str:
    """Return the question about a gap of a joint's rig."""
    return f"{joint}: {_lacking(gap)}; nothing if unknown"


def _lacking(gap: Gap) -> str:
    return _ASKED[gap.key.rpartition(".")[2]].format(channel=gap.channel, unit=gap.unit)


def _uses(
    guess: Guess, log: Path, file: str, answers: Mapping[str, Answers], reading: Sequence[str]
) -> Iterator[Words]:
    """Yield which commands can use the rig, and which additions would allow more."""
    names: dict[Command, list[str]] = {}
    lacking: dict[str, list[str]] = {}
    waiting: dict[str, tuple[str, ...]] = {}
    proposed: dict[tuple[str, str], float] = {}
    for name, joint in named_joints(guess):
        known = answers.get(name, {})
        names.setdefault(command_for(joint, known), []).append(name)
        waiting[name] = waits_for(joint, known)
        for gap in gaps_of(joint, known):
            proposed |= {} if gap.guess is None else {(name, gap.key): gap.guess}
            if gap.key not in known and (gap.guess is None or gap.key in waiting[name]):
                lacking.setdefault(_lacking(gap), []).append(f"joint.{toml_key(name)}.{gap.key}")
    for what, keys in lacking.items():
        yield Words(f"not known: {what}: {', '.join(keys)}")
    for what, joints in names.items():
        only = (
            [word for joint in joints for word in ("--joint", joint)] if len(names) > 1 and what != "simulate" else []
        )
        lacked = [(name, key) for name in joints for key in waiting[name]]
        missing = " and ".join(dict.fromkeys(_WAITED_FOR[key.rpartition(".")[2]] for _, key in lacked))
        first = f"once {missing} filled in, " if lacked else ""
        if lacked and set(lacked) <= set(proposed):
            # The log's own estimate is no datum: whoever runs the command states it.
            stated = (f"joint.{toml_key(name)}.{key}={proposed[name, key]:g}" for name, key in lacked)
            only += [word for key in stated for word in ("--set", key)]
            first = f"if {missing} as proposed here, "
        line = command(what, *([file] if what == "simulate" else [log, "--rig", file, *reading]), *only)
        yield Words(f"{', '.join(joints)}: {first}'{line}' {_WHAT_FOR[what]}")


def _reasons(joint: JointGuess) -> Iterator[str]:
    """Yield why its channels probably have their roles, and which important signals are missing."""
    for role, guess in joint.roles.items():
        yield f"{role} ({round(100 * guess.confidence)} %): {'; '.join(guess.reasons)}"
    needed = ((role, why) for role, why in joint.missing.items() if role not in joint.not_needed)
    for why, roles in _by_words(needed).items():
        yield f"{' or '.join(roles)}: {why}"


def _by_words(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Return the names that share a reason: the fields of a type that is no signal are many."""
    names_of: dict[str, list[str]] = {}
    for name, words in pairs:
        names_of.setdefault(words, []).append(name)
    return names_of


def seconds(value: float | None) -> str:
    """Write a time with a suitable unit."""
    if value is None:
        return "–"
    size = abs(value)
    for least, unit, length in _LONG:
        if size >= least:
            return f"{_three_digits(value / length)} {unit}"
    if size >= 1.0 or size == 0.0:
        return f"{value:.4g} s"
    return f"{_three_digits(value * 1e3)} ms" if size >= 1e-3 else f"{value * 1e6:.3g} µs"


def _three_digits(value: float) -> str:
    """Write a number with three digits, and more if they are before the point."""
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"
