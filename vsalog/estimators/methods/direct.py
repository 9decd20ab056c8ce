"""direct: deflection (or both positions) and a torque sensor, no motor data at all.

(φ, set-point) → τ by recursive least squares: Flacco 2012 eq. 21–37 with the measured torque as input, either by the enhanced
RLS (eq. 39–41) or by QR-RLS (Flacco 2014 eq. 21–23).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device
from vsalog.estimators.known_effects import conditioner_of
from vsalog.estimators.methods.residual_rls import sensor_equations
from vsalog.estimators.needs import torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.screening import screened
from vsalog.estimators.solvers import QrSolver, RlsSolver, least_samples
from vsalog.estimators.tuning import LARGEST, RlsTuning
from vsalog.estimators.windows import keeping_window

NAME = "direct"
SUMMARY = "deflection and torque sensor alone, no motor data; RLS or QR-RLS"


class DirectTuning(RlsTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of direct.

    Attributes
    ----------
    solver : ``rls`` (enhanced RLS, with p0 and c) or ``qr`` (QR-RLS, with forgetting)
    forgetting : λ of QR-RLS, 1 forgets nothing
    """

    default_window: ClassVar[int] = 21

    degree: Annotated[int, Meta(ge=1, le=30)] = 3
    solver: Literal["rls", "qr"] = "rls"
    forgetting: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0


TUNING = DirectTuning


def roles(device: Device, offered: Collection[str], tuning: DirectTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    return torque_roles(NAME, device, offered, "SENSOR")


def build(device: Device, signals: JointSignals, tuning: DirectTuning) -> RegressionFold:
    """Assemble the estimator for a joint's signals."""
    look = screened(device, signals, tuning)
    tuning = keeping_window(device, signals, tuning, tuning.default_window)
    needed = roles(device, signals.roles, tuning)
    conditioner = conditioner_of(device, signals, tuning, needed, motor=False)
    p0, least = tuning.initial_covariance(device, signals, 1e-4), least_samples(conditioner)
    solver = (
        QrSolver(tuning.forgetting, 0, max(tuning.c * p0, LARGEST**-4), least=least)  # the product must not become zero
        if tuning.solver == "qr"
        else RlsSolver(p0, tuning.c, least)
    )
    equations = sensor_equations(device, signals, tuning, conditioner)
    chosen = {"p0": p0}  # of which QR-RLS takes the product with c
    return RegressionFold(NAME, "SENSOR", device, conditioner, equations, solver, chosen=chosen, look=look)
