"""Sensors of any kind: saturated ones, and values of a slower one that were repeated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from vsalog.checks.samples import FEWEST_LEVELS, SAME_MOTION, is_fine, is_noisy, levels, rests, runs, unlikely_run
from vsalog.core.column import Column
from vsalog.core.finding import Evidence, Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.precision import ROUNDING
from vsalog.core.resolution import ENOUGH, step_of
from vsalog.core.signals import JointSignals
from vsalog.core.significance import FALSE_ALARM_OF_MANY
from vsalog.estimators.equation import NEGLIGIBLE_SHARE

SAMPLES_PER_VALUE = 3
"""Samples of the log per value from which on a slower sensor is late enough to bias a stiffness."""


class Cut(NamedTuple):
    """Criteria for a signal without noise that was clipped at an end of its range.

    Attributes
    ----------
    kink : way in the farther half of a stretch next to that end over that in the nearer half, at most: one for a constant
        speed, three for a constant deceleration, and in between the middle of their logarithms
    steps : of the sensor over which a speed shows
    stays : samples that it is at that end, at least: between two of a fast motion nothing shows how it turns
    nearest : samples of a stretch's half, at least
    fewest : times that it comes to an end, or leaves it, at full speed: a single stop is a collision
    jump : step of a position behind a rest over the greatest of all others, at least: no drive is so much faster just once
    """

    kink: float = 1.8
    steps: float = 32.0
    stays: int = 8
    nearest: int = 3
    fewest: int = 4
    jump: float = 10.0


CUT = Cut()
MEASURED = ("torque_sensor", "link_position", "motor_position", "deflection")


def passing(signals: JointSignals) -> Iterator[Finding]:
    """Yield temporary faults of a sensor."""
    for role in signals.roles:
        if role.startswith((*MEASURED, "pressure", "motor_torque")) and is_fine(signals, role):
            yield from _cut(signals, role)
        if role.startswith(MEASURED) and "torque" not in role:
            yield from _frozen(signals, role)
        if role.startswith((*MEASURED, "motor_torque")):
            yield from _repeated(signals, role)


def without_clipped(signals: JointSignals) -> JointSignals:
    """Return signals in which a torque sensor's samples at an end of its range that clips it are missing.

    A position may be at a stop, and a motor's torque at a limit of its drive: there these are what they were recorded as.
    """
    limits = {
        role: found for role in signals.roles if role.startswith("torque_sensor") and (found := _limits(signals, role))
    }
    if not limits:
        return signals
    columns = {role: Column(np.float64, len(signals), in_file=signals.in_file) for role in limits}
    for block in signals.blocks(ENOUGH):
        for role, at in limits.items():
            values = block.roles[role]
            columns[role].append(np.where(np.isin(values, at), np.nan, values))
    return replace(signals, roles={**signals.roles, **{r: own.whole(len(signals)) for r, own in columns.items()}})


def _limits(signals: JointSignals, role: str) -> list[float]:
    """Return the values at which a signal is clipped."""
    return [
        float(finding.evidence["at"])
        for block in (signals.blocks(ENOUGH) if signals.in_file else (signals,))
        if is_fine(block, role)
        for finding in _cut(block, role)
    ]


def _cut(signals: JointSignals, role: str) -> list[Finding]:
    """Return the ends of its range at which a signal is clipped."""
    return list(_saturated(signals, role)) or list(_clipped(signals, role))


def _saturated(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield an end of the range at which a noisy signal rests for longer than by chance, or which it reaches too often."""
    x = signals.roles[role]
    finite = x[np.isfinite(x)]
    for end, extreme in (("highest", float(finite.max())), ("lowest", float(finite.min()))):
        there = x == extreme
        if np.count_nonzero(there) <= NEGLIGIBLE_SHARE * finite.size or not is_noisy(x, ~there):
            continue
        still = float(np.mean(np.diff(x[~there]) == 0.0))
        first, after = runs(there)
        piled = _piled_up(x, there, len(first))
        long = piled | (after - first >= unlikely_run(still, finite.size))
        resting = int((after - first)[long].sum())
        if resting > NEGLIGIBLE_SHARE * finite.size:
            yield Finding(
                code="sensor.saturated",
                joint=signals.joint,
                part=role,
                value=resting / finite.size,
                limit=NEGLIGIBLE_SHARE,
                evidence={"end": end, "at": extreme, "begin": float(signals.time[first[np.argmax(long)]])},
            )


def _piled_up(x: NDArray[np.float64], there: NDArray[np.bool_], times: int) -> bool:
    """Return whether a noisy signal comes to an end of its range more often than an unclipped one to its last level.

    What turns there as a sine does comes to its last level 1.4 times as often as to the last but one, and noise makes it less:
    twice is too often. At zero a magnitude turns, and a current rests.
    """
    extreme = float(x[there][0])
    if extreme == 0.0:
        return False
    others = levels(x[~there])
    step = max(step_of(x) or 0.0, float(np.diff(others).min(initial=np.inf)))
    next_to = np.abs(x - extreme) < 1.5 * step
    neighbours = len(runs(next_to & ~there)[0])
    return float(special.bdtrc(times - 1, times + neighbours, 2.0 / 3.0)) <= FALSE_ALARM_OF_MANY


def _clipped(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield the ends of the range that a signal without noise reaches at full speed, and more than once.

    A signal that turns or comes to rest slows down before; a clipped one does not. A joint that sticks where it turns does so at
    other values, too.
    """
    x = signals.roles[role]
    finite = x[np.isfinite(x)]
    if is_noisy(x, np.isfinite(x)):
        return
    step = max(signals.resolution.get(role, 0.0), float(np.ptp(finite)) * ROUNDING)
    first, after = runs(np.diff(x) == 0.0)
    long = after - first >= CUT.stays - 1
    resting = [(begin, over + 1) for begin, over in zip(first[long].tolist(), after[long].tolist(), strict=True)]
    ends = {"highest": float(finite.max()), "lowest": float(finite.min())}
    turning = [rest for rest in resting if x[rest[0]] not in ends.values() and _turns(x, *rest)]
    if sum(_kinks(x, *rest, CUT.steps * step) for rest in turning) >= CUT.fewest:
        return
    kinks, found = 0, list[Finding]()
    for end, extreme in ends.items():
        here = sum(_kinks(x, *rest, CUT.steps * step) for rest in resting if x[rest[0]] == extreme)
        kinks += here
        if here:
            first, after = runs(x == extreme)
            long = after - first >= CUT.stays
            share, begin = float((after - first)[long].sum()) / finite.size, float(signals.time[first[np.argmax(long)]])
            evidence: Evidence = {"end": end, "at": extreme, "begin": begin}
            found.append(Finding(code="sensor.clipped", joint=signals.joint, part=role, value=share, evidence=evidence))
    if kinks >= CUT.fewest:
        yield from found


def _turns(x: NDArray[np.float64], begin: int, over: int) -> bool:
    """Return whether a signal leaves a rest to the side that it came from."""
    return begin > 0 and over < x.size and (x[begin - 1] - x[begin]) * (x[over] - x[begin]) > 0.0


def _kinks(x: NDArray[np.float64], begin: int, over: int, enough: float) -> int:
    """Return how often a signal comes to a rest, or leaves it, without getting slower; one at an end of the log has one side."""
    length = over - begin
    # A slice only: a long log has thousands of rests.
    near = max(2 * length, 2 * CUT.nearest + 1)
    sides = [x[max(0, begin - near) : begin][::-1]] * (begin > 0) + [x[over : over + near]] * (over < x.size)
    return sum(_kinked(np.abs(side - x[begin]), enough, length) for side in sides)


def _frozen(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield a position that stands still and then jumps, much farther than from any other sample to the next."""
    x = signals.roles[role]
    found, _ = rests(signals, x)
    steps = np.abs(np.diff(x, append=np.nan))
    ends = np.array(
        [one.stop - 1 for one in found if one.stop < x.size and not signals.starts[one.stop]], dtype=np.int64
    )
    others = steps.copy()
    others[ends] = np.nan
    if not ends.size or not np.isfinite(others).any():
        return
    # An encoder that rests continues by a step of its own.
    usual, jump = (
        max(float(np.nanmax(others)), float(np.diff(levels(x)).min())),
        float(np.nanmax(steps[ends], initial=0.0)),
    )
    if jump > CUT.jump * usual:
        last = int(ends[np.nanargmax(steps[ends])])
        begin = next(one.start for one in found if one.stop - 1 == last)
        evidence: Evidence = {"begin": float(signals.time[begin]), "end": float(signals.time[last])}
        about = partial(Finding, joint=signals.joint, part=role, unit="rad")
        yield about(code="sensor.frozen", value=jump, limit=CUT.jump * usual, evidence=evidence)


def _kinked(side: NDArray[np.float64], enough: float, length: int) -> bool:
    """Return whether a signal leaves an end of its range, or comes there, without slowing down.

    Parameters
    ----------
    side : shape (n,), way from that end of the samples next to it, the nearest first
    enough : way at which steps do not matter
    length : samples that it stays there; a parabola's top is within a step for less time than it takes to go `enough`
    """
    # The sample next to the end is anywhere between it and one step of the motion away.
    far = np.flatnonzero(~(side - side[:1] < enough))
    if not far.size or far[0] > length:
        return False
    half = max(CUT.nearest, -(-int(far[0]) // 2))
    if 2 * half >= side.size or not np.isfinite(side[: 2 * half + 1]).all():
        return False
    near, beyond = side[half] - side[0], side[2 * half] - side[half]
    # Stick-slip has no constant speed: it stays longer at a value than that speed takes to the next.
    values = side[: 2 * half + 1]
    first, after = runs(np.diff(values) == 0.0)
    stays = int((after - first).max(initial=0)) + 1
    even = stays <= 2.0 * max(1.0, 2.0 * half * enough / CUT.steps / max(float(np.ptp(values)), enough))
    return bool(even and near > 0.0 and beyond < CUT.kink * near)


def _repeated(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield a signal that changes at every n-th sample only, and not by single steps as a coarse one at a constant speed."""
    x, taken = signals.roles[role], levels(signals.roles[role])
    changes = np.abs(np.diff(x))
    at = np.flatnonzero(changes > 0.0)
    if at.size < FEWEST_LEVELS or taken.size < FEWEST_LEVELS:
        return
    lengths = np.diff(at)
    each = int(np.median(lengths))
    if each < SAMPLES_PER_VALUE or float(np.mean(lengths == each)) < SAME_MOTION:
        return
    if float(np.median(changes[at])) > 1.5 * float(np.diff(taken).min()):
        yield Finding(
            code="sensor.repeated",
            joint=signals.joint,
            part=role,
            value=float(each),
            limit=float(SAMPLES_PER_VALUE),
            evidence={"rate": 1.0 / (each * signals.period)},
        )


TEXTS = {
    "sensor.saturated": Text(
        "{part} rests at its {end} value {at:.6g} for {value:.1%} of the samples (first at {begin:.4g} s) and moves noisily"
        " elsewhere: it is saturated.",
        "Choose a larger range. Of a torque sensor these samples are left out of the estimate; for another sensor leave the"
        " stretches out (--start, --end).",
        FALSE_ALARM_OF_MANY,
    ),
    "sensor.clipped": Text(
        "{part} reaches its {end} value {at:.6g} at full speed, stays there, and leaves it at full speed (first at"
        " {begin:.4g} s, {value:.1%} of the samples): it was clipped, or the joint ran into a stop.",
        "Choose a larger range. Of a torque sensor these samples are left out of the estimate; for another sensor leave the"
        " stretches out (--start, --end).",
    ),
    "sensor.frozen": Text(
        "{part} does not change from {begin:.4g} s to {end:.4g} s and then jumps by {value:.3g} rad, while no other step is"
        " larger than a tenth of that: it was stuck.",
        "Leave that stretch out (--start, --end).",
    ),
    "sensor.repeated": Text(
        "{part} changes at every {value:.0f}th sample only, {rate:.4g} times a second: if it is a slower sensor's, repeated, and"
        " not a command that a drive holds, it is late by half of that on average, which biases the stiffness.",
        "Record the others at the same rate, or leave the repeats empty.",
    ),
}
add_texts(TEXTS)
