"""residual-rls: residual-based flexibility torque and enhanced recursive least squares.

Flacco, De Luca, Sardellitti, Tsagarakis, "On-line estimation of variable stiffness in flexible robot joints", IJRR 31(13), 2012:
residual eq. 15–17, MKKF eq. 18–20, RLS eq. 21–28, serial devices eq. 35–37, enhanced RLS eq. 39–41, modalities eq. 44.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import EstimatorError
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.equation import Equation
from vsalog.estimators.equations import ResidualEquation, TorqueEquation
from vsalog.estimators.known_effects import conditioner_of, known_of
from vsalog.estimators.needs import sensor_role, torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.regressor_noise import noise_for_residual, noise_for_torque, regressor_noise
from vsalog.estimators.screening import screened
from vsalog.estimators.solvers import RlsSolver, least_samples
from vsalog.estimators.tuning import LARGEST, Modality, Positive, RlsTuning, Tuning
from vsalog.estimators.windows import WINDOWS, keeping_window, motor_window
from vsalog.filters.conditioning import Conditioned, Conditioner
from vsalog.filters.savitzky_golay import savgol_cutoff
from vsalog.mechanics.transmissions import flexibility_torque
from vsalog.rig.schema import UnknownTransmission

RESIDUAL_BANDWIDTH = 3.0
"""Bandwidth of the residual over that of the filter before it [1], which then decides what passes; and half the sample rate over
the bandwidth that may be asked for: beyond, that of the trapezoidal rule's lag is more than 8 % off."""

NAME = "residual-rls"
SUMMARY = "motor-side residual and enhanced RLS (Flacco 2012); needs the motor's inertia, no torque sensor"


class ResidualRlsTuning(RlsTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of residual-rls.

    Attributes
    ----------
    modality : where the torque comes from: RESIDUAL (the motor equation), SENSOR (the torque sensor) or MODEL (the rig's
        nominal transmission)
    bandwidth : K_I of the residual [rad/s]; when absent three times that of the Savitzky–Golay filter before it, which then
        decides what passes, and the residual's lag is short compared with its window
    matched : pass the regressors through the residual's lag too; the paper does not
    """

    modality: Modality = "RESIDUAL"
    bandwidth: Positive | None = None
    matched: bool = True


TUNING = ResidualRlsTuning
# Flacco 2012 §6.1, for all joints.
PRINTED = {"filter": "kinematic", "shape": "6", "settle": "0", "bandwidth": "300", "matched": "false"}


def printed(device: Device) -> dict[str, str]:
    """Return the tuning that Flacco 2012 prints: §6.1 for the VSA-II, §6.2 for joints with a set-point, as the AwAS."""
    p0, c = ("1e20", "1e-20") if device.has_setpoint else ("1e6", "1e-5")
    return {**PRINTED, "p0": p0, "c": c}


def roles(device: Device, offered: Collection[str], tuning: ResidualRlsTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    return torque_roles(f"{NAME} ({tuning.modality})", device, offered, tuning.modality)


def build(device: Device, signals: JointSignals, tuning: ResidualRlsTuning) -> RegressionFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        The modality needs a motor inertia or a nominal transmission that the rig does not give, or the samples cannot follow
        the bandwidth.
    """
    look, chosen = screened(device, signals, tuning), {}
    if tuning.modality == "RESIDUAL":
        tuning = motor_window(device, signals, tuning)
        chosen["bandwidth"] = bandwidth = _bandwidth(signals, tuning)
        tuning = msgspec.structs.replace(tuning, bandwidth=bandwidth)
    else:
        tuning = keeping_window(device, signals, tuning, tuning.default_window)
    # Measured torques are noisy: the many terms of a basis would follow the noise until it averages out. But what
    # gives a spring its shape, the term after the first, is not the prior's: it made stiffnesses 3 to 6 % off, with 1 % claimed.
    p0 = tuning.initial_covariance(device, signals, 1e-3 if tuning.modality == "MODEL" else 0.01, second=True)
    needed = roles(device, signals.roles, tuning)
    conditioner = (
        tuning.conditioner(needed, signals)
        if tuning.modality == "MODEL"
        else conditioner_of(device, signals, tuning, needed, motor=tuning.modality == "RESIDUAL")
    )
    solver = RlsSolver(p0, tuning.c, least_samples(conditioner))
    equations = _equations(device, signals, tuning, conditioner)
    return RegressionFold(NAME, tuning.modality, device, conditioner, equations, solver, chosen=chosen, look=look)


def _bandwidth(signals: JointSignals, tuning: ResidualRlsTuning) -> float:
    """Return the residual's bandwidth [rad/s], as asked for or by the filter before it."""
    if tuning.bandwidth is None:
        window = WINDOWS[0] if tuning.window is None else round(tuning.window / signals.period) + 1
        # A window longer than the log is refused with the filter.
        window = min(window, signals.longest_run)
        return RESIDUAL_BANDWIDTH * savgol_cutoff(max(window, tuning.degree + 1), tuning.degree) / signals.period
    slowest = 1.0 / (signals.longest_run * signals.period)
    fastest = np.pi / (RESIDUAL_BANDWIDTH * signals.period)
    if not slowest <= tuning.bandwidth <= fastest:
        raise EstimatorError(
            f"{NAME}: samples at {1.0 / signals.period:.4g} Hz over {signals.longest_run * signals.period:.4g} s cannot follow a"
            f" bandwidth of {tuning.bandwidth:.4g} rad/s: give one between {slowest:.3g} and {fastest:.3g}, or leave it out"
        )
    return tuning.bandwidth


def _equations(
    device: Device, signals: JointSignals, tuning: ResidualRlsTuning, conditioner: Conditioner
) -> tuple[Equation, ...]:
    if tuning.modality == "RESIDUAL":
        return tuple(_residual(device, view, signals, tuning, conditioner) for view in device.transmissions)
    if tuning.modality == "MODEL":
        return tuple(_model(device, view) for view in device.transmissions)
    return sensor_equations(device, signals, tuning, conditioner)


def sensor_equations(
    device: Device, signals: JointSignals, tuning: Tuning, conditioner: Conditioner
) -> tuple[TorqueEquation, ...]:
    """One equation per sensor: one for each transmission, or one that sees the sum of both."""
    views = device.transmissions
    sensors = [sensor_role(view, signals.roles) for view in views]
    known = [known_of(device, v, signals, tuning, s, motor=False) for v, s in zip(views, sensors, strict=True)]
    noises = [noise_for_torque(signals, v, conditioner) for v in views]
    if len(views) > 1 and len(set(sensors)) == 1:
        both = tuple(k for k in known if k is not None), regressor_noise(noises)
        return (TorqueEquation(views, device.basis, _column(sensors[0]), *both),)
    return tuple(
        TorqueEquation((v,), device.basis, _column(s), () if k is None else (k,), regressor_noise([n]))
        for v, s, k, n in zip(views, sensors, known, noises, strict=True)
    )


def _column(role: str) -> Callable[[Conditioned], NDArray[np.float64]]:
    return lambda block: block.fit[role]


def _model(device: Device, view: TransmissionView) -> Equation:
    if isinstance(view.nominal, UnknownTransmission):
        raise EstimatorError(
            f"joint '{device.joint}': the MODEL modality needs a nominal transmission; the rig has type = \"unknown\""
        )

    def torque(block: Conditioned) -> NDArray[np.float64]:
        phi, time = deflection_of(block.fit, view), block.rows.time
        return flexibility_torque(view.nominal, phi, block.fit.get("setpoint"), time)

    return TorqueEquation((view,), device.basis, torque)


def _residual(
    device: Device, view: TransmissionView, signals: JointSignals, tuning: ResidualRlsTuning, conditioner: Conditioner
) -> Equation:
    motor = "motor" if len(device.transmissions) == 1 else f"motor_{view.name}"
    for name in ("inertia", "damping", "gear_ratio"):
        value = getattr(view.motor, name)
        if value is not None and value > LARGEST:
            raise EstimatorError(
                f"joint '{device.joint}': a motor's {name} of {value:.3g} cannot be: correct [joint.{device.joint}.{motor}]"
                f" {name} in the rig"
            )
    assert tuning.bandwidth is not None
    inertia = view.motor.reflected_inertia
    if inertia is None:
        raise EstimatorError(
            f"joint '{device.joint}': {NAME} (RESIDUAL) needs the motor's inertia: set"
            f" [joint.{device.joint}.{motor}] inertia in the rig, or use --estimator qr-rls, which estimates it"
        )
    damping, rate = view.motor.reflected_damping, tuning.bandwidth
    noise = noise_for_residual(signals, view, conditioner, (inertia, damping), rate, tuning.matched)
    return ResidualEquation(
        view,
        device.basis,
        inertia,
        damping,
        rate,
        signals.period,
        tuning.matched,
        known_of(device, view, signals, tuning, view.motor_torque, motor=True),
        regressor_noise([noise]),
    )
