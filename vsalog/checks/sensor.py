"""Sensors of any kind: saturated ones, and values of a slower one that were repeated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.samples import FEWEST_LEVELS, SAME_MOTION, is_fine, is_noisy, levels, runs, unlikely_run
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.precision import ROUNDING
from vsalog.core.signals import JointSignals
from vsalog.estimators.equation import NEGLIGIBLE_SHARE

SAMPLES_PER_VALUE = 3
"""Samples of the log per value from which on a slower sensor is late enough to bias a stiffness."""
KINK = 1.8
"""Way in the farther half of a stretch next to an end of a signal's range over that in the nearer half [1], at most, where it is cut
off there: one of an even speed, three of an even deceleration, and in between the middle of their logarithms."""
KINK_STEPS = 32
"""Steps of the sensor [1] over which a speed shows."""
FEWEST_KINKS = 4
"""Times that a signal comes to an end of its range, or leaves it, at full speed [1]: a single stop is a collision."""
MEASURED = ("torque_sensor", "link_position", "motor_position", "deflection")


def passing(signals: JointSignals) -> Iterator[Finding]:
    """Yield what may befall a sensor for a while."""
    for role in signals.roles:
        if role.startswith((*MEASURED, "pressure", "motor_torque")) and is_fine(signals, role):
            yield from _saturated(signals, role)
            yield from _clipped(signals, role)
        if role.startswith((*MEASURED, "motor_torque")):
            yield from _repeated(signals, role)


def _saturated(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield an end of the range at which a noisy signal rests, for longer than chance lets it."""
    x = signals.roles[role]
    finite = x[np.isfinite(x)]
    for end, extreme in (("highest", float(finite.max())), ("lowest", float(finite.min()))):
        there = x == extreme
        if np.count_nonzero(there) <= NEGLIGIBLE_SHARE * finite.size or not is_noisy(x, ~there):
            continue
        still = float(np.mean(np.diff(x[~there]) == 0.0))
        first, after = runs(there)
        long = after - first >= unlikely_run(still, finite.size)
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


def _clipped(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield an end of the range that a signal without noise reaches at full speed, and more than once.

    What turns or comes to rest gets slower before; what is cut off does not.
    """
    x = signals.roles[role]
    finite = x[np.isfinite(x)]
    if is_noisy(x, np.isfinite(x)):
        return
    step = max(signals.resolution.get(role, 0.0), float(np.ptp(finite)) * ROUNDING)
    for end, extreme in (("highest", float(finite.max())), ("lowest", float(finite.min()))):
        first, after = runs(x == extreme)
        long = after - first >= SAMPLES_PER_VALUE
        way = np.abs(x - extreme)
        # A rest at either end of the log begins or ends nowhere.
        edges = [(b, -1) for b in first[long] if b > 0] + [(a - 1, 1) for a in after[long] if a < x.size]
        length = dict(zip(first.tolist(), (after - first).tolist(), strict=True)) | dict(
            zip((after - 1).tolist(), (after - first).tolist(), strict=True)
        )
        kinks = [at for at, ahead in edges if _kinked(way, int(at), ahead, KINK_STEPS * step, length[int(at)])]
        cut = int((after - first)[long].sum())
        if len(kinks) >= FEWEST_KINKS and 2 * len(kinks) >= len(edges):
            yield Finding(
                code="sensor.clipped",
                joint=signals.joint,
                part=role,
                value=cut / finite.size,
                limit=0.0,
                evidence={"end": end, "at": extreme, "begin": float(signals.time[first[np.argmax(long)]])},
            )


def _kinked(way: NDArray[np.float64], at: int, ahead: int, enough: float, length: int) -> bool:
    """Tell whether a signal leaves an end of its range, or comes there, without getting slower.

    Parameters
    ----------
    way : shape (N,), from that end
    at, ahead : the sample there next to the others, and in which direction these are
    enough : way at which steps do not matter
    length : samples that it stays there; a parabola's top is within a step for less time than it takes to go `enough`
    """
    # The sample next to the end is anywhere between it and one step of the motion away.
    side = (way[at + ahead :: ahead] if at + ahead >= 0 else way[:0])[: 2 * length]
    far = np.flatnonzero(~(side - side[:1] < enough))
    if not far.size or far[0] > length:
        return False
    half = max(1, -(-int(far[0]) // 2))
    if 2 * half >= side.size or not np.isfinite(side[: 2 * half + 1]).all():
        return False
    near, beyond = side[half] - side[0], side[2 * half] - side[half]
    return bool(near > 0.0 and beyond < KINK * near)


def _repeated(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield a signal that changes at every so manyth sample only, and not by single steps as a coarse one at an even speed."""
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
        "The stiffness is wrong wherever it is; choose a larger range, or leave these stretches out (--start, --end).",
    ),
    "sensor.clipped": Text(
        "{part} reaches its {end} value {at:.6g} at full speed, stays there, and leaves it at full speed (first at {begin:.4g} s,"
        " {value:.1%} of the samples): it was clipped, or the joint ran into a stop.",
        "Leave these stretches out (--start, --end), or choose a larger range.",
    ),
    "sensor.repeated": Text(
        "{part} changes at every {value:.0f}th sample only, {rate:.4g} times a second: where it is a slower sensor's, repeated,"
        " and no command that a drive holds so long, it is late by half of that on average, which biases the stiffness.",
        "Record the others as slowly, or leave the repeats empty.",
    ),
}
add_texts(TEXTS)
