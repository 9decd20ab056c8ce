"""Channels on clocks of their own, brought onto one uniform grid; nothing is interpolated across a gap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsalog.errors import BindingError
from vsalog.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]

# A gap longer than this many sample times of a channel ends the run.
GAP = 2.5
# Stamps that stray less than this share of the period from an even spacing are on the grid as they are.
EVEN = 0.02


@dataclass(frozen=True, slots=True)
class Bound:
    """One role of one run: its stamps and SI values, or a constant; whether it is a position that began anew after a turn, and
    the stamps of the samples that stood alone and are left out.
    """

    stamps: Stamps
    values: Array
    period: int
    resolution: float | None = None
    constant: float | None = None
    wrapped: bool = False
    alone: Stamps | None = None


def common_segments(recording: Recording, joint: str, moving: Mapping[str, Bound]) -> list[tuple[int, int]]:
    """Stretches of time, first and last stamp, in which every role has samples without a gap."""
    segments: list[tuple[int, int]] | None = None
    for b in moving.values():
        gaps = np.flatnonzero(np.diff(b.stamps) > GAP * b.period)
        edges = [0, *(gaps + 1), b.stamps.size]
        own = [(int(b.stamps[i]), int(b.stamps[j - 1])) for i, j in pairwise(edges) if j - i > 1]
        segments = own if segments is None else _overlap(segments, own)
    if not segments:
        raise BindingError(
            f"{recording.path.name}: the channels of joint '{joint}' have no time in common; are they on different"
            " clocks? 'vsalog inspect' shows when each begins and ends"
        )
    return segments


def after_long_silence(roles: Mapping[str, Array]) -> Flags:
    """Where a run begins anew because a role had no number for longer than a gap may be."""
    missing = np.zeros(next(iter(roles.values())).size, dtype=np.bool_)
    for values in roles.values():
        missing |= np.isnan(values)
    starts = np.zeros(missing.size, dtype=np.bool_)
    if missing.any():
        edges = np.flatnonzero(np.diff(np.concatenate(([False], missing, [False])).astype(np.int8)))
        for first, after in zip(edges[::2], edges[1::2], strict=True):
            if after - first >= GAP and after < missing.size:
                starts[after] = True
    return starts


def _overlap(a: list[tuple[int, int]], b: list[tuple[int, int]]) -> list[tuple[int, int]]:
    out, i, j = [], 0, 0
    while i < len(a) and j < len(b):
        first, last = max(a[i][0], b[j][0]), min(a[i][1], b[j][1])
        if last > first:
            out.append((first, last))
        if a[i][1] < b[j][1]:
            i += 1
        else:
            j += 1
    return out


def grid_of(segment: tuple[int, int], moving: Mapping[str, Bound], period: int) -> Stamps:
    """Stamps of the fastest channel where these are even, evenly spaced ones otherwise."""
    first, last = segment
    fastest = min(moving.values(), key=lambda b: b.period)
    own = fastest.stamps[np.searchsorted(fastest.stamps, first) : np.searchsorted(fastest.stamps, last, "right")]
    steps = np.diff(own)
    if own.size > 1 and max(steps.max() - period, period - steps.min()) <= EVEN * period:
        return own
    return first + period * np.arange((last - first) // period + 1, dtype=np.int64)


def on_grid(b: Bound, stamps: Stamps) -> Array:
    """Values at the grid's stamps: as they are where they lie on it, linearly between neighbours otherwise."""
    if b.stamps.size == stamps.size and np.array_equal(b.stamps, stamps):
        return b.values
    # Relative to the first stamp: nanoseconds since the epoch do not fit into the digits of a float.
    origin = stamps[0]
    after = np.clip(np.searchsorted(b.stamps, stamps), 1, b.stamps.size - 1)
    t0, t1 = b.stamps[after - 1], b.stamps[after]
    v0, v1 = b.values[after - 1], b.values[after]
    share = ((stamps - origin) - (t0 - origin)) / (t1 - t0)
    exact = np.where(stamps == t0, v0, np.where(stamps == t1, v1, v0 + share * (v1 - v0)))
    return np.asarray(exact, dtype=np.float64)
