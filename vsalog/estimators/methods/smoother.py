"""smoother: the offline optimum of a stiffness that may change, from all equations that a joint's roles allow.

A square-root Kalman filter and Rauch–Tung–Striebel smoother of the coefficients on the torque sensor's and the motors' equations
together (`smoothing.py`); the first as in Flacco 2012 eq. 21, the others as in Flacco 2014 eq. 9, before it is integrated.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import ClassVar, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from vsalog.core.basis import PolynomialBasis
from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED, FALSE_ALARM
from vsalog.estimators.box_rows import BOXES
from vsalog.estimators.combined_equation import (
    MOTOR_UNKNOWNS,
    SENSOR_UNKNOWNS,
    UNKNOWN_MOTOR,
    CombinedEquation,
)
from vsalog.estimators.device import Device, TransmissionView
from vsalog.estimators.equation import GAIN, REPORTED_CHANGE, REPORTED_MISFIT, Equation
from vsalog.estimators.fold_state import FoldState
from vsalog.estimators.folding import BLOCK
from vsalog.estimators.known_effects import conditioner_of, slack_of
from vsalog.estimators.methods.qr_rls import integrated_equations
from vsalog.estimators.methods.residual_rls import sensor_equations
from vsalog.estimators.needs import sensor_role, torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.regressor_noise import noise_for_torque
from vsalog.estimators.residual_motion import POSITION, SUSPECTS, MotionRows, followers, following
from vsalog.estimators.screening import Screening, screened
from vsalog.estimators.smoothing import LIMITS, SHARED, Choice, SmootherSolver, SmootherState, Trajectory
from vsalog.estimators.tuning import Tuning
from vsalog.estimators.windows import keeping_window, motor_window, rms
from vsalog.filters.conditioning import Conditioner
from vsalog.filters.savitzky_golay import savgol_filter
from vsalog.rig.tolerance import default_deviation
from vsalog.uncertainty.long_run import BOX
from vsalog.uncertainty.sensor_error import ENOUGH, sensor_error

Array = NDArray[np.float64]

NAME = "smoother"
SUMMARY = (
    "all equations that the roles allow, a stiffness that may change, from the whole log (Kalman, Rauch–Tung–Striebel)"
)


class SmootherTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of smoother.

    Attributes
    ----------
    basis : ``auto``: the rig's, with a spline and with friction elements where the log shows that the spring is no polynomial or
        has a loop; ``rig``: the rig's
    causal : estimate from the samples before alone; how noisy sensors are, and how fast the spring changes, is of the whole log
    """

    basis: Literal["auto", "rig"] = "auto"
    causal: bool = False


TUNING = SmootherTuning


class Shape(NamedTuple):
    """What a basis gets where the log needs it.

    Attributes
    ----------
    knots : on either side of zero [1]: corners in between cost half a percent
    slips : friction elements [1], which slip after a half, a quarter … of the largest deflection
    intervals : between which a spring may change while shapes are compared [1]
    """

    knots: int = 16
    slips: int = 5
    intervals: int = 32


SHAPE = Shape()


class SmootherFold(RegressionFold):
    """The least-squares fold, of which the second pass evaluates what was smoothed."""

    follows_changes: ClassVar[bool] = True
    equations: tuple[CombinedEquation, ...]
    solver: SmootherSolver

    def __init__(
        self, device: Device, conditioner: Conditioner, equations: tuple[CombinedEquation, ...], solver: SmootherSolver,
        look: Screening, tuning: SmootherTuning,
    ) -> None:  # fmt: skip
        super().__init__(NAME, "COMBINED", device, conditioner, equations, solver, passes=2, look=look)
        self.tuning = tuning
        self.choices: tuple[Choice | None, ...] = ()
        self.rig_basis = device.basis

    def rebuilt(self, signals: JointSignals) -> SmootherFold:
        """Return the fold for other signals of the same joint, with the functions of this one."""
        fold = build(self.device, signals, msgspec.structs.replace(self.tuning, basis="rig"))
        return fold.with_shape(self.device.basis, self.equations[0].slips)

    def settled(self, state: FoldState) -> SmootherFold:
        """Return the same fold, which takes what was chosen from the log."""
        fold = copy(self)
        fold.choices = tuple(None if own.trajectory is None else own.trajectory.choice for own in state.solvers)
        return fold

    def with_shape(self, basis: PolynomialBasis, slips: tuple[float, ...]) -> SmootherFold:
        """Return the same fold with other functions, and friction elements that slip after such deflections [rad]."""
        fold, count = copy(self), self.solver.transmissions
        fold.device = replace(self.device, basis=basis)
        fold.equations = tuple(equation.with_basis(basis).with_slips(slips) for equation in self.equations)
        fold.solver = replace(self.solver, powers=basis.powers_of_terms * count, shared=len(slips) * count)
        return fold

    def start(self) -> FoldState:
        """Return the state before the first sample."""
        state = super().start()
        if self.choices:
            state.solvers = [own._replace(choice=c) for own, c in zip(state.solvers, self.choices, strict=True)]
        return state

    def findings(self, state: FoldState) -> tuple[Finding, ...]:
        """Return how a spring changed, and where a motor's inertia is not the rig's."""
        found = self._shapes(state)
        for equation, own in zip(self.equations, state.solvers, strict=True):
            if own.trajectory is not None:
                found += self._changes(equation, own.trajectory)
                found += self._inertias(equation, own.trajectory) + self._gains(equation, own.trajectory)
                if own.trajectory.misfit > REPORTED_MISFIT:
                    part = " and ".join(view.name for view in equation.transmissions)
                    found.append(
                        Finding(
                            code="residual.not_noise", joint=self.device.joint, part=part, value=own.trajectory.misfit,
                            limit=REPORTED_MISFIT,
                        )
                    )  # fmt: skip
        return (*super().findings(state), *found)

    def _judged(self, equation: Equation, rows: MotionRows, claimed: float, step: float) -> list[Finding]:
        """Return what the first equation's residual follows; whether it is noise, trajectories know better."""
        assert isinstance(equation, CombinedEquation)
        # A motor's equation has its speed and acceleration among the unknowns; what a loop leaves goes with the speed.
        suspects = () if equation.slips else SUSPECTS if equation.sensor is not None else (POSITION,)
        found = followers(rows, claimed, step, suspects)
        part = " and ".join(view.name for view in equation.transmissions)
        return [following(self.device.joint, part, found, equation.motor, claimed)] if found else []

    def _shapes(self, state: FoldState) -> list[Finding]:
        """Return what the log shows of the springs' shapes that the rig's basis has not."""
        found: list[Finding] = []
        basis = self.device.basis
        if basis.knots > self.rig_basis.knots:
            found.append(
                Finding(
                    code="spring.not_polynomial",
                    joint=self.device.joint,
                    severity="info",
                    evidence={"knots": basis.knots},
                )
            )
        for equation, own in zip(self.equations, state.solvers, strict=True):
            if own.trajectory is None or not equation.slips:
                continue
            for i, view in enumerate(equation.transmissions):
                # When all elements slip, each resists with its stiffness times the deflection at which it slips.
                shared = [(i * len(equation.slips) + j, SHARED) for j in range(len(equation.slips))]
                parts = [own.trajectory.others[key] for key in shared]
                level = sum(value * reach for (value, _), reach in zip(parts, equation.slips, strict=True))
                found.append(
                    Finding(
                        code="spring.loop",
                        joint=self.device.joint,
                        part=view.name,
                        severity="info",
                        value=level,
                        unit="N*m",
                    )
                )
        return found

    def _changes(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return by how much transmissions changed, where the log shows that they did."""
        if trajectory.choice.probability_of_no_change > FALSE_ALARM:
            return []
        jumps = len(trajectory.choice.change.jumps)
        found = []
        for view, whole in zip(equation.transmissions, trajectory.torque[-1] - trajectory.torque[0], strict=True):
            # No spring vanishes or doubles, or breaks as often as the search allows.
            odd = jumps == LIMITS.jumps or abs(whole) > LIMITS.fastest
            if not jumps and abs(whole) < LIMITS.slowest:
                continue
            found.append(
                Finding(
                    code="stiffness.changed", joint=self.device.joint, part=view.name, severity="warning" if odd else "info",
                    value=float(whole), evidence={"jumps": jumps},
                )
            )  # fmt: skip
        return found

    def _inertias(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return where a motor's inertia is another than the rig's."""
        found = []
        first = int(equation.sensor is not None)
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

    def _gains(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return which torque has another gain than the other equations say."""
        found, views = [], equation.transmissions
        for (i, name), (off, std) in trajectory.others.items():
            if name != GAIN or abs(off) <= (limit := max(REPORTED_CHANGE, DETECTED * std)):
                continue
            sensed = i == 0
            found.append(
                Finding(
                    code="torque.gain_differs", joint=self.device.joint,
                    part=" and ".join(view.name for view in (views if sensed else views[i - 1 : i])),
                    value=1.0 + off, limit=1.0 + float(np.copysign(limit, off)),
                    evidence={"signal": "torque_sensor" if sensed else "motor_torque", "std": std},
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
    """Assemble the estimator for a joint's signals, with more functions than the rig's basis has where the log needs them."""
    views, offered = device.transmissions, signals.roles
    sensed = all(sensor_role(view, offered) in offered for view in views)
    motors = all({view.motor_position, view.motor_torque} <= set(offered) for view in views)
    look, asked = screened(device, signals, tuning), tuning
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
            slack=slack_of(own[0], signals, tuning),
        )
        for i, own in enumerate(together)
    ]
    count = len(together[0])
    unknowns = (*((SENSOR_UNKNOWNS,) if sensed else ()), *(MOTOR_UNKNOWNS for _ in equations[0].motors))
    noises = (noise_for_torque(signals, view, conditioner) for view in views)
    box = max(conditioner.window // BOXES.per_window, BOX)
    noisy = _noise_of_acceleration(signals, views, conditioner, box) if motors else 0.0
    sensor_parts = int(sensed)
    motor_parts = len(unknowns) - sensor_parts
    # Noise of a regressor makes its coefficient smaller by its share of the power, which is not to be reported as a change.
    hidden = {"inertia", GAIN} if noisy > REPORTED_CHANGE else set[str]()
    # A gain is relative to the other equations, and inertia and damping that the rig does not have are relative to the torque's.
    if not (sensed and known):
        hidden.add(GAIN)
    solver = SmootherSolver(
        device.basis.powers_of_terms * count,
        count,
        unknowns,
        frozenset() if known else frozenset(UNKNOWN_MOTOR[1:]),
        (frozenset(() if motors else (GAIN,)),) * sensor_parts + (frozenset(hidden),) * motor_parts,
        (default_deviation("torque_sensor.gain", 1.0, 1.0),) * sensor_parts
        + (default_deviation("motor.torque_gain", 1.0, 1.0),) * motor_parts,
        box,
        (max(0.0 if noise is None else noise.own for noise in noises),) * count,
        leading=equations[0].leading,
        causal=tuning.causal,
    )
    plain = SmootherFold(device, conditioner, tuple(equations), solver, look, asked)
    return plain if tuning.basis == "rig" or tuning.causal else _fitting(plain, signals)


def _noise_of_acceleration(
    signals: JointSignals, views: Sequence[TransmissionView], conditioner: Conditioner, box: int
) -> float:
    """Return which part of the power of the motors' accelerations, averaged over boxes, is noise, at most."""
    if conditioner.kind == "kinematic":
        return 1.0
    # The average of an acceleration is a difference of speeds.
    speed = conditioner.weights[1]
    weights = np.concatenate((speed, np.zeros(box))) - np.concatenate((np.zeros(box), speed))
    shares = []
    for view in views:
        theta = signals.roles[view.motor_position][:ENOUGH]
        moved = rms(savgol_filter(theta, weights[None])[0])
        shares.append(sensor_error(theta, weights.size).rms(weights) ** 2 / moved**2 if moved else 1.0)
    return float(min(max(shares), 1.0))


def _fitting(plain: SmootherFold, signals: JointSignals) -> SmootherFold:
    """Return a fold with the functions that the log needs; more have to be a thousand times as probable as fewer."""
    basis = plain.device.basis
    # Of a basis with a set-point each knot would be there several times.
    spline = basis if basis.setpoint_order > 1 else replace(basis, knots=max(basis.knots, SHAPE.knots))
    slips = tuple(basis.deflection_scale * 2.0**-k for k in range(1, SHAPE.slips + 1))
    states = {plain: _collected(plain, signals)}
    best = plain
    for own, elements in ((spline, ()), (basis, slips), (spline, slips)):
        if own == basis and not elements:
            continue
        fold = plain.with_shape(own, elements)
        states[fold] = _collected(fold, signals)
        # A spring that changes may look like one of another shape, until that is allowed for.
        if all(_more_probable(states, fold, best, intervals) for intervals in (1, SHAPE.intervals)):
            best = fold
    return best


def _collected(fold: SmootherFold, signals: JointSignals) -> list[SmootherState]:
    """Return what the solvers of a fold have collected from all signals."""
    state = fold.start()
    for part in signals.blocks(BLOCK):
        state, _ = fold.step(state, part)
    state, _ = fold.finish(state)
    return state.solvers


def _more_probable(
    states: Mapping[SmootherFold, list[SmootherState]], fold: SmootherFold, other: SmootherFold, intervals: int
) -> bool:
    """Tell whether a fold's functions are a thousand times as probable as another's."""
    evidence = (sum(one.solver.evidence(own, intervals) for own in states[one]) for one in (fold, other))
    return next(evidence) - next(evidence) > -math.log(FALSE_ALARM)
