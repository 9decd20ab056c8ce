"""Encoders: a wrong zero, sign or unit, one that is stuck.

Each of these gives a wrong stiffness with a small standard deviation. Bounds are wide: motions that a joint can really make
are not reported.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.checks.samples import (
    FEWEST_LEVELS,
    MOVED_SHARE,
    go_together,
    is_noisy,
    moved,
    rests,
    span,
    with_both_positions,
)
from vsalog.core.finding import Finding, Text
from vsalog.core.finding_texts import add_texts
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of, has_deflection

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CANCELLED_SHARE = 0.5
"""Part of either position's motion that their sum has at most where one of them has the wrong sign."""
LARGEST_SPAN = 100.0
"""A range that no joint moves over [rad]: sixteen turns."""


@dataclass(frozen=True, slots=True)
class Standstill:
    """A stretch in which one encoder of a spring does not change by a single step, while the other one moves.

    Attributes
    ----------
    role, other : positions
    within, stamps : first and last time [s] and stamp [ns]
    moved, enough : how far the other one moves, and how far it has to at least [rad]
    spring : how far it has to where nothing else is known: more than the spring deflects elsewhere [rad]
    """

    role: str
    other: str
    within: tuple[float, float]
    stamps: tuple[int, int]
    moved: float
    enough: float
    spring: float

    def holds(self, stamps: NDArray[np.int64], farther: int = 0) -> Flags:
        """Return which stamps [ns] are in it, or in one that is longer [ns] at both ends."""
        return (stamps >= self.stamps[0] - farther) & (stamps <= self.stamps[1] + farther)

    def finding(self, joint: str, limit: float) -> Finding:
        """Return the finding that the encoder was stuck, if the other one moves farther than this limit [rad]."""
        begin, end = self.within
        return Finding(
            code="encoder.stuck",
            joint=joint,
            part=self.role,
            value=self.moved,
            limit=limit,
            unit="rad",
            evidence={"begin": begin, "end": end, "other": self.other},
        )


def findings(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield implausible readings of encoders."""
    yield from _off_centre(device, signals)
    for view in with_both_positions(device, signals):
        yield from _opposed(signals, view)
    yield from _too_far(device, signals)


def passing(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield encoders that stand still while the spring would have to deflect more than elsewhere."""
    for view in with_both_positions(device, signals):
        reported = set[str]()
        for s in standstills(signals, view):
            if s.moved > s.spring and s.role not in reported:
                reported.add(s.role)
                yield s.finding(signals.joint, max(s.enough, s.spring))


def _off_centre(device: Device, signals: JointSignals) -> Iterator[Finding]:
    """Yield a deflection farther from zero than its torque explains.

    A spring under a centred torque passes zero. Under a one-sided torque a curved spring need not: where the torque's middle is
    half its range from zero, the deflection may be up to three times its range from zero; beyond, everything is possible.
    """
    views = [view for view in device.transmissions if has_deflection(signals.roles, view)]
    if not views or len(views) < len(device.transmissions):
        return
    middle, half = _middle([deflection_of(signals.roles, view) for view in views])
    load, either = _middle(_torques(device, signals))
    one_sided = abs(load) / either if len(views) == 1 and either > 0.0 else 1.0
    limit = (1.0 + 2.0 * one_sided) * half
    if half > 0.0 and abs(load) <= either and abs(middle) > limit:
        yield Finding(
            code="encoder.zero",
            joint=signals.joint,
            part=" − ".join(views[0].deflection_roles(signals.roles)),
            value=middle,
            limit=limit,
            unit="rad",
            evidence={"half_range": half},
        )


def _middle(parts: Sequence[Array]) -> tuple[float, float]:
    """Return the average middle of signals, and half the widest range of them.

    Two springs that pull against each other are stretched both; the middle between them is not.
    """
    spans = [span(x) for x in parts]
    if not spans:
        return 0.0, 0.0
    return float(np.mean([0.5 * (low + high) for low, high in spans])), max(0.5 * (high - low) for low, high in spans)


def _torques(device: Device, signals: JointSignals) -> list[Array]:
    """Return the torques that show whether the joint is loaded: its sensor's, its transmissions', or its motors'."""
    views = device.transmissions
    for roles in (["torque_sensor"], [v.torque_sensor for v in views], [v.motor_torque for v in views]):
        if set(roles) <= set(signals.roles):
            return [signals.roles[role] for role in roles]
    return []


def _opposed(signals: JointSignals, view: TransmissionView) -> Iterator[Finding]:
    """Yield positions of which one has the wrong sign: with it reversed, their difference almost vanishes."""
    q, theta = signals.roles["link_position"], signals.roles[view.motor_position]
    both = np.isfinite(q) & np.isfinite(theta)
    if np.count_nonzero(both) < FEWEST_LEVELS:
        return
    a, b = q[both] - q[both].mean(), theta[both] - theta[both].mean()
    least = min(float(a.std()), float(b.std()))
    if float((a + b).std()) < CANCELLED_SHARE * least:
        yield Finding(
            code="encoder.sign",
            joint=signals.joint,
            part=f"link_position and {view.motor_position}",
            value=float(np.corrcoef(a, b)[0, 1]),
            limit=0.5 * CANCELLED_SHARE**2 - 1.0,
            evidence={"first_span": float(np.ptp(a)), "second_span": float(np.ptp(b))},
        )


def _too_far(device: Device, signals: JointSignals) -> Iterator[Finding]:
    for view in device.transmissions:
        if has_deflection(signals.roles, view):
            low, high = span(deflection_of(signals.roles, view))
            if high - low > math.tau:
                yield Finding(
                    code="encoder.deflection_unit",
                    joint=signals.joint,
                    part=" − ".join(view.deflection_roles(signals.roles)),
                    value=high - low,
                    limit=math.tau,
                    unit="rad",
                )
    for role in signals.roles:
        low, high = span(signals.roles[role]) if role.startswith(("link_position", "motor_position")) else (0.0, 0.0)
        if high - low > LARGEST_SPAN:
            yield Finding(
                code="encoder.unit",
                joint=signals.joint,
                part=role,
                value=high - low,
                limit=LARGEST_SPAN,
                unit="rad",
                evidence={"turns": (high - low) / math.tau},
            )


def standstills(signals: JointSignals, view: TransmissionView) -> Iterator[Standstill]:
    """Yield the stretches in which one encoder of a spring does not change by a single step while the other one moves."""
    yield from _standstills(signals, "link_position", view.motor_position)
    yield from _standstills(signals, view.motor_position, "link_position")


def _standstills(signals: JointSignals, role: str, other: str) -> Iterator[Standstill]:
    x, y = signals.roles[role], signals.roles[other]
    found, resting = rests(signals, x)
    elsewhere = ~resting & np.isfinite(x) & np.isfinite(y)
    if not found or np.count_nonzero(elsewhere) < FEWEST_LEVELS:
        return
    # Friction may hold a noiseless joint; a noisy encoder never stands still.
    spring = 0.0 if is_noisy(x, ~resting) else float(np.ptp((x - y)[elsewhere]))
    if not go_together(x[elsewhere], y[elsewhere]):
        spring = np.inf
    low, high = span(y)
    enough = max(FEWEST_LEVELS * signals.resolution.get(other, 0.0), MOVED_SHARE * (high - low))
    for stretch, far in moved(found, y, enough):
        first, last = stretch.start, stretch.stop - 1
        within = float(signals.time[first]), float(signals.time[last])
        stamps = int(signals.stamps[first]), int(signals.stamps[last])
        yield Standstill(role, other, within, stamps, far, float(enough), spring)


TEXTS = {
    "encoder.zero": Text(
        "the deflection ({part}) is around {value:.4g} rad and moves by ±{half_range:.3g} rad only: is an encoder's zero wrong?",
        "If so, set 'offset' of one of these roles in the rig; otherwise the stiffness over the deflection is wrong.",
    ),
    "encoder.sign": Text(
        "{part} move in opposite directions (correlation {value:.2f}, by {first_span:.3g} and {second_span:.3g} rad): is the sign"
        " of one of them wrong?",
        "If so, set 'sign = -1' of it in the rig; otherwise the deflection is their sum instead of their difference.",
    ),
    "encoder.deflection_unit": Text(
        "the deflection ({part}) spans {value:.4g} rad, more than a turn: is one of these roles in degrees, or on the motor's"
        " side of the gear?",
        "Set 'unit = \"deg\"' of it in the rig, or 'side = \"rotor\"' with the motor's gear_ratio.",
    ),
    "encoder.unit": Text(
        "{part} spans {value:.4g} rad, {turns:.0f} turns of the joint: is it in degrees, or on the motor's side of the gear?",
        "Set 'unit = \"deg\"' of it in the rig, or of a motor's position 'side = \"rotor\"' with the motor's gear_ratio.",
    ),
    "encoder.stuck": Text(
        "{part} does not change by a single step from {begin:.4g} s to {end:.4g} s, while {other} moves by {value:.3g} rad;"
        " the spring, as the rest of the log shows it, does not allow this: its encoder was stuck.",
        "Leave that stretch out (--start, --end), also if a brake or a stop held the joint.",
    ),
}
add_texts(TEXTS)
