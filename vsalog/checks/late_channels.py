"""The delay of a channel and its rate of change, from the joint's equations."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from vsalog.checks.fault import RULE, Fault
from vsalog.checks.joint_equations import COMMAND
from vsalog.checks.undone_channels import Channels, Faults


def late(channels: Channels, undone: Faults, role: str) -> Iterator[Fault]:
    """Yield that a role is late, and that it becomes later, if this reduces the equations' residuals."""
    delay = late_by(channels, undone, role)
    if delay is not None:
        yield Fault("late", (role,), delay=delay)
    if role == COMMAND:
        return
    left, longest, half = _left(channels, undone, role), _longest(channels), float(channels.time[-1])
    step, fine = RULE.longest_delay / RULE.delays, RULE.finest * channels.signals.period
    delay, rate = delay or 0.0, 0.0
    seed, seed_rate = _apart(channels, undone, role)
    if left(seed, seed_rate) < left(delay, 0.0):
        delay, rate = seed, seed_rate
    for _ in range(2):
        widest = min((longest - abs(delay)) / half, RULE.fastest)
        better = least(lambda r, d=delay: left(d, r), widest, step / half, fine / half, rate)  # type: ignore[misc]
        if better is None:
            return
        rate = better
        delay = least(lambda d, r=rate: left(d, r), longest, step, fine, delay) or delay  # type: ignore[misc]
    if abs(rate) * half >= channels.signals.period:
        yield Fault("drift", (role,), delay=delay, rate=rate)


def late_by(channels: Channels, undone: Faults, role: str) -> float | None:
    """Return the constant delay of a role that reduces the equations' residuals most [s]; None for none."""
    left, (seed, _) = _left(channels, undone, role), _apart(channels, undone, role)
    step, fine = RULE.longest_delay / RULE.delays, RULE.finest * channels.signals.period
    return least(lambda d: left(d, 0.0), _longest(channels), step, fine, seed)


def _left(channels: Channels, undone: Faults, role: str) -> Callable[[float, float], float]:
    """Return how much a role's delay and its rate leave, as a log-likelihood ratio below 0."""
    one = Fault("late", (role,))
    touched = channels.touched(one, undone)
    now = channels.trial(undone, touched)
    longest, half = _longest(channels), float(channels.time[-1])
    # A drive may be slow, but never acts before its command.
    earliest = 0.0 if role == COMMAND else -longest

    def left(delay: float, rate: float) -> float:
        if abs(delay) + abs(rate) * half > longest or delay < earliest or abs(rate) > RULE.fastest:
            return math.inf
        return -channels.trial((*undone, replace(one, delay=delay, rate=rate)), touched).better(now)

    return left


def _longest(channels: Channels) -> float:
    """Return the longest delay that rows may be moved by [s]."""
    return (channels.motion.reach - 1) * channels.signals.period


def _apart(channels: Channels, undone: Faults, role: str) -> tuple[float, float]:
    """Return by how much a position is later than the other one in the middle of the log [s], and how fast that grows.

    Where a deflection is small the difference that a delay makes is much larger, except near the right delay.
    """
    other = {"link_position": "motor_position", "motor_position": "link_position"}.get(role)
    if other is None or other not in channels.motion.values:
        return 0.0, 0.0
    mine, its = channels.values(role, undone), channels.values(other, undone)
    columns = np.column_stack((np.ones(channels.time.size), its[1], channels.time * its[1]))
    _, delay, rate = np.linalg.lstsq(columns, its[0] - mine[0], rcond=None)[0].tolist()
    return float(delay), float(rate)


def least(f: Callable[[float], float], longest: float, step: float, finest: float, seed: float = 0.0) -> float | None:
    """Return the minimiser of a function between −longest and longest: on a grid, near a seed, then by halving the step.

    None where it is nowhere below its value at 0 by more than `Rule.gain`.
    """
    count = max(1, int(longest / step))
    near = (seed + 4 * k * finest for k in range(-6, 7))
    values = {x: f(x) for x in (*(k * step for k in range(-count, count + 1)), *(x for x in near if abs(x) <= longest))}
    best = float(min(values, key=values.__getitem__))
    value = values[best]
    if value > values[0.0] - RULE.gain:
        return None
    while step > finest:
        step *= 0.5
        for trial in (best - step, best + step):
            if abs(trial) <= longest and (other := f(trial)) < value:
                best, value = trial, other
                break
    return best
