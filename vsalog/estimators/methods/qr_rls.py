"""qr-rls: integrated motor equation and QR-RLS; the motor's inertia and damping are estimated along with the stiffness.

Flacco, De Luca, "A pure signal-based stiffness estimation for VSA devices", ICRA 2014: integrated equation eq. 9–13, QR-RLS
eq. 18–23, the pair of filters eq. 28–30.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from vsalog.core.finding import Finding
from vsalog.core.resolution import sensor_noise
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED_OF_MANY
from vsalog.estimators.device import Device, TransmissionView
from vsalog.estimators.equation import REPORTED_CHANGE
from vsalog.estimators.equations import IntegratedMotorEquation
from vsalog.estimators.fold_state import FoldState
from vsalog.estimators.known_effects import conditioner_of, known_of
from vsalog.estimators.needs import torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.regressor_noise import noise_for_integral, regressor_noise
from vsalog.estimators.screening import screened
from vsalog.estimators.solvers import QrSolver, least_samples
from vsalog.estimators.torque_offset import torque_offsets
from vsalog.estimators.tuning import Positive, Tuning, usual_regressor
from vsalog.estimators.windows import motor_window
from vsalog.filters.conditioning import Conditioner
from vsalog.uncertainty.sensor_error import ENOUGH, LEAST_NOISE, sensor_error

NAME = "qr-rls"
SUMMARY = "integrated motor equation and QR-RLS (Flacco 2014); estimates motor inertia and damping too"

# p0 times the usual regressor squared [1]. Stronger, and the prior shows until the deflection has been through its range;
# weaker, and a direction that noise alone moves diverges in the first seconds.
PRIOR_VARIANCE = 2e5


class QrRlsTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of qr-rls.

    Attributes
    ----------
    forgetting : λ of eq. 21–22, 1 forgets nothing
    p0 : the coefficients begin at zero with covariance p0 I, which keeps an unexcited direction from diverging; the paper
        begins without (inf). When absent, weak, from the log's largest deflection and set-point
    """

    forgetting: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0
    p0: Positive | None = None


TUNING = QrRlsTuning


class IntegratedFold(RegressionFold):
    """The least-squares fold, with a check of the motor's inertia: the rig has it, and the log determines it."""

    # It fits the integrals of torques.
    fits_torque: ClassVar[bool] = False

    def findings(self, state: FoldState) -> tuple[Finding, ...]:
        """Return where the motor's inertia differs from the rig's: its torque's scale enters it and the stiffness."""
        another = []
        for equation, solver_state in zip(self.equations, state.solvers, strict=True):
            view = equation.transmissions[0]
            unknowns, covariance, _ = self.solver.solution(solver_state)
            found, std, rig = float(unknowns[1]), float(covariance[1, 1]) ** 0.5, view.motor.reflected_inertia
            if rig is not None and abs(found - rig) > (limit := max(REPORTED_CHANGE * rig, DETECTED_OF_MANY * std)):
                another.append(
                    Finding(
                        code="motor.inertia_differs",
                        joint=self.device.joint,
                        part=view.name,
                        value=found - rig,
                        limit=limit,
                        unit="kg*m^2",
                        evidence={"inertia": found, "rig": rig, "ratio": found / rig},
                    )
                )
        return (*super().findings(state), *another)


def printed(device: Device) -> dict[str, str]:
    """Return the tuning that Flacco 2014 prints for noisy signals, §VII."""
    return {"filter": "pair", "window": "1.0", "degree": "20", "forgetting": "1.0", "p0": "inf"}


def roles(device: Device, offered: Collection[str], tuning: Tuning, name: str = NAME) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    return torque_roles(name, device, offered, "INTEGRATED")


def build(device: Device, signals: JointSignals, tuning: QrRlsTuning) -> IntegratedFold:
    """Assemble the estimator for a joint's signals."""
    look = screened(device, signals, tuning)
    tuning = motor_window(device, signals, tuning)
    p0 = tuning.p0 if tuning.p0 is not None else PRIOR_VARIANCE / usual_regressor(device, signals) ** 2
    conditioner = conditioner_of(device, signals, tuning, roles(device, signals.roles, tuning), motor=True)
    leading = IntegratedMotorEquation.leading
    solver = QrSolver(tuning.forgetting, leading, p0, integral=True, least=least_samples(conditioner))
    equations = integrated_equations(device, signals, tuning, conditioner)
    look = look.and_also(torque_offsets(device, signals, conditioner, equations))
    return IntegratedFold(NAME, "INTEGRATED", device, conditioner, equations, solver, look=look)


def integrated_equations(
    device: Device, signals: JointSignals, tuning: Tuning, conditioner: Conditioner
) -> tuple[IntegratedMotorEquation, ...]:
    """One equation per transmission."""
    return tuple(_equation(device, view, signals, tuning, conditioner) for view in device.transmissions)


def _equation(
    device: Device, view: TransmissionView, signals: JointSignals, tuning: Tuning, conditioner: Conditioner
) -> IntegratedMotorEquation:
    """Return the equation of a transmission; its speed has noise of its own, which is not integrated."""
    torque, noise = view.motor_torque, None
    if conditioner.kind != "kinematic":
        direct = np.zeros(IntegratedMotorEquation.leading + device.basis.size)
        moved = sensor_error(signals.roles[view.motor_position][:ENOUGH], conditioner.window)
        direct[1] = moved.rms(conditioner.weights[1]) ** 2
        noise = regressor_noise([noise_for_integral(signals, view, conditioner)], direct)
    return IntegratedMotorEquation(
        view,
        device.basis,
        signals.period,
        known_of(device, view, signals, tuning, torque, motor=True),
        sensor_noise(signals.roles[torque], signals.resolution.get(torque, 0.0), LEAST_NOISE),
        noise,
    )
