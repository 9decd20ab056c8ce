"""Torques: too coarse, stuck, or zero where a value was lost."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vsalog.checks.samples import (
    FEWEST_LEVELS,
    MOVED_SHARE,
    STUCK_TIME,
    beyond_noise,
    go_together,
    is_fine,
    is_noisy,
    levels,
    moved,
    rests,
    runs,
    span,
)
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, deflection_of, has_deflection


def passing(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield temporary faults of a torque."""
    yield from _stuck_while_moving(device, signals)
    yield from stuck(signals)
    for role in signals.roles:
        if role.startswith("torque_sensor"):
            yield from _coarse(signals, role)
        if "torque" in role and is_fine(signals, role):
            yield from _dropouts(signals, role)


def stuck(signals: JointSignals) -> Iterator[Finding]:
    """Yield the torques that stand still for a while though they are noisy elsewhere."""
    for role in signals.roles:
        if "torque" in role and is_fine(signals, role):
            yield from _stuck(signals, role)


def _coarse(signals: JointSignals, role: str) -> Iterator[Finding]:
    taken = levels(signals.roles[role])
    if 2 < taken.size < FEWEST_LEVELS and len(signals) > FEWEST_LEVELS * taken.size:
        yield Finding(
            code="torque.coarse",
            joint=signals.joint,
            part=role,
            value=float(taken.size),
            limit=float(FEWEST_LEVELS),
            evidence={"step": float(np.diff(taken).min())},
        )


def _stuck(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield a torque that stands still though it is noisy elsewhere."""
    x = signals.roles[role]
    found, resting = rests(signals, x)
    if not found or not is_noisy(x, ~resting):
        return
    longest = max(found, key=lambda one: one.stop - one.start)
    yield Finding(
        code="torque.stuck",
        joint=signals.joint,
        part=role,
        value=(longest.stop - longest.start - 1) * signals.period,
        limit=STUCK_TIME,
        unit="s",
        evidence={"begin": float(signals.time[longest.start]), "end": float(signals.time[longest.stop - 1])},
    )


def _stuck_while_moving(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield a torque sensor without noise that stands still while its spring deflects, as it does not elsewhere."""
    for view in device.transmissions:
        role = view.torque_sensor if view.torque_sensor in signals.roles else "torque_sensor"
        alone = role != "torque_sensor" or len(device.transmissions) == 1
        if not (alone and role in signals.roles and has_deflection(signals.roles, view) and is_fine(signals, role)):
            continue
        x, y = signals.roles[role], deflection_of(signals.roles, view)
        found, resting = rests(signals, x)
        elsewhere = ~resting & np.isfinite(x) & np.isfinite(y)
        if not found or is_noisy(x, ~resting) or np.count_nonzero(elsewhere) < FEWEST_LEVELS:
            continue
        if not (go_together(x[elsewhere], y[elsewhere]) or go_together(-x[elsewhere], y[elsewhere])):
            continue
        low, high = span(y)
        enough = MOVED_SHARE * (high - low)
        for stretch, far in moved(found, y, enough):
            yield Finding(
                code="torque.stuck_while_moving",
                joint=signals.joint,
                part=role,
                value=far,
                limit=enough,
                unit="rad",
                evidence={"begin": float(signals.time[stretch.start]), "end": float(signals.time[stretch.stop - 1])},
            )
            break


def _dropouts(signals: JointSignals, role: str) -> Iterator[Finding]:
    """Yield zeros between undisturbed values, farther away than noise and than a step of a coarse sensor."""
    x = signals.roles[role]
    first, after = runs(x == 0.0)
    inside = (first > 0) & (after < x.size)
    first, after = first[inside], after[inside]
    before, behind = x[first - 1], x[after]
    low, high = span(x)
    with np.errstate(invalid="ignore"):
        away = np.minimum(np.abs(before), np.abs(behind))
        lost = (np.abs(before - behind) < 0.5 * away) & (away > max((high - low) / FEWEST_LEVELS, beyond_noise(x)))
    # One alone is an outlier.
    if np.count_nonzero(lost) > 1:
        yield Finding(
            code="torque.dropouts",
            joint=signals.joint,
            part=role,
            value=float((after - first)[lost].sum()),
            limit=1.0,
            evidence={"begin": float(signals.time[first[lost][0]])},
        )


TEXTS = {
    "torque.stuck": Text(
        "{part} does not change by a single step from {begin:.4g} s to {end:.4g} s and is noisy elsewhere: its sensor or its"
        " driver was stuck.",
        "Leave that stretch out (--start, --end).",
    ),
    "torque.stuck_while_moving": Text(
        "{part} does not change by a single step from {begin:.4g} s to {end:.4g} s, while the deflection changes by {value:.3g}"
        " rad; elsewhere they change together: the sensor was stuck.",
        "Leave that stretch out (--start, --end).",
    ),
    "torque.coarse": Text(
        "{part} takes {value:.0f} values only, {step:.3g} N·m apart and more: too coarse for a stiffness.",
        "Choose a smaller range, or record it before it is rounded.",
    ),
    "torque.dropouts": Text(
        "{part} reads exactly 0 at {value:.0f} isolated samples (first at {begin:.4g} s) between undisturbed values: lost"
        " packets, or a driver that left out a value.",
        "They bias the fit; leave them empty in the log.",
    ),
}
add_texts(TEXTS)
