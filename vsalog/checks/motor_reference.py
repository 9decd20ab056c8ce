"""The estimate of `residual-rls` from the motor's torque and motion, as a reference for another estimator."""

from __future__ import annotations

from collections.abc import Sequence

from vsalog.binding.joint import offered_roles
from vsalog.core.errors import VsalogError
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device
from vsalog.estimators.methods import residual_rls
from vsalog.estimators.registry import method
from vsalog.perturbations.quantisation import Quantisation
from vsalog.perturbations.trials import Subject, tried
from vsalog.rig.schema import Joint


def motor_roles(device: Device, joint: Joint, read: Sequence[str]) -> tuple[str, ...]:
    """Return the roles by which the motor's side is a reference; none where its torque is read anyway, or missing."""
    views, offered = device.transmissions, offered_roles(joint)
    if not views or any(
        v.motor_torque in read or v.motor_torque not in offered or v.motor.inertia is None for v in views
    ):
        return ()
    try:
        return residual_rls.roles(device, offered, residual_rls.TUNING())
    except VsalogError:
        return ()


def motor_trace(device: Device, signals: JointSignals) -> Trace | None:
    """Return the estimate of residual-rls from a joint's signals; None where it cannot."""
    try:
        residual_rls.roles(device, signals.roles, residual_rls.TUNING())
        fold = residual_rls.build(device, signals, residual_rls.TUNING())
        fold.conditioner.check_length(signals.longest_run)
        return tried(
            Subject(method(residual_rls.NAME), device, signals, residual_rls.TUNING(), fold), (Quantisation(),)
        )
    except VsalogError:
        return None
