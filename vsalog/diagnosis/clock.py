"""Whose clock is right: a log shows only which channels are late against which.

Delays of all sensors by one time and a delay of the drive by the same are one direction of the equations. Of the sets along
it the one with the fewest late channels is the most plausible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import Site
from vsalog.diagnosis.linear import Placed

Array = NDArray[np.float64]

# Causes by which a channel is late: a sensor's record comes after the motion, a drive's before its torque.
LATE = {"sensor.clock_skew": 1.0, "sensor.torque_delay": 1.0, "motor.torque_delay": -1.0}


def on_fewest_clocks(fit: Placed, sites: Iterable[Site]) -> tuple[tuple[Site, Array], ...] | None:
    """Return a fit whose delays are counted from the channel that leaves the fewest late; none where they are counted so.

    Differences below the step that delays are looked for with are left out.

    Parameters
    ----------
    fit : causes with their values
    sites : of the catalogue
    """
    own = {s.key: s for s in sites if s.cause in LATE}
    single = _channels(own.values())
    late = _lateness(fit, single)
    steps = np.array([s.parameters[0].step for s in single])
    possible = [late - shift for shift in late if _within(single, late - shift)]
    there = min(possible, key=lambda d: np.count_nonzero(np.abs(d) > steps), default=late)
    return (
        None
        if np.count_nonzero(np.abs(there) > steps) >= np.count_nonzero(late)
        else _so_late(fit, own.values(), there)
    )


def counted_from(fit: Placed, site: Site, sites: Iterable[Site]) -> tuple[tuple[Site, Array], ...] | None:
    """Return a fit whose delays are counted from the channel that one of them is of; none where that leaves more channels late.

    Parameters
    ----------
    fit : causes with their values
    site : of a delay
    sites : of the catalogue
    """
    own = {s.key: s for s in sites if s.cause in LATE}
    single = _channels(own.values())
    late = _lateness(fit, single)
    shift = next((d for s, d in zip(single, late, strict=True) if site.overlaps(s)), 0.0)
    steps = np.array([s.parameters[0].step for s in single])
    more = np.count_nonzero(np.abs(late - shift) > steps) > np.count_nonzero(late)
    return _so_late(fit, own.values(), late - shift) if shift and not more and _within(single, late - shift) else None


def read_apart(
    smooth: Placed, held: Placed, sites: Iterable[Site], hold: float, noise: Callable[[Site], float]
) -> float:
    """Return how much later channels are read with one fit than with another whose torques are held [s].

    The time is that of the channel that halves the noise: a median that is weighted with it.

    Parameters
    ----------
    smooth, held : causes with their values
    sites : of the catalogue
    hold : how long after its stamp a held torque acts on average [s]
    noise : how much of the equations' noise a channel makes, named by its delay
    """
    single = _channels(s for s in sites if s.cause in LATE)
    if not single:
        return 0.0
    drives = np.array([LATE[s.cause] < 0.0 for s in single])
    apart = _lateness(smooth, single) - _lateness(held, single) + hold * drives
    order = np.argsort(apart)
    share = np.cumsum(np.array([noise(s) for s in single])[order])
    return float(apart[order][np.searchsorted(share, 0.5 * share[-1])])


def _so_late(fit: Placed, sites: Iterable[Site], late: Array) -> tuple[tuple[Site, Array], ...]:
    """Return a fit with its channels so late, but for those that are by less than a step."""
    delays = [(s, _value(s, d)) for s, d in zip(_channels(sites), late, strict=True) if abs(d) > s.parameters[0].step]
    return (*((s, v) for s, v in fit if s.cause not in LATE), *_in_common(delays, sites))


def all_late(fit: Placed, sites: Iterable[Site]) -> bool:
    """Return whether a fit has every channel late: then all may be late by any time, and no log determines which."""
    late = _lateness(fit, _channels(sites))
    return bool(late.size and late.all())


def delays_in(fit: Placed) -> int:
    """Return how many causes of a fit are delays."""
    return sum(site.cause in LATE for site, _ in fit)


def _value(site: Site, late: float) -> Array:
    return np.array([site.start[0] + LATE[site.cause] * late])


def _within(single: Sequence[Site], late: Array) -> bool:
    """Return whether channels may be so late."""
    values = [(s.parameters[0], float(_value(s, d)[0])) for s, d in zip(single, late, strict=True)]
    return all(p.low <= v <= p.high for p, v in values)


def _channels(sites: Iterable[Site]) -> list[Site]:
    """Return the delay of each channel; none where drives have none, so that the others are late against them."""
    single = [s for s in sites if s.cause in LATE and not s.members]
    return single if any(LATE[s.cause] < 0.0 for s in single) else []


def _lateness(fit: Placed, single: Sequence[Site]) -> Array:
    """Return how late a fit has the channel of each site against the rig, shape (channels,)."""
    late = np.zeros(len(single))
    for site, values in fit:
        for i, one in enumerate(single):
            if site.overlaps(one):
                late[i] = LATE[one.cause] * (values[0] - one.start[0])
    return late


def _in_common(kept: Sequence[tuple[Site, Array]], sites: Iterable[Site]) -> list[tuple[Site, Array]]:
    """Return delays with those of both parts of a joint as one."""
    for both in (s for s in sites if s.members):
        own = [(s, v) for s, v in kept if both.overlaps(s)]
        if len(own) == len(both.members):
            kept = [*((s, v) for s, v in kept if not both.overlaps(s)), (both, np.mean([v for _, v in own], axis=0))]
    return list(kept)
