"""Runs in a log: several groups of equal channels, distinguished by a number in the group's name."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

from vsalog.core.recording import Recording
from vsalog.rig.guess_names import LINK, MOTOR, SECONDARY, SENSOR, words_of

_COUNTERS = frozenset(
    (
        "run",
        "trial",
        "exp",
        "experiment",
        "test",
        "rep",
        "repetition",
        "cycle",
        "take",
        "segment",
        "log",
        "recording",
        "part",
    )
)
_PARTS = MOTOR | LINK | SENSOR | SECONDARY | {"joint", "axis", "arm", "leg", "finger"}
_SEPARATOR = re.compile(r"([./])")
_NUMBER = re.compile(r"\d+(?:p\d+)?")


@dataclass(frozen=True, slots=True)
class RunGroup:
    """Streams that are runs of one experiment.

    Attributes
    ----------
    template : the streams' common name with ``{run}`` in it
    names : the values of ``{run}``, in the log's order
    streams : the streams, in the same order
    numbers : set-points as the names give them, without a unit; empty where the names just count
    left_out : streams that look alike but do not fit
    """

    template: str
    names: tuple[str, ...]
    streams: tuple[str, ...]
    numbers: tuple[float, ...]
    left_out: tuple[str, ...]


def find_runs(recording: Recording) -> RunGroup | None:
    """Return the largest group of streams that are runs, or None."""
    fields = _fields(recording)
    groups: dict[tuple[str, frozenset[str]], list[tuple[str, str]]] = defaultdict(list)
    for stream in fields:
        for template, name in _templates(stream):
            groups[template, fields[stream]].append((name, stream))
    candidates = [(template, members) for (template, _), members in groups.items() if _are_runs(recording, members)]
    if not candidates:
        return None
    template, members = max(candidates, key=lambda c: len(c[1]))
    names = tuple(name for name, _ in members)
    streams = tuple(stream for _, stream in members)
    alike = fields[streams[0]]
    left_out = tuple(s for s in fields if s not in streams and fields[s] & alike)
    return RunGroup(template, names, streams, _set_points(names), left_out)


def _fields(recording: Recording) -> dict[str, frozenset[str]]:
    """Return the names of each stream's channels without the stream's own name."""
    found: dict[str, set[str]] = defaultdict(set)
    for channel in recording.channels.values():
        if channel.name.startswith(channel.stream + "."):
            found[channel.stream].add(channel.name[len(channel.stream) :])
    return {stream: frozenset(names) for stream, names in found.items()}


def _templates(stream: str) -> Iterable[tuple[str, str]]:
    """Yield the stream's name with one of its parts, one that has a number, replaced by ``{run}``, and that part."""
    parts = _SEPARATOR.split(stream)
    for i, part in enumerate(parts):
        if any(c.isdigit() for c in part):
            yield "".join([*parts[:i], "{run}", *parts[i + 1 :]]), part


def _are_runs(recording: Recording, members: list[tuple[str, str]]) -> bool:
    """Distinguish runs from parts of one machine that were recorded together."""
    if len(members) < 2:
        return False
    if any(set(words_of(name)) & _PARTS for name, _ in members):
        return False
    stems = {_NUMBER.sub("", name) for name, _ in members}
    if len(stems) > 1:
        return False
    return not (recording.absolute_time and _overlap(recording, [stream for _, stream in members]))


def _overlap(recording: Recording, streams: list[str]) -> bool:
    spans = {
        (int(channel.stamps[0]), int(channel.stamps[-1]), channel.stream)
        for channel in recording.channels.values()
        if channel.stream in streams and channel.stamps.size
    }
    return any(b[0] < a[1] and a[2] != b[2] for a, b in pairwise(sorted(spans)))


def _set_points(names: tuple[str, ...]) -> tuple[float, ...]:
    """Return the numbers in the names; none where they only count, or are not one number each."""
    if any(set(words_of(name)) & _COUNTERS for name in names):
        return ()
    found = [_NUMBER.findall(name) for name in names]
    if any(len(numbers) != 1 for numbers in found):
        return ()
    values = tuple(float(numbers[0].replace("p", ".")) for numbers in found)
    return values if len(set(values)) == len(values) else ()
