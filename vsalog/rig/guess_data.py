"""Tests of guesses from names by the recording's numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.core.dependence import LEAST_BLOCKS, block_moments
from vsalog.core.errors import UnitError
from vsalog.core.precision import ROUNDING
from vsalog.core.recording import Channel
from vsalog.core.resolution import ENOUGH
from vsalog.core.significance import SIGNIFICANCE
from vsalog.core.units import is_counts, si_factor
from vsalog.filters.outliers import Outliers

Array = NDArray[np.float64]

EXACT = 1e-3
"""Relative residual below which one channel was computed from the other: no two sensors agree to a part in a thousand."""
CORRELATED = 0.8
"""Correlation from which on one channel follows the other: a spring's torque its angle."""


@dataclass(frozen=True, slots=True)
class Line:
    """Least-squares line y = slope · x + intercept.

    Attributes
    ----------
    slope, intercept : of the line
    correlation : of x and y, −1 … 1
    residual : RMS residual of the line, relative to the standard deviation of y
    """

    slope: float
    intercept: float
    correlation: float
    residual: float


def without_outliers(channel: Channel) -> Channel:
    """Return a channel with NaN for the outliers that no motion makes: one of them decides a correlation."""
    alone = Outliers(channel.values).among(channel.values) if channel.values.size > 1 else None
    return channel if alone is None else replace(channel, values=np.where(alone, np.nan, channel.values))


def is_constant(channel: Channel) -> bool:
    """Return whether a channel never changes, or contains no number."""
    finite = channel.values[np.isfinite(channel.values)]
    return finite.size == 0 or float(np.ptp(finite)) <= 1e-12 * float(np.abs(finite).max(initial=0.0))


def span(channel: Channel) -> float:
    """Return largest minus smallest value; 0 where there is none."""
    finite = channel.values[np.isfinite(channel.values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def looks_like_counts(channel: Channel) -> bool:
    """Return whether an angle is raw counts: by its unit, or, without one, by whole numbers beyond a turn of radians."""
    if channel.unit:
        return is_counts(channel.unit)
    finite = channel.values[np.isfinite(channel.values)]
    return finite.size > 0 and bool(np.all(finite == np.round(finite))) and float(np.ptp(finite)) > 6.0


def counts_of_turn(channel: Channel) -> int | None:
    """Return after how many counts an encoder wraps to zero, None where it does not.

    It jumps by most of the power of two that contains its counts: by more than half, since less could be a motion.
    """
    finite = channel.values[np.isfinite(channel.values)]
    if finite.size < 2 or finite.min() < 0.0 or not 1.0 < finite.max() < 2.0**53:
        return None
    turn = 1 << int(finite.max()).bit_length()
    return turn if float(np.abs(np.diff(finite)).max()) > 0.5 * turn else None


def si_of(channel: Channel, unit: str | None, like: str = "rad") -> float | None:
    """Return the factor from a channel to SI; None for raw counts and for a unit of something else.

    Parameters
    ----------
    channel : of the role
    unit : that its name or its numbers show, instead of the log's; None for none
    like : the role's unit
    """
    stated = unit or channel.unit or like
    if like == "rad" and (looks_like_counts(channel) or is_counts(stated)):
        return None
    try:
        return si_factor(stated, like)
    except UnitError:
        return None


def together(*channels: Channel) -> tuple[Array, ...]:
    """Return the channels' values at the same instants, spread over the log, rows with a NaN left out.

    The first channel's stamps are used; the others are interpolated where they are on another clock.
    """
    base = channels[0].stamps
    if any(c.stamps.size == 0 for c in channels):
        return tuple(np.empty(0) for _ in channels)
    step = max(1, base.size // ENOUGH)
    rows = []
    for channel in channels:
        if channel.stamps is base or np.array_equal(channel.stamps, base):
            rows.append(channel.values[::step])
        else:
            origin = base[0]
            at, known = (base[::step] - origin).astype(np.float64), (channel.stamps - origin).astype(np.float64)
            rows.append(np.interp(at, known, channel.values, left=np.nan, right=np.nan))
    usable = np.all(np.isfinite(np.vstack(rows)), axis=0)
    return tuple(row[usable] for row in rows)


def line(x: Array, y: Array) -> Line | None:
    """Fit a line; None where there are too few samples, or one of them never changes."""
    if x.size < 10:
        return None
    dx, dy = x - x.mean(), y - y.mean()
    sx, sy = float(np.sqrt(np.mean(dx**2))), float(np.sqrt(np.mean(dy**2)))
    if sx <= 1e-12 * float(np.abs(x).max()) or sy <= 1e-12 * float(np.abs(y).max()):
        return None
    # Normalised first: the raw products of a deflection of 1e-9 rad would be lost in rounding.
    correlation = float(np.mean((dx / sx) * (dy / sy)))
    residual = float(np.sqrt(np.mean((dy / sy - correlation * dx / sx) ** 2)))
    slope = correlation * sy / sx
    return Line(slope, float(y.mean() - slope * x.mean()), correlation, residual)


@dataclass(frozen=True, slots=True)
class Ratio:
    """How many times as far as a link a motor moves.

    Attributes
    ----------
    value : as estimated
    low, high : a 95 % interval; NaN where the deflection, which moves the link too, is not known
    """

    value: float
    low: float = math.nan
    high: float = math.nan

    def times(self, factor: float) -> Ratio:
        """Return the ratio in other units."""
        return Ratio(self.value * factor, self.low * factor, self.high * factor)

    def holds(self, value: float) -> bool:
        """Return whether the interval contains a number."""
        return self.low <= value <= self.high

    @property
    def wholes(self) -> range:
        """The whole numbers in the interval."""
        return range(0) if math.isnan(self.low) else range(math.ceil(self.low), math.floor(self.high) + 1)


def ratio_between(motor: Channel, link: Channel, springs: Sequence[Channel]) -> Ratio | None:
    """Return how many times as far as the link the motor moves, by the numbers as recorded; None where they are not related.

    A channel in proportion to the deflection explains its part of the link's motion. The regressions on each channel then bound
    the ratio, whatever the errors of the channels are (Klepper and Leamer, "Consistent sets of estimates for regressions with
    errors in all variables", Econometrica 52, 1984). Their range is widened by its sampling error, by a jackknife over blocks of
    time, and by the unexplained part of the link's motion, all of which may follow the motor.

    Parameters
    ----------
    motor, link : as recorded
    springs : torques or deflections of the spring between them; the first that bounds the ratio is used
    """
    between = gear_between(motor, link)
    if between is None or between.slope == 0.0:
        return None
    for spring in springs:
        rows = np.column_stack(together(motor, link, spring))
        rows = rows - rows.mean(axis=0)
        size = np.sqrt(np.mean(rows**2, axis=0))
        if len(rows) < LEAST_BLOCKS * len(size) or not size.all():
            continue
        moments = block_moments(rows / size, np.arange(len(rows)) * LEAST_BLOCKS // len(rows)) / len(rows)
        logs, unexplained = _log_slopes(whole := moments.sum(axis=0))
        without = np.array([_log_slopes(whole - one)[0] for one in moments])
        deviation = np.sqrt((LEAST_BLOCKS - 1) * np.var(without, axis=0))
        reach = unexplained + float(special.stdtrit(LEAST_BLOCKS - 1, 1.0 - 0.5 * SIGNIFICANCE)) * deviation
        if np.isfinite(logs + reach).all():
            ends = np.array([0.5 * (logs.min() + logs.max()), (logs - reach).min(), (logs + reach).max()])
            return Ratio(*(np.exp(ends) * size[0] / size[1]).tolist())
    return Ratio(1.0 / abs(between.slope))


def _log_slopes(moments: Array) -> tuple[Array, float]:
    """Return the logarithm of the first over the second column by the regression on each column, NaN where signs differ; and
    the part of the second one that the others do not explain.

    Parameters
    ----------
    moments : shape (K, K), of centred columns of size 1
    """
    # Row i of the inverse is normal to the plane fitted with errors in column i only. Rounding is the least error.
    normals = np.linalg.inv(moments + ROUNDING * np.eye(len(moments)))
    signs = np.sign(normals * normals[:, 1:2])
    slopes = np.log(np.abs(normals[:, 1] / normals[:, 0]))
    alike = bool((signs == signs[0]).all())
    return np.asarray(slopes if alike else np.full_like(slopes, np.nan)), float(normals[1, 1]) ** -0.5


def gear_between(motor: Channel, link: Channel) -> Line | None:
    """Return link = slope · motor + intercept, as recorded, when the two clearly move together, else None."""
    found = line(*together(motor, link))
    return found if found is not None and abs(found.correlation) > 0.9 else None


def torque_over_deflection(torque: Channel, deflection: Channel) -> Line | None:
    """Return torque = slope · deflection + …, None where nothing can be fitted."""
    return line(*together(deflection, torque))


def is_the_same(one: Channel, other: Channel) -> bool:
    """Return whether two channels have the same numbers except for a lag: a command and its result."""
    x, y = together(one, other)
    spread = float(np.var(x)) if x.size else 0.0
    return spread > 0.0 and 1.0 - float(np.mean((y - x) ** 2)) / spread > CORRELATED


def torque_over_difference(torque: Channel, link: Channel, motor: Channel, gear: float) -> Line | None:
    """Return torque = slope · (link − motor / gear) + …, None where nothing can be fitted.

    Parameters
    ----------
    torque, link, motor : as recorded
    gear : motor's numbers per number of the link, units included
    """
    values, q, theta = together(torque, link, motor)
    return line(q - theta / gear, values)
