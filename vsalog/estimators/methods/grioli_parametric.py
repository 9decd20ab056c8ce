"""grioli-parametric: a model of the flexibility torque fitted to the rate of a torque sensor. No motor data, no sensor offset.

Grioli, Bicchi, "A real-time parametric stiffness observer for VSA devices", ICRA 2011: the flexibility torque as a sum of known
functions with unknown parameters, which follow from the residual of the measured torque's rate.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from vsalog.core.basis import PolynomialBasis
from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.equation import EquationRows
from vsalog.estimators.fold_state import FoldState
from vsalog.estimators.needs import sensor_role, torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.regressor_noise import noise_behind_filters
from vsalog.estimators.screening import screened
from vsalog.estimators.solvers import QrSolver, least_samples
from vsalog.estimators.transmission_torque import effects_left_in
from vsalog.estimators.tuning import Positive, Tuning, usual_regressor
from vsalog.estimators.windows import noisy_rates, suitable_windows, with_window
from vsalog.filters.conditioning import Conditioned, Conditioner
from vsalog.uncertainty.errors_in_variables import RegressorNoise

NAME = "grioli-parametric"
SUMMARY = "rate of a torque sensor and recursive least squares (Grioli and Bicchi 2011); blind to the sensor's offset"


class GrioliParametricTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of grioli-parametric.

    Attributes
    ----------
    forgetting : λ of the least squares, a squared error is discounted by λ² a step; 1 forgets nothing
    p0 : the parameters begin at zero with covariance p0 I; when absent, weak, from the log's largest deflection and set-point
    """

    unused: ClassVar[tuple[str, ...]] = ("settle",)

    forgetting: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0
    p0: Positive | None = None

    def __post_init__(self) -> None:
        if self.filter == "kinematic":
            raise ValueError("the torque's rate comes from a Savitzky–Golay filter; filter=pair is causal")


TUNING = GrioliParametricTuning


def roles(device: Device, offered: Collection[str], tuning: GrioliParametricTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    return torque_roles(NAME, device, offered, "SENSOR")


def build(device: Device, signals: JointSignals, tuning: GrioliParametricTuning) -> RateFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        The basis has different branches for loading and unloading, between which the torque jumps.
    """
    if device.basis.branches:
        raise EstimatorError(
            f"joint '{device.joint}': a basis with branches jumps from one to the other, and {NAME} fits rates; leave"
            f" branches out of [joint.{device.joint}.basis], or use --estimator direct"
        )
    look = screened(device, signals, tuning)
    tuning = with_window(tuning, signals, suitable_windows(device, signals, tuning)[0])
    needed = roles(device, signals.roles, tuning)
    p0 = tuning.p0 if tuning.p0 is not None else 1e4 / usual_regressor(device, signals) ** 2
    functions, sensors = BasisFunctions(device), [sensor_role(v, signals.roles) for v in device.transmissions]
    conditioner = tuning.conditioner(needed, signals, rates=(*sensors, *functions.roles), before=functions)
    solver = QrSolver(tuning.forgetting, 0, p0, least=least_samples(conditioner))
    equations = rate_equations(device, signals, conditioner)
    fold = RateFold(NAME, "SENSOR", device, conditioner, equations, solver, look=look)
    fold.noisy = noisy_rates(device, signals, conditioner.weights)
    return fold


class RateFold(RegressionFold):
    """The least-squares fold, with findings about rates."""

    # It fits the rates of torques.
    fits_torque: ClassVar[bool] = False
    noisy: Sequence[Finding] = ()

    def findings(self, state: FoldState) -> tuple[Finding, ...]:
        """Return the effects that enter the stiffness along with the spring."""
        return (*super().findings(state), *self.noisy, *effects_left_in(NAME, self.device))


def rate_equations(device: Device, signals: JointSignals, conditioner: Conditioner) -> tuple[RateEquation, ...]:
    """One equation per sensor: one for each transmission, or one that sees the sum of both."""
    views = device.transmissions
    sensors = [sensor_role(view, signals.roles) for view in views]
    # Noise e of a deflection enters the rate of f as f' ė.
    noises = tuple(noise_behind_filters(signals, view, conditioner.weights[1]) for view in views)
    if len(views) > 1 and len(set(sensors)) == 1:
        return (RateEquation(views, device.basis, sensors[0], RegressorNoise(noises)),)
    each = zip(views, sensors, noises, strict=True)
    return tuple(RateEquation((v,), device.basis, s, RegressorNoise((n,))) for v, s, n in each)


class BasisFunctions:
    """Add the functions f_i(φ, c) to the signals, before the filter: a preparation without a state.

    Filtered like the torque, they are consistent with it however long the window is; f of a filtered φ would not.
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self.roles = tuple(role for v in device.transmissions for role in function_roles(device.basis, v))

    def start(self) -> None:
        """Return the state before the first sample: there is none."""

    def step(self, state: None, block: JointSignals) -> tuple[None, list[JointSignals]]:
        """Take a block; return it with the functions added."""
        c = block.roles["setpoint"] if self.device.basis.has_setpoint else None
        columns = [self.device.basis.rows(deflection_of(block.roles, v), c, 0)[:, 0] for v in self.device.transmissions]
        values = dict(zip(self.roles, np.hstack(columns).T, strict=True))
        return None, [replace(block, roles={**block.roles, **values})]

    def finish(self, state: None) -> tuple[None, list[JointSignals]]:
        """Give out what is held back: nothing."""
        return None, []


def function_roles(basis: PolynomialBasis, view: TransmissionView) -> list[str]:
    """Return the names of the functions of a transmission among the signals."""
    return [f"function:{view.name}:{i}" for i in range(basis.size)]


@dataclass(frozen=True, slots=True)
class RateEquation:
    """Σ p_i df_i/dt = Σ̇: the torque equation (Flacco 2012 eq. 21) differentiated, along φ and the set-point.

    Several transmissions under one sensor add up. A function that is constant has no rate, and its parameter stays at zero.
    """

    transmissions: tuple[TransmissionView, ...]
    basis: PolynomialBasis
    sensor: str
    noise: RegressorNoise | None = None

    leading: ClassVar[int] = 0
    parameters: ClassVar[tuple[str, ...]] = ()

    @property
    def motor(self) -> None:
        """The torque is not computed from a motor's motion."""

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * len(self.transmissions)

    def start(self) -> None:
        """Return the state before the first sample: there is none."""

    def rows(self, state: None, block: Conditioned) -> tuple[None, EquationRows]:
        """Form the equation for a block."""
        names = [role for v in self.transmissions for role in function_roles(self.basis, v)]
        F = np.column_stack([block.fit[f"velocity:{name}"] for name in names])
        y, torque = block.fit[f"velocity:{self.sensor}"], block.fit[self.sensor]
        use = block.use & np.isfinite(y) & np.isfinite(F).all(axis=1)
        # One sensor for several transmissions does not determine each alone.
        alone = len(self.transmissions) == 1
        fed = {v.name: torque if alone else np.full_like(torque, np.nan) for v in self.transmissions}
        if not alone:
            fed["total"] = torque
        # Differentiated like the rest.
        motor = self.transmissions[0].motor_position
        moves = f"velocity:{motor}", f"acceleration:{motor}"
        motion = (block.fit[moves[0]], block.fit[moves[1]]) if moves[1] in block.fit else None
        return None, EquationRows(F, y, use, np.zeros_like(use), fed, {}, noise=self.noise, motion=motion)
