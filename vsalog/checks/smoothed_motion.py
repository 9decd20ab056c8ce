"""A joint's roles through one filter: value, rate and acceleration of each at the same instants.

A linear equation with constant coefficients that holds for channels also holds after one common filter: the filter's width
does not affect the comparison.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from vsalog.core.precision import ROUNDING
from vsalog.core.resolution import ROUNDED, noise_of, sensor_noise, step_of
from vsalog.core.signals import JointSignals

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


class Filter(NamedTuple):
    """How a joint's channels are filtered before they are compared.

    Attributes
    ----------
    rows : instants at which equations are compared with channels: a fit to them takes a millisecond
    widest : standard deviation of the widest filter as part of the log: hundreds of independent rows are left
    narrowest : standard deviation of the narrowest [samples]: its derivatives are those of a Gaussian still
    noise_share : part of an acceleration's mean square that an encoder's noise makes at most, if a filter is wide enough
    reach : standard deviations beyond which a Gaussian is truncated: 6e-5 of it are beyond
    """

    rows: int = 1500
    widest: float = 1 / 200
    narrowest: float = 2.0
    noise_share: float = 0.01
    reach: float = 4.0


FILTER = Filter()


@dataclass(frozen=True, slots=True)
class Motion:
    """Roles of a joint through a Gaussian filter.

    Attributes
    ----------
    period : of the samples [s]
    width : standard deviation of the filter [samples]
    values : role → value, rate and acceleration, shape (3, N); what the filter reached across a gap is not `known`
    known : role → shape (N,)
    noise : role → its sensor's noise and quantisation through the filter, shape (3, N)
    rows : instants at which equations are formed, shape (R,), ascending; farther inside than they may be moved
    reach : samples by which they may be moved
    """

    period: float
    width: float
    values: Mapping[str, Array]
    known: Mapping[str, Flags]
    noise: Mapping[str, Array]
    rows: Integers
    reach: int


def exchanged(one: Motion, other: Motion, role: str) -> Motion:
    """Return a joint's motion with another one's role, which passed through the same filter."""
    return replace(
        one,
        values={**one.values, role: other.values[role]},
        known={**one.known, role: other.known[role]},
        noise={**one.noise, role: other.noise[role]},
    )


def motion_of(signals: JointSignals, longest_delay: float, width: float | None = None) -> Motion | None:
    """Pass a joint's moving roles through the narrowest filter that leaves encoders' noise out of accelerations.

    Parameters
    ----------
    signals : of the joint
    longest_delay : by which rows may be moved [s]
    width : standard deviation of the filter [samples]; that of the narrowest which does where absent

    Returns
    -------
    None where the log is too short.
    """
    moving = {role: x for role, x in signals.roles.items() if np.nanmax(x) > np.nanmin(x)}
    count, widest = len(signals), FILTER.widest * len(signals)
    if widest < FILTER.narrowest or not moving:
        return None
    gap = signals.starts.copy()
    gap[0] = False
    width = width or _width(signals, moving, gap, widest)
    reach = int(min(longest_delay / signals.period, count / 8))
    edge = int(FILTER.reach * width) + 1 + reach
    if count < 2 * edge + FILTER.rows // 10:
        return None
    rows = np.unique(np.linspace(edge, count - 1 - edge, FILTER.rows).astype(np.int64))
    values, known, noise = dict[str, Array](), dict[str, Flags](), dict[str, Array]()
    for role, x in moving.items():
        values[role], known[role] = _passed(x, gap, width, signals.period)
        again = _read_again(x, values[role][0], signals.resolution.get(role, 0.0))
        noise[role] = _passed(again - values[role][0], gap, width, signals.period)[0]
    return Motion(signals.period, width, values, known, noise, rows, reach)


def _width(signals: JointSignals, moving: Mapping[str, Array], gap: Flags, widest: float) -> float:
    """Return the standard deviation of the narrowest filter that leaves noise out of accelerations [samples]."""
    positions = [role for role in moving if role.startswith(("motor_position", "link_position", "deflection"))]
    noises = {role: noise_of(moving[role], signals.resolution.get(role, 0.0)) or 0.0 for role in positions}
    width = FILTER.narrowest
    while width < widest and any(_is_noisy(moving[role], gap, noises[role], width) for role in positions):
        width *= 1.5
    return min(width, widest)


def _is_noisy(x: Array, gap: Flags, noise: float, width: float) -> bool:
    """Return whether noise is more than a small part of a filtered signal's second differences; a gap's jump is no motion."""
    if noise == 0.0:
        return False
    kernel = _kernels(width)[2]
    filled, touched = _filled(x, gap, kernel.size)
    inner = slice(kernel.size, -kernel.size)
    acceleration = _convolved(filled, kernel)[inner][~touched[inner]]
    return acceleration.size == 0 or noise**2 * float(kernel @ kernel) > FILTER.noise_share * float(
        np.mean(acceleration**2)
    )


def _read_again(recorded: Array, smooth: Array, step: float) -> Array:
    """Return what a sensor of the same step and noise would read of the smooth signal, its steps at other places."""
    # A fixed seed makes findings repeatable.
    draw = np.random.default_rng(0)
    if step_of(recorded) is None:
        # A signal without steps gets those of its noise, which is white.
        return np.asarray(smooth + sensor_noise(recorded, step, ROUNDING) * draw.standard_normal(smooth.size))
    total = sensor_noise(recorded, 0.0, ROUNDING)
    white = float(np.sqrt(max(total**2 - (step * ROUNDED) ** 2, 0.0))) if step else total
    read = smooth + white * draw.standard_normal(smooth.size)
    return np.asarray(step * np.round(read / step + 0.5) - 0.5 * step if step else read)


def _passed(x: Array, gap: Flags, width: float, period: float) -> tuple[Array, Flags]:
    kernels = _kernels(width)
    filled, touched = _filled(x, gap, kernels[0].size)
    parts = [_convolved(filled, kernel) / period**order for order, kernel in enumerate(kernels)]
    parts[0] += float(np.mean(x[np.isfinite(x)]))
    return np.array(parts), ~touched


def _filled(x: Array, gap: Flags, reach: int) -> tuple[Array, Flags]:
    """Return a signal minus its mean, 0 where missing; and where a kernel of `reach` samples covers a missing one or a gap."""
    missing = ~np.isfinite(x)
    filled = np.where(missing, 0.0, x - float(np.mean(x[~missing])))
    bad = (missing | gap).astype(np.float64)
    touched = _convolved(bad, np.ones(reach)) > 0.5 if bad.any() else np.zeros(x.size, dtype=np.bool_)
    return filled, touched


def _kernels(width: float) -> tuple[Array, Array, Array]:
    """Return a sampled Gaussian and its first two derivatives, to be convolved with, exact for parabolas."""
    k = np.arange(-int(FILTER.reach * width) - 1, int(FILTER.reach * width) + 2, dtype=np.float64)
    g = np.exp(-0.5 * (k / width) ** 2)
    g /= g.sum()
    first = -k * g
    first /= -float(first @ k)
    second = (k**2 - float(k**2 @ g)) * g
    second /= 0.5 * float(second @ k**2)
    return g, first, second


def _convolved(x: Array, kernel: Array) -> Array:
    """Return the convolution with a kernel of odd length, as long as the signal."""
    size = fft.next_fast_len(x.size + kernel.size - 1, real=True)
    whole = fft.irfft(fft.rfft(x, size) * fft.rfft(kernel, size), size)
    begin = kernel.size // 2
    return np.asarray(whole[begin : begin + x.size])
