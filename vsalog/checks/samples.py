"""Properties of a signal's samples that several checks need: its span, its levels, its noise, and where it rests."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.core.resolution import step_of
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM_OF_MANY
from vsalog.estimators.device import Device, TransmissionView
from vsalog.estimators.equation import NEGLIGIBLE_SHARE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FEWEST_LEVELS = 20
"""Fewest samples, or levels, for a distribution."""
NOISY_SHARE = 0.25
"""Part of its steps at which a noisy signal turns back at least, and stays at most; white noise turns back at two thirds."""
SAME_MOTION = 0.9
"""Correlation from which on two signals are the same motion; and the share of a signal's changes taken for all of them."""
STUCK_TIME = 0.5
"""Seconds after which a sensor stands still, and is not merely late by a packet or two."""
MOVED_SHARE = 0.2
"""Part of its range that a signal moves where it can be seen that another one does not."""


def with_both_positions(device: Device, signals: JointSignals) -> list[TransmissionView]:
    """Return the transmissions of which both ends' positions are known."""
    return [view for view in device.transmissions if {"link_position", view.motor_position} <= set(signals.roles)]


def span(x: Array) -> tuple[float, float]:
    """Return between what values a signal lies, outliers aside; (0, 0) for one that is too short."""
    finite = x[np.isfinite(x)]
    if finite.size < FEWEST_LEVELS:
        return 0.0, 0.0
    low, high = np.quantile(finite, (NEGLIGIBLE_SHARE, 1.0 - NEGLIGIBLE_SHARE))
    return float(low), float(high)


def levels(x: Array) -> Array:
    """Return the values that a signal takes, ascending."""
    return np.unique(x[np.isfinite(x)])


def is_fine(signals: JointSignals, role: str) -> bool:
    """Return whether a signal's steps are small next to its range: a coarse signal rests, and is zero, by rounding."""
    taken = levels(signals.roles[role])
    if taken.size < 2:
        return False
    # A signal without steps is given those of its noise, which are none.
    step = max(step_of(signals.roles[role]) or 0.0, float(np.diff(taken).min()))
    return float(taken[-1] - taken[0]) > FEWEST_LEVELS * step


def is_noisy(x: Array, among: Flags) -> bool:
    """Return whether a signal alternates from sample to sample where `among` is set."""
    steps = np.diff(x)[among[1:] & among[:-1]]
    steps = steps[np.isfinite(steps)]
    if steps.size < FEWEST_LEVELS or float(np.mean(steps == 0.0)) > NOISY_SHARE:
        return False
    return float(np.mean(steps[1:] * steps[:-1] < 0.0)) > NOISY_SHARE


def runs(flags: Flags) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where stretches of True begin, and where they are over."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return edges[::2], edges[1::2]


def rests(signals: JointSignals, x: Array) -> tuple[list[slice], Flags]:
    """Return the stretches in which a signal stands still for long, and the samples in them."""
    # A run of the log ends where a sample is the first after a gap.
    first, after = runs(np.concatenate(([False], np.diff(x) == 0.0)) & ~signals.starts)
    long = (after - first) * signals.period >= STUCK_TIME
    found = [slice(int(begin) - 1, int(end)) for begin, end in zip(first[long], after[long], strict=True)]
    resting = np.zeros(x.shape, dtype=np.bool_)
    for one in found:
        resting[one] = True
    return found, resting


def moved(found: list[slice], y: Array, enough: float) -> Iterator[tuple[slice, float]]:
    """Yield the stretches in which another signal moves more than enough, and how far it does."""
    for one in found:
        known = y[one][np.isfinite(y[one])]
        if known.size and float(np.ptp(known)) > enough:
            yield one, float(np.ptp(known))


def unlikely_run(share: float, count: int) -> int:
    """Return the run length that is no chance among `count` samples, each in it with probability `share`.

    A run of n begins at one of N samples with probability N pⁿ at most.
    """
    p = max(share, 1.0 / count)
    return 1 + int(np.ceil(np.log(FALSE_ALARM_OF_MANY / count) / np.log(p))) if p < 1.0 else count + 1


def beyond_noise(x: Array) -> float:
    """Return the bound that the changes of a signal do not exceed by chance: normal, of their median's size."""
    steps = np.abs(np.diff(x))
    steps = steps[np.isfinite(steps)]
    if steps.size == 0:
        return 0.0
    deviation = float(np.median(steps)) / special.ndtri(0.75)
    return deviation * float(-special.ndtri(0.5 * FALSE_ALARM_OF_MANY / steps.size))


def go_together(x: Array, y: Array) -> bool:
    """Return whether two signals are the same motion."""
    if not (float(np.ptp(x)) > 0.0 and float(np.ptp(y)) > 0.0):
        return False
    return float(np.corrcoef(x, y)[0, 1]) > SAME_MOTION
