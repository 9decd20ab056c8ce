"""A joint as the estimators see it: its transmissions, and which role belongs to which of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.basis import PolynomialBasis
from vsalog.core.errors import EstimatorError
from vsalog.core.resolution import step_of
from vsalog.rig.parts import Link
from vsalog.rig.schema import (
    AntagonisticJoint,
    Joint,
    Motor,
    PneumaticJoint,
    RigFile,
    RigidJoint,
    SerialJoint,
    Transmission,
)

Array = NDArray[np.float64]

# So many samples, spread over a log, show its course [1].
PLACES = 500


@dataclass(frozen=True, slots=True)
class TransmissionView:
    """One transmission of a joint: its name in the trace, its motor, its nominal model, and the names of its roles."""

    name: str
    motor: Motor
    nominal: Transmission
    motor_position: str
    motor_torque: str
    torque_sensor: str
    deflection: str

    def deflection_roles(self, available: Collection[str]) -> tuple[str, ...]:
        """Return the roles the deflection φ = q − θ comes from: measured itself where it is, else both positions."""
        if self.deflection in available:
            return (self.deflection,)
        return ("link_position", self.motor_position)


@dataclass(frozen=True, slots=True)
class Device:
    """The compliant part of a joint.

    Attributes
    ----------
    joint : the joint's name
    transmissions : one, or two for an antagonistic joint
    basis : what each transmission's flexibility torque is fitted with
    has_setpoint : whether the flexibility torque depends on a set-point
    pneumatic : the joint itself where it has muscles instead of transmissions
    link : what the rig knows of the link
    rig : the whole rig, for a method that looks at the other joints of an arm; None where it is not known
    """

    joint: str
    transmissions: tuple[TransmissionView, ...]
    basis: PolynomialBasis
    has_setpoint: bool
    pneumatic: PneumaticJoint | None = None
    link: Link | None = None
    rig: RigFile | None = None


def device_of(name: str, joint: Joint, roles: Mapping[str, Array] | None = None, rig: RigFile | None = None) -> Device:
    """See a joint of a rig as a device.

    Parameters
    ----------
    name, joint : of the rig
    roles : the joint's signals, from which the scales are taken that the rig's basis leaves open; these are 1 without
    rig : the whole rig, where it is known

    Raises
    ------
    EstimatorError
        The joint is rigid: it has no transmission whose stiffness could be estimated.
    """
    if isinstance(joint, RigidJoint):
        raise EstimatorError(
            f"joint '{name}' is of kind 'rigid', with one position only, so there is no deflection and no stiffness to"
            " estimate: a role is missing, motor_position (the motor's position θ) or link_position (the link's position q),"
            " whichever the one position is not, or deflection. If the joint is compliant and both sides were recorded, state"
            ' that in the rig (kind = "elastic", "serial" or "antagonistic") and name their channels'
        )
    if isinstance(joint, PneumaticJoint):
        return Device(name, (), PolynomialBasis.make(1, odd=True), False, joint, rig=rig)
    serial = isinstance(joint, SerialJoint)
    views: tuple[TransmissionView, ...]
    if isinstance(joint, AntagonisticJoint):
        views = (
            _view("1", joint.motor_1, joint.transmission_1, "_1"),
            _view("2", joint.motor_2, joint.transmission_2, "_2"),
        )
    else:
        views = (_view("1", joint.motor, joint.transmission, ""),)
    deflections = [deflection_of(roles, v) for v in views if has_deflection(roles, v)] if roles is not None else []
    setpoints = [roles["setpoint"]] if roles is not None and serial and "setpoint" in roles else []
    basis = PolynomialBasis.make(
        joint.basis.order,
        odd=joint.basis.odd,
        setpoint_order=joint.basis.setpoint_order if serial else 1,
        deflection_scale=joint.basis.deflection_scale or largest(*deflections),
        setpoint_scale=joint.basis.setpoint_scale or largest(*setpoints),
        branches=joint.basis.branches,
        knots=joint.basis.knots,
        setpoint_knots=setpoint_borders(setpoints[0], joint.basis.setpoint_knots) if setpoints else (),
        corners=joint.basis.corners,
    )
    return Device(name, views, basis, serial, link=joint.link, rig=rig)


def has_deflection(values: Collection[str], view: TransmissionView) -> bool:
    """Return whether the signals determine φ."""
    return set(view.deflection_roles(values)) <= set(values)


def deflection_of(values: Mapping[str, Array], view: TransmissionView) -> Array:
    """Return φ, measured itself or φ = q − θ (Flacco 2012 §2.1), shape (N,) [rad]."""
    if view.deflection in values:
        return values[view.deflection]
    return values["link_position"] - values[view.motor_position]


def setpoint_borders(setpoint: Array, pieces: int) -> tuple[float, ...]:
    """Return the borders of even pieces of a set-point's range [rad or m]; none where it is constant."""
    finite = setpoint[np.isfinite(setpoint)]
    if not pieces or not finite.size or not np.ptp(finite):
        return ()
    return tuple(float(x) for x in np.linspace(finite.min(), finite.max(), pieces + 1))


def largest(*signals: Array) -> float:
    """Return the largest finite |x| of all signals; 1 where there is none or all are zero."""
    finite = [np.abs(x[np.isfinite(x)]) for x in signals]
    return max((float(x.max()) for x in finite if x.size), default=0.0) or 1.0


def spread(x: Array) -> float:
    """Return the standard deviation of a signal's finite samples; 0 where there is none."""
    finite = x[np.isfinite(x)]
    return float(np.std(finite)) if finite.size else 0.0


def _view(name: str, motor: Motor, nominal: Transmission, suffix: str) -> TransmissionView:
    roles = (f"{role}{suffix}" for role in ("motor_position", "motor_torque", "torque_sensor", "deflection"))
    return TransmissionView(name, motor, nominal, *roles)


def encoder_steps(roles: Mapping[str, Array], views: Sequence[TransmissionView]) -> dict[str, float]:
    """Return the steps [rad] of the sensors that deflections come from; those whose noise hides them have none."""
    sensors = dict.fromkeys(role for view in views for role in view.deflection_roles(roles))
    steps = {role: step_of(roles[role]) for role in sensors if role in roles}
    return {role: step for role, step in steps.items() if step is not None}


def deflection_step(steps: Mapping[str, float], views: Sequence[TransmissionView]) -> float:
    """Return the step of deflections [rad], that of both their sensors, of `encoder_steps`; 0 where they have none."""
    roles = {role for view in views for role in view.deflection_roles(steps)} & steps.keys()
    return float(np.linalg.norm([steps[role] for role in sorted(roles)]))
