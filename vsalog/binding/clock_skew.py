"""Roles of a joint on different clocks: header stamps of one topic, the log's time of another without stamps."""

from __future__ import annotations

from collections.abc import Iterable

from vsalog.core.errors import BindingError
from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.core.recording import Recording, Stream

LONGEST_TRANSPORT = 0.1
"""A log's time that is later than the stamps by more [s] is no transport delay."""

LEAST_CLOCK_SKEW = 1e-3
"""Smaller differences of clocks [s] are not reported: no joint moves in a millisecond."""


def clock_findings(recording: Recording, name: str, channels: Iterable[str]) -> tuple[Finding, ...]:
    """Return that roles of a joint are on different clocks, unless the difference is negligible.

    Parameters
    ----------
    recording : the log
    name : of the joint
    channels : of the joint's roles

    Raises
    ------
    BindingError
        The clocks are far apart, and header stamps were not requested explicitly.
    """
    streams = dict.fromkeys(recording.channels[channel].stream for channel in channels)
    used = [recording.streams[stream] for stream in streams if stream in recording.streams]
    stamped = [one for one in used if one.time_source == "header" and abs(one.delay_median) >= LEAST_CLOCK_SKEW]
    others = [one for one in used if one.time_source in ("log", "publish")]
    if not stamped or not others:
        return ()
    far = max(stamped, key=lambda one: abs(one.delay_median))
    if abs(far.delay_median) > LONGEST_TRANSPORT and not all(map(_lacks_stamps, others)):
        header = "" if any(one.time_finding for one in others) else ", --time header uses them as they are"
        raise BindingError(
            f"{recording.path.name}: joint '{name}': {printable(far.name)} is on header stamps and"
            f" {printable(others[0].name)} on {others[0].time_source} time, and in {printable(far.name)} the two are"
            f" {abs(far.delay_median):.3g} s apart; --time log puts all on one clock{header}"
        )
    return (
        Finding(
            code="recording.clocks_apart",
            joint=name,
            value=abs(far.delay_median),
            limit=LEAST_CLOCK_SKEW,
            unit="s",
            evidence={
                "stamped": printable(far.name),
                "other": printable(others[0].name),
                "clock": others[0].time_source,
            },
        ),
    )


def _lacks_stamps(stream: Stream) -> bool:
    """Return whether a stream should have header stamps and has none."""
    found = stream.time_finding
    return found is not None and found.code == "clock.not_recorded" and found.evidence["asked"] == "header"
