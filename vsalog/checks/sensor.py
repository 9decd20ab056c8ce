"""Sensors of any kind: saturated ones, and values of a slower one that were repeated."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vsalog.checks.samples import FEWEST_LEVELS, SAME_MOTION, is_fine, is_noisy, levels, runs, unlikely_run
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.signals import JointSignals
from vsalog.estimators.equation import NEGLIGIBLE_SHARE

SAMPLES_PER_VALUE = 3
"""Samples of the log per value from which on a slower sensor is late enough to bias a stiffness."""
MEASURED = ("torque_sensor", "link_position", "motor_position", "deflection")


def passing(signals: JointSignals) -> Iterator[Finding]:
    """Yield what may befall a sensor for a while."""
    for role in signals.roles:
        if role.startswith((*MEASURED, "pressure")) and is_fine(signals, role):
            yield from _saturated(signals, role)
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
    "sensor.repeated": Text(
        "{part} changes at every {value:.0f}th sample only, {rate:.4g} times a second: where it is a slower sensor's, repeated,"
        " and no command that a drive holds so long, it is late by half of that on average, which biases the stiffness.",
        "Record the others as slowly, or leave the repeats empty.",
    ),
}
add_texts(TEXTS)
