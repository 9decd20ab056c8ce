"""smoother: the offline optimum, from all that a joint's roles say of its stiffness, which may change.

A square-root Kalman filter and Rauch–Tung–Striebel smoother of the coefficients on the torque sensor's and the motors' equations
together (`smoothing.py`); the first as in Flacco 2012 eq. 21, the others as in Flacco 2014 eq. 9, before it is integrated.
"""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from typing import ClassVar

from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED, FALSE_ALARM
from vsalog.estimators.combined_equation import MOTOR_UNKNOWNS, SENSOR_UNKNOWNS, CombinedEquation
from vsalog.estimators.device import Device
from vsalog.estimators.equation import REPORTED_CHANGE
from vsalog.estimators.fold_state import FoldState
from vsalog.estimators.known_effects import conditioner_of
from vsalog.estimators.methods.qr_rls import integrated_equations
from vsalog.estimators.methods.residual_rls import sensor_equations
from vsalog.estimators.needs import sensor_role, torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.regressor_noise import noise_for_torque
from vsalog.estimators.row_noise import REACH
from vsalog.estimators.screening import screened
from vsalog.estimators.smoothing import Choice, SmootherSolver, Trajectory
from vsalog.estimators.tuning import Tuning
from vsalog.estimators.windows import keeping_window, motor_window
from vsalog.uncertainty.long_run import BOX

# Rows are averaged over a part of the filter's window, whose noise is alike anyway.
BOXES_OF_WINDOW = REACH

NAME = "smoother"
SUMMARY = (
    "all equations that the roles allow, a stiffness that may change, from the whole log (Kalman, Rauch–Tung–Striebel)"
)


class SmootherTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of smoother.

    Attributes
    ----------
    causal : estimate from the samples before alone; how noisy sensors are, and how fast the spring changes, is of the whole log
    """

    causal: bool = False


TUNING = SmootherTuning


class SmootherFold(RegressionFold):
    """The least-squares fold, of which the second pass evaluates what was smoothed."""

    follows_changes: ClassVar[bool] = True
    choices: tuple[Choice | None, ...] = ()
    solver: SmootherSolver

    def settled(self, state: FoldState) -> SmootherFold:
        """Return the same fold, which takes what was chosen from the log."""
        fold = copy(self)
        fold.choices = tuple(None if own.trajectory is None else own.trajectory.choice for own in state.solvers)
        return fold

    def start(self) -> FoldState:
        """Return the state before the first sample."""
        state = super().start()
        if self.choices:
            state.solvers = [own._replace(choice=c) for own, c in zip(state.solvers, self.choices, strict=True)]
        return state

    def findings(self, state: FoldState) -> tuple[Finding, ...]:
        """Return how a spring changed, and where a motor's inertia is not the rig's."""
        found: list[Finding] = []
        for equation, own in zip(self.equations, state.solvers, strict=True):
            assert isinstance(equation, CombinedEquation)
            if own.trajectory is not None:
                found += self._changes(equation, own.trajectory) + self._inertias(equation, own.trajectory)
        return (*super().findings(state), *found)

    def _changes(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return by how much transmissions changed, where the log shows that they did."""
        if trajectory.choice.probability_of_no_change > FALSE_ALARM:
            return []
        changes = zip(equation.transmissions, trajectory.torque[-1] - trajectory.torque[0], strict=True)
        return [
            Finding(
                code="stiffness.changed", joint=self.device.joint, part=view.name, severity="info", value=float(whole),
                evidence={"jumps": len(trajectory.choice.change.jumps)},
            )
            for view, whole in changes
        ]  # fmt: skip

    def _inertias(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return where a motor's inertia is another than the rig's."""
        found = []
        first = len(self.solver.unknowns) - len(equation.motors)
        for i, view in enumerate(equation.transmissions[: len(equation.motors)]):
            off, std = trajectory.others.get((first + i, "inertia"), (0.0, 0.0))
            rig = view.motor.reflected_inertia if equation.known else None
            if rig is not None and abs(off) > (limit := max(REPORTED_CHANGE * rig, DETECTED * std)):
                evidence = {"inertia": rig + off, "rig": rig, "ratio": 1.0 + off / rig}
                found.append(
                    Finding(
                        code="motor.inertia_differs", joint=self.device.joint, part=view.name, value=off, limit=limit,
                        unit="kg*m^2", evidence=evidence,
                    )
                )  # fmt: skip
        return found

    def freeze(self, state: FoldState) -> FoldState:
        """Smooth, and go back to the first sample."""
        frozen = super().freeze(state)
        frozen.solvers = [self.solver.smoothed(own) for own in state.solvers]
        return frozen


def roles(device: Device, offered: Collection[str], tuning: SmootherTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    found: list[str] = []
    refused: EstimatorError | None = None
    for modality in ("SENSOR", "INTEGRATED"):
        try:
            found += torque_roles(NAME, device, offered, modality)
        except EstimatorError as error:
            refused = error
    if not found:
        assert refused is not None
        raise refused
    return tuple(dict.fromkeys(found))


def build(device: Device, signals: JointSignals, tuning: SmootherTuning) -> SmootherFold:
    """Assemble the estimator for a joint's signals."""
    views, offered = device.transmissions, signals.roles
    sensed = all(sensor_role(view, offered) in offered for view in views)
    motors = all({view.motor_position, view.motor_torque} <= set(offered) for view in views)
    look = screened(device, signals, tuning)
    tuning = (
        motor_window(device, signals, tuning)
        if motors
        else keeping_window(device, signals, tuning, tuning.default_window)
    )
    conditioner = conditioner_of(device, signals, tuning, roles(device, offered, tuning), motor=motors)
    sensors = sensor_equations(device, signals, tuning, conditioner) if sensed else ()
    driven = integrated_equations(device, signals, tuning, conditioner) if motors else ()
    known = all(view.motor.reflected_inertia is not None for view in views)
    # One sensor for several transmissions ties them together.
    together = [views] if len(sensors) == 1 else [(view,) for view in views]
    equations = [
        CombinedEquation(
            own,
            device.basis,
            sensors[i] if sensors else None,
            driven if len(together) == 1 else driven[i : i + 1],
            known,
        )
        for i, own in enumerate(together)
    ]
    count = len(together[0])
    unknowns = (*((SENSOR_UNKNOWNS,) if sensed else ()), *(MOTOR_UNKNOWNS for _ in equations[0].motors))
    noises = (noise_for_torque(signals, view, conditioner) for view in views)
    solver = SmootherSolver(
        device.basis.powers_of_terms * count,
        count,
        unknowns,
        frozenset() if known else frozenset(MOTOR_UNKNOWNS[1:]),
        max(conditioner.window // BOXES_OF_WINDOW, BOX),
        (max(0.0 if noise is None else noise.own for noise in noises),) * count,
        equations[0].leading,
        tuning.causal,
    )
    return SmootherFold(NAME, "COMBINED", device, conditioner, tuple(equations), solver, passes=2, look=look)
