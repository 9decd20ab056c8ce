"""grioli-bicchi: the stiffness followed without a torque sensor, from a body whose inertia and damping are known.

Grioli, Bicchi, "A non-invasive, real-time method for measuring variable stiffness", RSS 2010, as Serio, Grioli, Sardellitti,
Tsagarakis, Bicchi (ICRA 2011) §II-A have it: eq. 4–7 on the link's equation of motion, or by §III-B on the motor's.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView
from vsalog.estimators.equation import SUPPORTED_SHARE
from vsalog.estimators.folding import estimated
from vsalog.estimators.friction_compensation import FrictionCompensation, doubt_role, extended, way_role
from vsalog.estimators.known_effects import known_of
from vsalog.estimators.needs import require
from vsalog.estimators.observer_fold import ObserverFold, ObserverState, ObserverTuning
from vsalog.estimators.screening import Screening, screened
from vsalog.estimators.transmission_torque import LoadFriction, TransmissionTorque, carried_by, effects_left_in
from vsalog.estimators.windows import noisy_rates, suitable_windows, with_window
from vsalog.filters.derivatives import Derivatives
from vsalog.uncertainty.sensor_error import ENOUGH
from vsalog.uncertainty.shift import change

NAME = "grioli-bicchi"
SUMMARY = "stiffness observer without torque sensor or basis (Grioli and Bicchi 2010); needs the motor's inertia, or the link's"


class GrioliBicchiTuning(ObserverTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of grioli-bicchi.

    Attributes
    ----------
    side : ``motor`` or ``link``, whose equation of motion gives the torque; when absent the motor's where it is known
    """

    unused: ClassVar[tuple[str, ...]] = ("shape", "settle")

    degree: Annotated[int, Meta(ge=3, le=30)] = 5
    side: Literal["motor", "link"] | None = None


TUNING = GrioliBicchiTuning


def side_of(device: Device, offered: Collection[str], tuning: GrioliBicchiTuning) -> str:
    """Return the side whose equation of motion is used, as asked for or the motor's where it is known."""
    if tuning.side is not None:
        return tuning.side
    motors = all(
        {v.motor_position, v.motor_torque} <= set(offered) and v.motor.inertia is not None for v in device.transmissions
    )
    return "motor" if motors or device.link is None or len(device.transmissions) != 1 else "link"


def told_by_the_link(device: Device, offered: Collection[str]) -> bool:
    """Return whether the link's equation of motion has all it needs, with the external torque recorded."""
    if device.link is None or len(device.transmissions) != 1:
        return False
    return {"link_position", "external_torque", *device.transmissions[0].deflection_roles(offered)} <= set(offered)


def roles(device: Device, offered: Collection[str], tuning: GrioliBicchiTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    side = side_of(device, offered, tuning)
    needed: list[str] = []
    for view in device.transmissions:
        needed += view.deflection_roles(offered)
        needed += [view.motor_position, view.motor_torque] if side == "motor" else ["link_position"]
    require(NAME, device, needed, offered)
    pushed = side == "link" and "external_torque" in offered
    return tuple(dict.fromkeys([*needed, *(["external_torque"] if pushed else [])]))


def build(device: Device, signals: JointSignals, tuning: GrioliBicchiTuning) -> GrioliBicchiFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        The rig does not give the inertia that is needed, the joint has two transmissions and the link is asked for, or the
        deflection never changes.
    """
    side = side_of(device, signals.roles, tuning)
    if side == "motor":
        torques = [motor_torque(device, view, signals, tuning) for view in device.transmissions]
        extra = tuple(v for v in device.transmissions if extended(v.motor))
        before = FrictionCompensation(extra, signals, tuning.filter, tuning.shape) if extra else None
    else:
        torques, before = [link_torque(device, signals)], None
    orders = {role: order for t in torques for role, order in t.orders(signals.roles).items()}
    look = screened(device, signals, tuning)

    def fold(window: int, part: JointSignals) -> GrioliBicchiFold:
        own = with_window(tuning, part, window)
        conditioner = Derivatives(orders, part.period, own.window_for(part), own.degree, before)
        return GrioliBicchiFold(side, device, part, own, torques, conditioner, look)

    windows, part, least = suitable_windows(device, signals, tuning, max(orders.values())), signals[:ENOUGH], np.inf
    best = windows[0]
    for window in windows if len(windows) > 1 else ():
        share = claimed_share(fold(window, part), part)
        if share < least:
            best, least = window, share
        if share <= 0.5 * SUPPORTED_SHARE:
            break  # a longer one follows less
    found = fold(best, signals)
    shorter = best // 2 | 1
    if tuning.window is None and shorter > tuning.degree + 1:
        sharper = fold(shorter, part)
        found.smoothed_away = smoothed_away(found, sharper, part)
        found.averages = {n: replace(a, sharper=sharper.averages[n].course) for n, a in found.averages.items()}
    else:
        found.of_filter += unresolved(device, best * signals.period, found.swing)
    return found


class GrioliBicchiFold(ObserverFold):
    """The observers of all transmissions, and findings about where their torque comes from."""

    def __init__(
        self, side: str, device: Device, signals: JointSignals, tuning: GrioliBicchiTuning, torques: list[TransmissionTorque],
        conditioner: Derivatives, look: Screening,
    ) -> None:  # fmt: skip
        super().__init__(NAME, "RESIDUAL", device, signals, tuning, torques, conditioner, look)
        self.side, self.pushed = side, "external_torque" in signals.roles
        self.of_filter = noisy_rates(device, signals, conditioner.weights)

    @property
    def derived(self) -> dict[str, float]:
        """The gain, its uncertainty's parts and the window that were derived from the log."""
        return {**super().derived, "window": (self.conditioner.window - 1) * self.period}

    def findings(self, state: ObserverState) -> tuple[Finding, ...]:
        """Return the effects that the torque leaves out."""
        found, joint, link = list(super().findings(state)), self.device.joint, self.device.link
        if self.side == "link" and not self.pushed:
            found.append(Finding(code="external_torque.missing", joint=joint))
        if self.side == "link" and link is not None and link.friction.rubs:
            found.append(Finding(code="link.friction_left_in", joint=joint))
        return (*found, *self.of_filter, *effects_left_in(NAME, self.device))


def unresolved(device: Device, window: float, swing: float) -> list[Finding]:
    """Find a window without a shorter one to compare with, and longer than the deflection takes from end to end [s]."""
    if window <= swing:
        return []
    return [Finding(code="filter.window_too_long", joint=device.joint, value=window, limit=float(swing), unit="s")]


def claimed_share(fold: ObserverFold, signals: JointSignals) -> float:
    """Return the median of stiffness_std / stiffness that a fold claims on a log; infinite where nothing is excited."""
    total = estimated(fold, signals)["total"]
    share = np.asarray(total["stiffness_std"]) / np.abs(np.asarray(total["stiffness"]))
    return float(np.median(share[np.isfinite(share)])) if np.any(total["excited"]) else np.inf


def smoothed_away(fold: ObserverFold, shorter: ObserverFold, signals: JointSignals) -> float:
    """Return how far stiffnesses move with a shorter window, beyond their bands there [N·m/rad]; of two the larger."""
    before, after = estimated(fold, signals), estimated(shorter, signals)
    sizes = [0.0]
    for name, columns in before.transmissions.items():
        moved, noise = change(columns, after[name], slice(None))
        beyond = (moved**2 - noise)[np.asarray(columns["excited"], dtype=np.bool_)]
        if name != "total" and np.isfinite(beyond).any():
            share = max(0.0, float(np.nanmedian(beyond))) ** 0.5
            sizes.append(share * float(np.nanmedian(np.asarray(columns["stiffness"], dtype=np.float64))))
    return max(sizes)


def motor_torque(
    device: Device, view: TransmissionView, signals: JointSignals, tuning: GrioliBicchiTuning
) -> TransmissionTorque:
    """Return Σ = B θ̈ + D θ̇ − τ, dry friction and cogging subtracted from τ beforehand (Serio 2011 eq. 1, §III-B).

    Raises
    ------
    EstimatorError
        The rig does not give the motor's inertia.
    """
    motor = view.motor.reflected
    if motor.inertia is None:
        key = "motor" if len(device.transmissions) == 1 else f"motor_{view.name}"
        raise EstimatorError(
            f"joint '{device.joint}': {NAME} needs the motor's inertia: set [joint.{device.joint}.{key}] inertia in the rig, or"
            " give the link's (--tune side=link), or use --estimator qr-rls, which estimates the motor's"
        )
    friction = None
    if motor.friction.rubs:
        known = known_of(device, view, signals, tuning, view.motor_torque, motor=True)
        assert known is not None
        friction = LoadFriction(way_role(view), doubt_role(view), motor.friction.load, known.friction_limit)
    terms = {view.motor_position: (0.0, motor.damping, motor.inertia), view.motor_torque: (-1.0,)}
    return TransmissionTorque(view, terms, friction=friction)


def link_torque(device: Device, signals: JointSignals) -> TransmissionTorque:
    """Return Σ = τ_ext − I q̈ − N q̇ − g(q) of the one transmission (Serio 2011 eq. 1), τ_ext = 0 where it is not recorded.

    Raises
    ------
    EstimatorError
        The rig does not give the link, or two transmissions drive it.
    """
    if len(device.transmissions) != 1:
        raise EstimatorError(
            f"joint '{device.joint}': two transmissions drive the link, and its motion determines only their sum;"
            f" {NAME} needs the motors' torques and inertias here"
        )
    if device.link is None:
        raise EstimatorError(
            f"joint '{device.joint}': {NAME} needs the link's inertia: set [joint.{device.joint}.link] inertia in the rig, or use"
            " --estimator impedance-coupled, which estimates it"
        )
    inertia, weight = carried_by(device.link)
    terms: dict[str, tuple[float, ...]] = {"link_position": (0.0, -device.link.damping, -inertia)}
    if "external_torque" in signals.roles:
        terms["external_torque"] = (1.0,)
    return TransmissionTorque(device.transmissions[0], terms, weight=weight)
