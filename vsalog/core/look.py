"""Stretches of a log that is too long for memory, for properties that do not need every sample of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import PART, T, let_go, parts
from vsalog.core.recording import Channel, Recording, Values
from vsalog.core.resolution import STRETCHES
from vsalog.core.signals import JointSignals

Rows = Sequence[tuple[int, int]]

LOOK_BYTES = 64 * 2**20
"""Bytes of a log that are read, in stretches, and that these take in memory: about one second of reading."""

# Rows of a stretch of signals, as many as methods take in one piece; and of the longest run, which holds the longest window.
STRETCH, LONGEST_RUN = PART, 2 * PART
# Rows of a log in memory above which checks of the whole log's relations use stretches of it.
LOOK_ROWS = STRETCHES * STRETCH


def of_recording(recording: Recording) -> Recording:
    """Return a recording of which each stream that is in files has stretches, spread evenly from its first sample to its last.

    A channel that is mostly empty gets a stretch with numbers.
    """
    if not recording.in_file:
        return recording
    channels: dict[str, Channel] = {}
    rows = LOOK_BYTES // (8 * max(1, len(recording.channels) + len(recording.streams)))
    for stream in {channel.stream for channel in recording.channels.values()}:
        own = {name: channel for name, channel in recording.channels.items() if channel.stream == stream}
        channels |= _of_stream(own, rows)
    return replace(recording, channels={name: channels[name] for name in recording.channels})


def _of_stream(own: Mapping[str, Channel], rows: int) -> dict[str, Channel]:
    count = len(next(iter(own.values())).stamps)
    seen = stretches(count, rows)
    values = {name: joined(channel.values, seen) for name, channel in own.items()}
    for name in [name for name, some in values.items() if not np.isfinite(some).any()]:
        begin = _first_number(own[name].values)
        if begin is not None:
            seen = _merged([*seen, (begin, min(count, begin + rows // STRETCHES))])
            values = {other: joined(channel.values, seen) for other, channel in own.items()}
    stamps = joined(next(iter(own.values())).stamps, seen)
    return {name: replace(channel, stamps=stamps, values=values[name]) for name, channel in own.items()}


def of_signals(signals: JointSignals) -> JointSignals:
    """Return stretches from which filters, scales and priors can be derived; all of it where signals are in memory.

    They are spread evenly. Those in which a signal or a deflection is greatest or least are among them, so that its range is
    the whole log's, and so is the beginning of the longest run.
    """
    if not signals.in_file:
        return signals
    count = -(-len(signals) // STRETCH)
    spread = np.linspace(0, count - 1, STRETCHES).astype(int).tolist()
    chosen = sorted({*spread, *_longest(signals), *_extremes(signals)})
    return _of_rows(signals, _merged([(k * STRETCH, min((k + 1) * STRETCH, len(signals))) for k in chosen]))


def spread_over(signals: JointSignals, rows: int) -> JointSignals:
    """Return evenly spread stretches of signals, about `rows` rows in total; all rows where there are no more."""
    return signals if len(signals) <= rows else _of_rows(signals, stretches(len(signals), rows))


def _of_rows(signals: JointSignals, seen: Rows) -> JointSignals:
    """Return separate stretches of signals."""
    starts = joined(signals.starts, seen)
    starts[np.cumsum([0, *(last - first for first, last in seen[:-1])])] = True
    return replace(
        signals,
        stamps=joined(signals.stamps, seen),
        time=joined(signals.time, seen),
        roles={role: joined(values, seen) for role, values in signals.roles.items()},
        starts=starts,
        run=joined(signals.run, seen),
    )


def _longest(signals: JointSignals) -> range:
    """Return the stretches at the beginning of the longest run."""
    first, last = max(
        pairwise([*np.flatnonzero(signals.starts).tolist(), len(signals)]), key=lambda run: run[1] - run[0]
    )
    return range(first // STRETCH, -(-min(last, first + LONGEST_RUN) // STRETCH))


def _extremes(signals: JointSignals) -> set[int]:
    """Return the stretches in which a signal or a deflection is greatest or least."""
    found: dict[str, list[tuple[float, float]]] = {}
    for block in signals.blocks(STRETCH):
        for name, values in _moving(block.roles):
            finite = values[np.isfinite(values)]
            ends = (float(finite.min()), float(finite.max())) if finite.size else (np.inf, -np.inf)
            found.setdefault(name, []).append(ends)
    extremes: set[int] = set()
    for all_ends in found.values():
        low, high = np.array(all_ends).T
        extremes |= {int(np.argmin(low)), int(np.argmax(high))}
    return extremes


def _moving(roles: Mapping[str, Values]) -> Iterator[tuple[str, Values]]:
    """Yield the signals and the deflections computed from them."""
    yield from roles.items()
    if "link_position" in roles:
        for role, values in roles.items():
            if role.startswith("motor_position"):
                yield f"deflection of {role}", roles["link_position"] - values


def stretches(count: int, rows: int) -> list[tuple[int, int]]:
    """Return first and last row, that one excluded, of stretches that have about `rows` rows in all."""
    if count <= rows:
        return [(0, count)]
    length = max(1, rows // STRETCHES)
    return [(int(first), int(first) + length) for first in np.linspace(0, count - length, STRETCHES)]


def joined(column: NDArray[T], rows: Rows) -> NDArray[T]:
    """Return stretches of a column as one array in memory."""
    found = np.concatenate([column[first:last] for first, last in rows])
    let_go(*(column[first:last] for first, last in rows))
    return found


def _merged(rows: Rows) -> list[tuple[int, int]]:
    """Return stretches in order, those that overlap merged."""
    merged: list[tuple[int, int]] = []
    for first, last in sorted(rows):
        if merged and first <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(last, merged[-1][1])
        else:
            merged.append((first, last))
    return merged


def _first_number(values: Values) -> int | None:
    """Return the first row with a finite number; None where there is none."""
    for first, last in parts(values):
        finite = np.isfinite(values[first:last])
        if finite.any():
            return first + int(np.argmax(finite))
    return None
