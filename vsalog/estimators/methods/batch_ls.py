"""batch-ls: the integrated motor equation solved once over the whole log (Flacco 2014 eq. 14–16).

The signals are gone through twice: first to solve, then to evaluate the stiffness with what was found. The solution is the
pseudo-inverse's, by the same orthogonal rotations as qr-rls, so that memory does not grow with the log.
"""

from __future__ import annotations

from collections.abc import Collection

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import Device
from vsalog.estimators.equations import IntegratedMotorEquation
from vsalog.estimators.known_effects import conditioner_of
from vsalog.estimators.methods import qr_rls
from vsalog.estimators.screening import screened
from vsalog.estimators.solvers import QrSolver, least_samples
from vsalog.estimators.torque_offset import torque_offsets
from vsalog.estimators.tuning import Tuning
from vsalog.estimators.windows import motor_window

NAME = "batch-ls"
SUMMARY = "integrated motor equation, least squares over the whole log (Flacco 2014 eq. 16)"


class BatchLsTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of batch-ls: that of the filters."""


TUNING = BatchLsTuning


def roles(device: Device, offered: Collection[str], tuning: BatchLsTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    return qr_rls.roles(device, offered, tuning, NAME)


def build(device: Device, signals: JointSignals, tuning: BatchLsTuning) -> qr_rls.IntegratedFold:
    """Assemble the estimator for a joint's signals."""
    look = screened(device, signals, tuning)
    tuning = motor_window(device, signals, tuning)
    conditioner = conditioner_of(device, signals, tuning, roles(device, signals.roles, tuning), motor=True)
    equations = qr_rls.integrated_equations(device, signals, tuning, conditioner)
    look = look.and_also(torque_offsets(device, signals, conditioner, equations))
    solver = QrSolver(1.0, IntegratedMotorEquation.leading, integral=True, least=least_samples(conditioner))
    return qr_rls.IntegratedFold(NAME, "INTEGRATED", device, conditioner, equations, solver, passes=2, look=look)
