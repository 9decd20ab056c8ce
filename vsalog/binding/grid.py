"""Resamples channels on different clocks to one uniform grid; nothing is interpolated across a gap."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import BindingError
from vsalog.core.resolution import noise_of, step_of
from vsalog.core.signals import Interpolated

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]

LONGEST_GAP = 2.5
"""Longest gap within a run [periods of the channel] that is interpolated: one lost sample and jitter, across which a motion is
nearly a cubic."""

MOST_JITTER = 0.02
"""Largest deviation of stamps from an even spacing to be used as they are [periods]: the jitter of a recorder's clock."""

MOST_RATE_ERROR = 5e-4
"""Part by which a run's rate may differ from the grid's for its samples to be used as they are [1]: a second derivative is then
wrong by twice that, a part in a thousand, as by a filter. Jitter averages out, a rate does not."""


class Silence(NamedTuple):
    """How long a role may have no number within a run.

    Attributes
    ----------
    longest : rows: half the usual window of a filter, which then has as many samples as it lacks; whether these determine what is
        wanted is the filter's to say (`filters.savitzky_golay.Lacking`)
    """

    longest: int = 25


SILENCE = Silence()


@dataclass(frozen=True, slots=True)
class Bound:
    """A part of a role of one run: its stamps, SI values, period [ns] and least step; and the stamps of the samples that are left
    out because they were outliers or held.
    """

    stamps: Stamps
    values: Array
    period: int
    resolution: float | None = None
    alone: Stamps | None = None
    held: Stamps | None = None


def less(values: Array, out: Flags | None) -> Array:
    """Return values, NaN where they are left out; None leaves out nothing."""
    return values if out is None else np.where(out, np.nan, values)


def stamps_where(b: Bound, flags: Flags | None) -> Stamps | None:
    """Return the stamps of the selected samples of a role; None where there are none."""
    return None if flags is None else b.stamps[flags]


def common_segments(log: str, joint: str, stretches: Iterable[list[tuple[int, int]]]) -> list[tuple[int, int]]:
    """Return the stretches of time, first and last stamp, in which every role has samples without a gap.

    Parameters
    ----------
    log, joint : their names
    stretches : those of each role, in order

    Raises
    ------
    BindingError
        There is none.
    """
    segments: list[tuple[int, int]] | None = None
    for own in stretches:
        segments = own if segments is None else _overlap(segments, own)
    if not segments:
        raise BindingError(
            f"{log}: the channels of joint '{joint}' have no time in common; are they on different"
            " clocks? 'vsalog inspect' shows when each begins and ends"
        )
    return segments


def after_long_silence(roles: Mapping[str, Array], before: int = 0) -> tuple[Flags, int]:
    """Return where a run begins again because a role had no number for longer than `Silence.longest`, and the length so far.

    Parameters
    ----------
    roles : shape (n,) each, NaN where a role has no number
    before : number of samples without a number right before these
    """
    missing = np.zeros(next(iter(roles.values())).size, dtype=np.bool_)
    for values in roles.values():
        missing |= np.isnan(values)
    starts = np.zeros(missing.size, dtype=np.bool_)
    if not missing.any():
        starts[:1] = before > SILENCE.longest
        return starts, 0
    edges = np.flatnonzero(np.diff(np.concatenate(([before > 0], missing, [False])).astype(np.int8)))
    if before > 0:
        edges = np.concatenate(([-before], edges))
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        if after - first > SILENCE.longest and after < missing.size:
            starts[after] = True
    return starts, int(edges[-1] - edges[-2]) if missing[-1] else 0


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


def lacks_samples(steps: Stamps | Array, period: int) -> Flags:
    """Return which steps between stamps [ns] lack samples: those that are nearer to two periods than to one."""
    return np.asarray(np.rint(steps / period) > 1)


def is_even(least: int, greatest: int, period: int) -> bool:
    """Return whether stamps are even, by the least and the greatest of their steps [ns]."""
    return max(greatest - period, period - least) <= MOST_JITTER * period


def on_grid(b: Bound, stamps: Stamps) -> Array:
    """Values at the grid's stamps: unchanged where they are on it, interpolated otherwise.

    Between neighbours a value is on the line, and where the sample between them was lost on the cubic through two on either
    side: of a motion that swings with ω a line misses (ω T)² / 2, which many lost samples make a bias of the filtered motion.
    """
    b = bridged(b)
    first = _first_on(b, stamps)
    if first is not None:
        return b.values[first : first + stamps.size]
    v0, v1, share, apart = _between(b, stamps)
    values = np.where(share == 0.0, v0, np.where(share == 1.0, v1, v0 + share * (v1 - v0)))
    between = (share > 0.0) & (share < 1.0)
    values[between & (apart > LONGEST_GAP * b.period)] = np.nan
    lost = np.flatnonzero(between & lacks_samples(apart, b.period))
    if lost.size:
        known = np.isfinite(b.values)
        values[lost] += _bent(b.stamps[known], b.values[known], stamps[lost], b.period)
    return np.asarray(values, dtype=np.float64)


def filled(last: int, first: int, period: int) -> Stamps:
    """Return the stamps of the rows that are lost between two, evenly spaced.

    None where a run ends: there are more than `Silence.longest`, or the rows after them are between the grid's.
    """
    steps = round((first - last) / period)
    if not 1 < steps <= SILENCE.longest + 1 or abs(first - last - steps * period) > 2.0 * MOST_JITTER * period:
        return np.empty(0, np.int64)
    return np.asarray(last + (first - last) * np.arange(1, steps, dtype=np.int64) // steps, dtype=np.int64)


@dataclass(slots=True)
class OffGrid:
    """The positions of a role's samples between the grid's stamps, gathered block by block.

    Attributes
    ----------
    rows : of the grid
    apart, power : sums of the distances [ns] between samples, and of the squares of their weights
    off : whether any row is between samples
    """

    rows: int = 0
    apart: float = 0.0
    power: float = 0.0
    off: bool = False

    def add(self, b: Bound, stamps: Stamps) -> None:
        """Take the next block of the grid into account."""
        _, _, share, apart = _between(b, stamps)
        self.rows, self.off = self.rows + stamps.size, self.off or _first_on(b, stamps) is None
        self.apart += float(np.sum(apart))
        self.power += float(np.sum((1.0 - share) ** 2 + share**2))

    def noise(self, look: Bound, period: int) -> Interpolated:
        """Return the noise of a role, of which some samples are given, on a grid of that period [ns].

        White noise of deviation σ at samples that are Δt apart has the density σ² Δt; on the grid, σ √(Δt/T) has that.
        """
        look = bridged(look)
        time = (look.stamps - look.stamps[0]).astype(np.float64)
        step = step_of(look.values) or 0.0
        noise = max(noise_of(look.values, time=time) or 0.0, step / 12.0**0.5)
        density = noise * float(self.apart / self.rows / period) ** 0.5
        shown = noise * float(self.power / self.rows) ** 0.5
        return Interpolated(density, shown / density if density else 1.0)


def _first_on(b: Bound, stamps: Stamps) -> int | None:
    """Return the first of a role's samples on the grid; None where not all rows are samples."""
    first = int(np.searchsorted(b.stamps, stamps[0]))
    return first if np.array_equal(b.stamps[first : first + stamps.size], stamps) else None


def _between(b: Bound, stamps: Stamps) -> tuple[Array, Array, Array, Array]:
    """Return for each of the grid's stamps the values before and after it, its position between them, 0 to 1, and their distance
    in time [ns].
    """
    # Relative to the first stamp: nanoseconds since the epoch do not fit into the digits of a float.
    origin = stamps[0]
    after = np.clip(np.searchsorted(b.stamps, stamps), 1, b.stamps.size - 1)
    t0, t1 = b.stamps[after - 1], b.stamps[after]
    share = ((stamps - origin) - (t0 - origin)) / (t1 - t0)
    return b.values[after - 1], b.values[after], share, (t1 - t0).astype(np.float64)


def bridged(b: Bound) -> Bound:
    """Return a role without the rows that lack a number, which are then interpolated as lost rows are.

    Those whose neighbours with numbers are a gap apart stay.
    """
    known = np.isfinite(b.values)
    if known.all() or known.sum() < 2:
        return b
    stamps = b.stamps[known]
    missing = np.flatnonzero(~known)
    after = np.searchsorted(stamps, b.stamps[missing])
    inside = (after > 0) & (after < stamps.size)
    missing, after = missing[inside], after[inside]
    kept = np.ones(known.size, dtype=np.bool_)
    kept[missing[stamps[after] - stamps[after - 1] <= LONGEST_GAP * b.period]] = False
    return replace(b, stamps=b.stamps[kept], values=b.values[kept])


def _bent(stamps: Stamps, values: Array, at: Stamps, period: int) -> Array:
    """Return by how much the cubic through two samples on either side differs from the line between the inner ones.

    It is 0 where a sample of the four is missing or beyond a gap, and where the signal is constant exactly.

    Parameters
    ----------
    stamps, values : of the samples, without missing ones
    at : stamps between them, shape (n,)
    period : of the channel [ns]
    """
    first = np.searchsorted(stamps, at) - 2
    curved = np.zeros(at.size)
    inside = np.flatnonzero((first >= 0) & (first + 3 < stamps.size))
    four = first[inside, None] + np.arange(4)
    near = np.all(np.diff(stamps[four], axis=1) <= LONGEST_GAP * period, axis=1)
    four, inside = four[near], inside[near]
    t = ((stamps[four] - at[inside, None]) / period).T
    # Newton's divided differences, in periods from where the value is wanted.
    slope = np.diff(values[four], axis=1).T / np.diff(t, axis=0)
    second = np.diff(slope, axis=0) / (t[2:] - t[:-2])
    third = (second[1] - second[0]) / (t[3] - t[0])
    curved[inside] = t[1] * t[2] * (second[0] - t[0] * third)
    return curved
