"""`inspect` on a terminal: tables where they fit, lists where the terminal is narrow, nothing cut off in a pipe."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from vsalog.core.finding import Finding
from vsalog.core.finding_texts import sentence
from vsalog.core.printable import printable
from vsalog.readers.base import DOUBTFUL
from vsalog.report.console import STYLES, WORDS, fits
from vsalog.report.inspect_data import ChannelReport, JointReport, LogReport, StreamReport
from vsalog.report.inspect_head import head_parts
from vsalog.report.inspect_text import headed, seconds, size
from vsalog.report.page_text import number


def print_reports(reports: Sequence[LogReport], console: Console) -> None:
    """Print what is in several logs."""
    for i, report in enumerate(reports):
        if i:
            console.print()
        print_report(report, console)


def print_report(report: LogReport, console: Console) -> None:
    """Print what is in a log."""
    for part in _parts(report, console):
        console.print(part, soft_wrap=isinstance(part, Text) and not console.is_terminal)


def _parts(report: LogReport, console: Console) -> Iterator[RenderableType]:
    doubts = [one for one in report.findings if one.code in DOUBTFUL]
    yield _title(report)
    yield from _sample(report)
    yield from (_finding(doubt, "bold red") for doubt in doubts)
    for stream in report.streams:
        yield Text()
        yield _stream_line(stream, bool(doubts))
        yield from _trouble(stream)
        if stream.channels:
            yield from _channels(stream, console)
    yield Text()
    yield from _heads(report, console)
    yield from _joints(report)
    yield from _unread(report)
    yield from (_finding(finding, STYLES[finding.severity]) for finding in report.findings if finding not in doubts)


def _finding(finding: Finding, style: str, indent: str = "") -> Text:
    return Text(f"{indent}{WORDS[finding.severity]}: {printable(sentence(finding))}", style=style)


def _title(report: LogReport) -> Text:
    count = sum(len(s.channels) for s in report.streams)
    text = headed(
        report.path,
        "bold",
        f"{report.format}, {_extent(report)}, {_plural(len(report.streams), 'stream')}, {_plural(count, 'channel')}",
    )
    starts = [s.start for s in report.streams if s.start is not None]
    if report.absolute_time and starts:
        begin = datetime.fromtimestamp(min(starts) // 1_000_000_000, UTC)
        text.append(f", from {begin:%Y-%m-%d %H:%M:%S} UTC")
    if report.has_rig:
        text.append(", carries a rig", style="green")
    return text


def _extent(report: LogReport) -> str:
    """Return how long a log is, in samples where it has no time."""
    if report.duration is None:
        return _plural(max(stream.count for stream in report.streams), "sample")
    return seconds(report.duration)


def _sample(report: LogReport) -> Iterator[Text]:
    """Yield what was read of a large log, and what that means."""
    sample = report.sample
    if sample is None:
        return
    read = f"{size(sample.size)} of {size(sample.of)}"
    if sample.stretches == 1:
        where, untold = "its beginning", "the duration is that of the beginning"
    else:
        where, untold = f"{sample.stretches} stretches from its begin to its end", "duration and begin are the log's"
    yield Text(
        f"a sample was read, {read}: {where}. {untold[0].upper()}{untold[1:]}; samples, ranges and gaps are those of"
        " the sample, and damage elsewhere was not looked for. --full reads all of it",
        style="yellow",
    )


def _heads(report: LogReport, console: Console) -> Iterator[RenderableType]:
    begin = min((s.start for s in report.streams if s.start is not None), default=0)
    timeless = {s.name for s in report.streams if s.start is None}
    for head in report.head:
        yield from head_parts(head, None if head.stream in timeless else begin, console)
        yield Text()


def _stream_line(stream: StreamReport, doubtful: bool) -> Text:
    count = _plural(stream.count, "sample")
    if stream.total is not None and stream.total != stream.count:
        count = f"{count} of {stream.total}"
    facts = [printable(stream.type), count]
    if stream.rate is not None:
        jitter = f" ± {seconds(stream.jitter)}" if stream.jitter else ""
        facts.append(f"{stream.rate:.4g} Hz{jitter}")
    if stream.gaps:
        facts.append(f"{_plural(stream.gaps, 'gap')}, the longest {seconds(stream.longest_gap)}")
    facts.append("no time" if stream.time_source == "none" else f"time: {stream.time_source}")
    if stream.delay_median is not None:
        spread = f", spread {seconds(stream.delay_spread)}" if stream.delay_spread is not None else ""
        facts.append(f"log time minus stamp {seconds(stream.delay_median)}{spread}")
    line = headed(stream.name, "bold cyan", ", ".join(f for f in facts if f))
    if doubtful:
        line.append(", values may be wrong", style="bold red")
    return line


def _trouble(stream: StreamReport) -> Iterator[Text]:
    """Yield what was wrong with the stream's stamps."""
    if stream.time_reason:
        yield Text(f"  {printable(stream.time_reason)}", style="yellow")
    found = (
        (stream.inversions, "out of order"),
        (stream.duplicates, "dropped as exact copies"),
        (stream.conflicts, "dropped because another has the same stamp"),
    )
    wrong = [f"{_plural(count, 'sample')} {what}" for count, what in found if count]
    if wrong:
        yield Text(f"  {'; '.join(wrong)}", style="yellow")


def _channels(stream: StreamReport, console: Console) -> Iterator[RenderableType]:
    table = _table(stream)
    if fits(table, console):
        yield table
        return
    for channel in stream.channels:
        yield Text(f"  {printable(channel.name)}", style="bold", overflow="fold")
        width = max(console.width - 4, 20)
        for line in textwrap.wrap(", ".join(_facts(channel)), width):
            yield Text(f"    {line}")


def _table(stream: StreamReport) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    has_nan = any(c.nan_share for c in stream.channels)
    table.add_column("  channel", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("range", no_wrap=True)
    table.add_column("step", no_wrap=True, justify="right")
    table.add_column("noise", no_wrap=True, justify="right")
    if has_nan:
        table.add_column("NaN", no_wrap=True, justify="right")
    table.add_column("probably", no_wrap=True)
    for c in stream.channels:
        cells = [f"  {printable(c.name)}", printable(c.unit or "–"), _range(c), number(c.resolution), number(c.noise)]
        if has_nan:
            cells.append(f"{100 * c.nan_share:.3g} %" if c.nan_share else "")
        table.add_row(*(Text(cell) for cell in cells), Text(_role(c), style="green"))
    return table


def _facts(channel: ChannelReport) -> Iterator[str]:
    yield f"unit {printable(channel.unit)}" if channel.unit else "no unit"
    yield f"range {_range(channel)}"
    if channel.resolution is not None:
        yield f"step {number(channel.resolution)}"
    if channel.noise is not None:
        yield f"noise {number(channel.noise)}"
    if channel.nan_share:
        yield f"{100 * channel.nan_share:.3g} % NaN"
    if channel.role is not None:
        yield f"probably {_role(channel)}"


def _range(channel: ChannelReport) -> str:
    if channel.minimum is None or channel.maximum is None:
        return "no numbers"
    if channel.constant:
        return f"always {channel.minimum:.5g}"
    return f"{channel.minimum:.5g} … {channel.maximum:.5g}"


def _role(channel: ChannelReport) -> str:
    if channel.role is None:
        return ""
    return f"{printable(channel.role.joint)}.{channel.role.role} ({round(100 * channel.role.confidence)} %)"


def _joints(report: LogReport) -> Iterator[Text]:
    if not report.joints:
        yield Text("no channel looks like a joint's position, so no joint was guessed", style="yellow")
        return
    for joints in _alike(report.joints):
        names = ", ".join(printable(joint.name) for joint in joints)
        head = f"{'joint' if len(joints) == 1 else 'joints'} {names}"
        yield headed(head, "bold", f"{joints[0].kind} ({round(100 * joints[0].confidence)} %): {joints[0].reason}")
        yield from (Text(f"  {line}") for line in _reasons(joints[0]))
        yield from (Text(f"  {line}") for line in _missing(joints[0]))
        yield from (_finding(finding, STYLES[finding.severity], "  ") for finding in joints[0].findings)
    yield Text("'vsalog init LOG' writes these guesses into a rig file", style="dim")


def _alike(joints: tuple[JointReport, ...]) -> list[list[JointReport]]:
    """Put joints together of which the same is to be said: the seven of an arm need no seven paragraphs."""
    groups: dict[tuple[object, ...], list[JointReport]] = {}
    for joint in joints:
        said = (joint.kind, joint.confidence, joint.reason, *_reasons(joint), *_missing(joint), joint.warnings)
        groups.setdefault(said, []).append(joint)
    return list(groups.values())


def _reasons(joint: JointReport) -> Iterator[str]:
    """Yield why its channels probably have their roles."""
    for role, guess in joint.roles.items():
        yield f"{role} ({round(100 * guess.confidence)} %): {printable('; '.join(guess.reasons))}"


def _missing(joint: JointReport) -> Iterator[str]:
    """Yield what matters and is not there."""
    roles_of: dict[str, list[str]] = {}
    for role, why in joint.missing.items():
        if role not in joint.not_needed:
            roles_of.setdefault(why, []).append(role)
    for why, roles in roles_of.items():
        yield f"{' or '.join(roles)}: {printable(why)}"


def _unread(report: LogReport) -> Iterator[Text]:
    """Yield a line per reason: the fields of a type that is no signal are many."""
    names_of: dict[str, list[str]] = {}
    for name, why in report.unread.items():
        names_of.setdefault(why, []).append(printable(name))
    for why, names in names_of.items():
        yield Text(f"not read: {', '.join(names)}: {printable(why)}", style="dim")


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
