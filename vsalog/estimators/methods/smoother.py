"""smoother: the offline optimum of a stiffness that may change, from all equations that a joint's roles allow.

A square-root Kalman filter and Rauch–Tung–Striebel smoother of the coefficients on the torque sensor's and the motors' equations
together (`smoothing.py`); the first as in Flacco 2012 eq. 21, the others as in Flacco 2014 eq. 9, before it is integrated.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vsalog.core.basis import PolynomialBasis
from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED, FALSE_ALARM, two_sided
from vsalog.estimators.box_rows import BOXES
from vsalog.estimators.combined_equation import UNKNOWN_MOTOR, CombinedEquation
from vsalog.estimators.corners import Corner
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.equation import GAIN, REPORTED_CHANGE, REPORTED_MISFIT, Equation, EquationRows
from vsalog.estimators.equations import TorqueEquation
from vsalog.estimators.fold_state import FoldState
from vsalog.estimators.function_roles import Functions
from vsalog.estimators.known_effects import conditioner_of, known_of, slack_of
from vsalog.estimators.link_equation import LinkEquation
from vsalog.estimators.loops import Element, loops_among
from vsalog.estimators.methods.qr_rls import integrated_equations
from vsalog.estimators.methods.residual_rls import sensor_equations
from vsalog.estimators.needs import deflection_roles, require, sensor_role, torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.regressor_noise import noise_behind_filters
from vsalog.estimators.residual_motion import POSITION, SUSPECTS, MotionRows, followers, following
from vsalog.estimators.screening import Screening, screened
from vsalog.estimators.shapes import ShapeSearch
from vsalog.estimators.smoothing import (
    LIMITS,
    SHARED,
    Choice,
    SmootherSolver,
    SmootherState,
    Trajectory,
)
from vsalog.estimators.transmission_torque import carried_by
from vsalog.estimators.tuning import Tuning
from vsalog.estimators.window_error import Driven, exact_window, reading_window
from vsalog.estimators.windows import rms
from vsalog.filters.conditioning import Conditioned, Conditioner
from vsalog.filters.kinematic import kinematic_filter
from vsalog.filters.savitzky_golay import savgol_filter, savgol_weights
from vsalog.rig.tolerance import default_deviation
from vsalog.uncertainty.errors_in_variables import MOST_NOISE
from vsalog.uncertainty.long_run import BOX
from vsalog.uncertainty.sensor_error import ENOUGH, sensor_error

Array = NDArray[np.float64]

NAME = "smoother"
SUMMARY = (
    "all equations that the roles allow, a stiffness that may change, from the whole log (Kalman, Rauch–Tung–Striebel)"
)


# The torque on the link, and the tolerance of the gain of each equation's torque.
PUSH = "external_torque"
GAINS = {"torque_sensor": "torque_sensor.gain", "motor_torque": "motor.torque_gain", PUSH: "external_torque.gain"}


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


class SmootherFold(RegressionFold):
    """The least-squares fold, of which the second pass evaluates what was smoothed."""

    follows_changes: ClassVar[bool] = True
    equations: tuple[CombinedEquation, ...]
    solver: SmootherSolver

    def __init__(
        self, device: Device, conditioner: Conditioner, equations: tuple[CombinedEquation, ...], solver: SmootherSolver,
        look: Screening, tuning: SmootherTuning, noise: tuple[float, float],
    ) -> None:  # fmt: skip
        super().__init__(NAME, "COMBINED", device, conditioner, equations, solver, passes=2, look=look)
        # Variances of a deflection behind the centred filters, and behind the causal one where their window is not complete.
        self.tuning, self.noise = tuning, noise
        self.choices: tuple[Choice | None, ...] = ()
        self.rig_basis = device.basis

    def _solve(
        self, state: FoldState, equation: Equation, solver_state: Any, rows: EquationRows, block: Conditioned
    ) -> tuple[Any, dict[str, dict[str, Any]], Array]:
        assert isinstance(equation, CombinedEquation)
        if solver_state.trajectory is not None:
            rows = self._with_others(equation, rows, solver_state.trajectory)
        solver_state, columns, variance = super()._solve(state, equation, solver_state, rows, block)
        for i, view in enumerate(equation.transmissions):
            own = columns[view.name]
            if solver_state.trajectory is not None and (
                yielding := self._yielding(equation, solver_state.trajectory, i)
            ):
                strains = rows.parts[0].columns[:, equation.coefficients :]
                own["flexibility_torque_fit"] = own["flexibility_torque_fit"] + sum(
                    stiffness * strains[:, j] for j, stiffness in yielding.items()
                )
            # A stiffness is that of the deflection which is read.
            noise = np.where(np.isfinite(deflection_of(block.fit, view)), *self.noise)
            more = np.square(own["stiffness_derivative"]) * noise
            if self.device.basis.knots:
                more = more + self._between_knots(own)
            if solver_state.trajectory is not None:
                more = more + self._near_corners(own, noise, solver_state.trajectory)
            own["stiffness_std"] = np.hypot(own["stiffness_std"], np.sqrt(more))
            variance = variance + more
        return solver_state, columns, variance

    def _with_others(self, equation: CombinedEquation, rows: EquationRows, trajectory: Trajectory) -> EquationRows:
        """Return rows of the torque that is left for the springs by the first equation's other unknowns, as they were found.

        An offset stays: it follows no motion, and the trace's residual shows it.
        """
        names = equation.unknowns[0]
        found = {
            name: value
            for (part, name), (value, _) in trajectory.others.items()
            if not part and name in names and name != "offset" and (part, name) not in self.solver.leading
        }
        gain = 1.0 + found.pop(GAIN, 0.0)
        columns = rows.parts[0].columns[:, -1 - len(names) : -1]
        others = columns @ np.array([found.get(name, 0.0) for name in names])
        plain = None if rows.plain is None else (rows.plain[0], rows.plain[1] + others)
        fed = {name: (own - others) / gain for name, own in rows.fed.items()}
        return replace(rows, y=(rows.y - others) / gain, fed=fed, plain=plain)

    def _yielding(self, equation: CombinedEquation, trajectory: Trajectory, transmission: int) -> dict[int, float]:
        """Return the stiffness of each friction element of a transmission, by its number among all; none that were not needed."""
        count = len(equation.elements)
        first = transmission * count
        found = {j: trajectory.others.get((j, SHARED)) for j in range(first, first + count)}
        return {j: own[0] for j, own in found.items() if own is not None}

    def _usual_stiffness(self, equation: Equation, solver_state: Any, transmission: int) -> float:
        """Return the secant stiffness at the largest deflection, on average, without the set-point's part."""
        found, basis = solver_state.trajectory, self.device.basis
        if found is None or basis.has_setpoint or basis.branches:
            return 0.0
        F = basis.rows(np.array([basis.deflection_scale]), None, 0)[0, 0]
        first = equation.leading + transmission * basis.size
        return abs(float(F @ found.mean.mean(axis=0)[first : first + basis.size])) / basis.deflection_scale

    def _between_knots(self, columns: Mapping[str, Any]) -> Array:
        """Return the variance of the stiffness due to the unknown position of its change between two knots, shape (N,).

        A spline's stiffness is a line from knot to knot. If it jumps by Δ in between, at a uniformly distributed position, then
        at a part p of the way it has jumped with probability p: the mean is that line, the variance p (1 − p) Δ².
        """
        basis = self.device.basis
        apart = basis.deflection_scale / basis.knots
        place = np.abs(columns["deflection"]) / apart
        p = place - np.floor(place)
        change = columns["stiffness_derivative"] * apart
        return np.asarray(np.where(place < basis.knots, p * (1.0 - p), 0.0) * change**2)

    def _near_corners(self, columns: Mapping[str, Any], noise: Array, trajectory: Trajectory) -> Array:
        """Return the variance of the stiffness due to the unknown side of a corner on which a deflection is, shape (N,).

        If that is the other one, with probability p, the stiffness is off by the jump Δ at the corner: on average by p Δ².
        """
        variance = np.zeros(len(columns["deflection"]))
        for corner in self._corners(trajectory):
            away = np.abs(columns["deflection"] - corner.place)
            with np.errstate(divide="ignore", invalid="ignore"):
                other: Array = np.asarray(ndtr(-away / np.hypot(corner.std, np.sqrt(noise))))
            variance += np.where(away >= 0.0, other, 0.0) * corner.jump**2
        return variance

    def _corners(self, trajectory: Trajectory) -> list[Corner]:
        """Return the corners that were found, as a spring has them on average, if all equations show them."""
        basis, scale = self.device.basis, self.device.basis.deflection_scale
        own = basis.corners[len(self.rig_basis.corners) :]
        if not own:
            return []
        first = trajectory.mean.shape[1] - basis.size + basis.shapes - len(own)
        mean, roots = trajectory.mean.mean(axis=0) / scale, trajectory.root / scale
        found = []
        for i in range(0, len(own), 2):
            pair = slice(first + i, first + i + 2)
            covariance = np.einsum("kij,kil->jl", roots[:, :, pair], roots[:, :, pair]) / len(roots)
            found.append(Corner.between(own[i], own[i + 1], mean[pair], covariance))
        return [one for one in found if one.shown]

    @property
    def derived(self) -> dict[str, float]:
        """What was derived from the log; there is no p0."""
        return {name: value for name, value in super().derived.items() if name != "p0"}

    def rebuilt(self, signals: JointSignals) -> SmootherFold:
        """Return the fold for other signals of the same joint, with the functions and what was chosen of this one."""
        fold = build(self.device, signals, msgspec.structs.replace(self.tuning, basis="rig"))
        own = self.equations[0]
        fold = fold.with_shape(own.basis, own.elements, own.wait)
        if fold.solver.unknowns == self.solver.unknowns:
            fold.choices = tuple(None if choice is None else choice._replace(noise=()) for choice in self.choices)
        return fold

    def settled(self, state: FoldState) -> SmootherFold:
        """Return the same fold, which takes what was chosen from the log."""
        fold = copy(self)
        fold.choices = tuple(None if own.trajectory is None else own.trajectory.choice for own in state.solvers)
        return fold

    def with_shape(
        self, basis: PolynomialBasis, elements: tuple[Element, ...], wait: Element | None = None
    ) -> SmootherFold:
        """Return the same fold with other functions and friction elements, as a `CombinedEquation` has them."""
        fold, count = copy(self), self.solver.transmissions
        fold.device = replace(self.device, basis=basis)
        if isinstance(before := self.conditioner.before, Functions):
            fold.conditioner = self.conditioner.behind(replace(before, basis=basis))
        fold.equations = tuple(replace(own.with_basis(basis), elements=elements, wait=wait) for own in self.equations)
        fold.solver = replace(
            self.solver,
            powers=basis.powers_of_terms * count,
            pieces=basis.pieces * count,
            slips=tuple(own.slip for own in elements) * count,
        )
        return fold

    def collected(self, blocks: Iterable[Conditioned]) -> list[SmootherState]:
        """Return what the solvers collect from blocks, without an estimate of any."""
        state = self.start()
        for block in blocks:
            directed = self._with_branches(state, block)
            for i, equation in enumerate(self.equations):
                state.equations[i], rows = equation.rows(state.equations[i], directed)
                state.solvers[i] = self.solver.collected(state.solvers[i], rows)
        return state.solvers

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
        """Return what the first equation's residual follows; `findings` reports from the trajectories whether it is noise."""
        assert isinstance(equation, CombinedEquation)
        # A motor's equation has speed and acceleration among its unknowns; the residual of a loop correlates with the speed.
        suspects = () if equation.elements else SUSPECTS if equation.sensor is not None else (POSITION,)
        found = followers(rows, claimed, step, suspects)
        part = " and ".join(view.name for view in equation.transmissions)
        return [following(self.device.joint, part, found, equation.motor, claimed)] if found else []

    def _shapes(self, state: FoldState) -> list[Finding]:
        """Return what the log shows of the springs' shapes that the rig's basis has not."""
        found: list[Finding] = []
        basis = self.device.basis
        choices = [own.trajectory.choice for own in state.solvers if own.trajectory is not None]
        shown = any(choice.probability_of_polynomial < FALSE_ALARM for choice in choices)
        if basis.knots > self.rig_basis.knots and shown:
            found.append(
                Finding(
                    code="spring.not_polynomial",
                    joint=self.device.joint,
                    severity="info",
                    evidence={"knots": basis.knots},
                )
            )
        corners = [one for own in state.solvers if own.trajectory is not None for one in self._corners(own.trajectory)]
        known = ", ".join(f"{one.place:.4g}" for one in corners)
        found += [
            Finding(
                code="spring.corner", joint=self.device.joint, part=self.device.transmissions[0].name, severity="info",
                value=one.jump, unit="N*m/rad",
                evidence={"deflection": one.place, "deflection_std": one.std, "corners": known},
            )
            for one in corners
        ]  # fmt: skip
        if basis.bumps > self.rig_basis.bumps:
            pieces = len(basis.setpoint_knots) - 1
            found.append(
                Finding(
                    code="spring.setpoint_not_polynomial", joint=self.device.joint, severity="info", evidence={"pieces": pieces},
                )
            )  # fmt: skip
        for equation, own in zip(self.equations, state.solvers, strict=True):
            if own.trajectory is None:
                continue
            for i, view in enumerate(equation.transmissions):
                if not (yielding := self._yielding(equation, own.trajectory, i)):
                    continue
                # When all elements slip, each resists with its stiffness times the deflection at which it slips.
                level = sum(value * equation.elements[j % len(equation.elements)].slip for j, value in yielding.items())
                loops = loops_among(equation.elements, own.trajectory.stiffnesses, own.trajectory.covariance)
                found.append(
                    Finding(
                        code="spring.loop", joint=self.device.joint, part=view.name, severity="info", value=float(level),
                        unit="N*m",
                    )
                )  # fmt: skip
                found += [
                    Finding(
                        code="spring.slip", joint=self.device.joint, part=view.name, severity="info", value=loop.torque,
                        unit="N*m", evidence={"stiffness": loop.stiffness, "stiffness_std": loop.stiffness_std},
                    )
                    for loop in loops
                    if loop.is_sudden
                ]  # fmt: skip
                found += [
                    Finding(
                        code="spring.bouc_wen", joint=self.device.joint, part=view.name, severity="info", value=loop.torque,
                        unit="N*m",
                        evidence={
                            "width": form.width, "width_std": form.width_std, "exponent": form.exponent, "least": form.least,
                            "most": form.most, "shape": form.shape, "shape_std": form.shape_std,
                        },
                    )
                    for loop in loops
                    if not loop.is_sudden
                    for form in [loop.form]
                ]  # fmt: skip
        return found

    def _changes(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return by how much transmissions changed, where the log shows that they did and the bands of two times are apart."""
        if trajectory.choice.probability_of_no_change > FALSE_ALARM:
            return []
        jumps = len(trajectory.choice.change.jumps)
        found = []
        least = two_sided(FALSE_ALARM / len(trajectory.torque))
        for i, view in enumerate(equation.transmissions):
            torque, band = trajectory.torque[:, i], least * trajectory.torque_std[:, i]
            if np.max(torque - band) <= np.min(torque + band):
                continue
            whole, *ends = np.array((torque[-1], np.min(torque), np.max(torque))) / torque[0] - 1.0
            # No spring vanishes or doubles, or breaks as often as the search allows.
            odd = jumps == LIMITS.jumps or abs(whole) > LIMITS.fastest
            found.append(
                Finding(
                    code="stiffness.changed", joint=self.device.joint, part=view.name, severity="warning" if odd else "info",
                    value=float(whole), evidence={"least": float(ends[0]), "most": float(ends[1]), "jumps": jumps},
                )
            )  # fmt: skip
        return found

    def _inertias(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return where the inertia of a motor or of the link is another than the rig's."""
        found = []
        for i, (torque, part) in enumerate(equation.parts):
            off, std = trajectory.others.get((i, "inertia"), (0.0, 0.0))
            rig = equation.inertia_of(torque, part)
            if rig is not None and abs(off) > (limit := max(REPORTED_CHANGE * rig, DETECTED * std)):
                link = torque == "external_torque"
                found.append(
                    Finding(
                        code="link.inertia_differs" if link else "motor.inertia_differs", joint=self.device.joint,
                        part="" if link else part, value=off, limit=limit, unit="kg*m^2",
                        evidence={"inertia": rig + off, "rig": rig, "ratio": 1.0 + off / rig},
                    )
                )  # fmt: skip
        return found

    def _gains(self, equation: CombinedEquation, trajectory: Trajectory) -> list[Finding]:
        """Return the torques whose gain differs from that of the other equations."""
        found = []
        for i, (torque, part) in enumerate(equation.parts):
            off, std = trajectory.others.get((i, GAIN), (0.0, 0.0))
            if abs(off) > (limit := max(REPORTED_CHANGE, DETECTED * std)):
                found.append(
                    Finding(
                        code="torque.gain_differs", joint=self.device.joint, part=part, value=1.0 + off,
                        limit=1.0 + float(np.copysign(limit, off)), evidence={"signal": torque, "std": std},
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
    if _has_link(device, offered):
        found += [
            *(r for view in device.transmissions for r in deflection_roles(device, view, offered)),
            "link_position",
            PUSH,
        ]
    if not found:
        assert refused is not None
        raise refused
    require(NAME, device, found, offered)
    return tuple(dict.fromkeys(found))


def build(device: Device, signals: JointSignals, tuning: SmootherTuning) -> SmootherFold:
    """Assemble the estimator for a joint's signals, with more functions than the rig's basis has where the log needs them."""
    views, offered = device.transmissions, signals.roles
    sensed = all(sensor_role(view, offered) in offered for view in views)
    motors = all({view.motor_position, view.motor_torque} <= set(offered) for view in views)
    # A torque that never changes has no noise that could weigh it against the sensor's: with a gain of zero it fits anything.
    motors = motors and not (sensed and any(_is_constant(signals.roles[view.motor_torque]) for view in views))
    look, asked = screened(device, signals, tuning), tuning
    needed = roles(device, offered, tuning)
    tuning = exact_window(device, signals, tuning, partial(_driven, device, offered, sensed, motors))
    near = reading_window(device, signals, tuning)
    rates = ("link_position",) if _has_link(device, offered) else ()
    conditioner = conditioner_of(device, signals, tuning, needed, motor=motors, rates=rates, exact=True, near=near)
    if conditioner.kind != "kinematic":
        noises = tuple(_noise_before(signals, view, conditioner.window) for view in views)
        conditioner = conditioner.behind(Functions(views, device.basis, noises, conditioner.before))
    sensors = sensor_equations(device, signals, tuning, conditioner) if sensed else ()
    known = all(view.motor.reflected_inertia is not None for view in views)
    box = max(conditioner.window // BOXES.per_window, BOX)
    # Noise that is most of what a motor's equation has of the spring would bias what the sensor's shows.
    noise_share = (
        max(_noise_beside_motion(signals, view, conditioner, box) for view in views) if motors and not known else 0.0
    )
    motors = motors and not (sensed and noise_share > MOST_NOISE)
    driven = integrated_equations(device, signals, tuning, conditioner) if motors else ()
    driven = tuple(replace(own, exact=conditioner.exact) for own in driven)
    pushed = _pushed(device, signals, tuning, conditioner, sensed=sensed and len(sensors) > 1)
    # One sensor for several transmissions ties them together, and so does their link.
    together = [views] if len(sensors) == 1 or pushed else [(view,) for view in views]
    equations = [
        CombinedEquation(
            own,
            device.basis,
            sensors[i] if sensors else None,
            driven if len(together) == 1 else driven[i : i + 1],
            pushed,
            known,
            slack=slack_of(own[0], signals, tuning),
            reach=tuple(_reach(device, signals, view) for view in own),
        )
        for i, own in enumerate(together)
    ]
    first, count = equations[0], len(together[0])
    read = 0.0
    if conditioner.kind != "kinematic":
        seen = conditioner.weights if conditioner.near is None else conditioner.near[0]
        read = max(noise_behind_filters(signals, view, seen[0]).own for view in views)
    late = read + max(_causal_noise(signals, view, conditioner, tuning) for view in views)
    solver = SmootherSolver(
        device.basis.powers_of_terms * count,
        device.basis.pieces * count,
        count,
        first.unknowns,
        tuple(_required(torque, known, device) for torque, _ in first.parts),
        tuple(_hidden(torque, first, signals, conditioner, box, noise_share) for torque, _ in first.parts),
        tuple(default_deviation(GAINS[torque], 1.0, 1.0) for torque, _ in first.parts),
        box,
        leading=tuple((int(sensed), name) for name in UNKNOWN_MOTOR) if first.leading else (),
        causal=tuning.causal,
        constant=_has_a_setpoint_per_run(signals),
    )
    noise = (late if conditioner.kind == "kinematic" else read, late)
    plain = SmootherFold(device, conditioner, tuple(equations), solver, look, asked, noise)
    if tuning.basis == "rig" or tuning.causal:
        return plain
    return plain.with_shape(*ShapeSearch(plain, signals).found)


def _driven(
    device: Device, offered: Collection[str], sensed: bool, motors: bool, view: TransmissionView
) -> list[Driven]:
    """Return the equations of a transmission whose unknowns noise may hide."""
    found, sensor = [], sensor_role(view, offered)
    if sensed:
        found.append(Driven(sensor))
    if motors:
        motor = view.motor
        own = Driven(view.motor_torque, view.motor_position, motor.reflected_inertia, motor.reflected_damping or 0.0)
        found.append(own._replace(transmitted=sensor) if sensed and sensor == view.torque_sensor else own)
    if _has_link(device, offered):
        assert device.link is not None
        found.append(Driven(PUSH, "link_position", carried_by(device.link)[0], device.link.damping))
    return found


def _pushed(
    device: Device, signals: JointSignals, tuning: SmootherTuning, conditioner: Conditioner, *, sensed: bool
) -> LinkEquation | None:
    """Return the link's equation where the rig has the link and what pushes it is recorded; none next to several sensors."""
    if sensed or not _has_link(device, signals.roles):
        return None
    assert device.link is not None
    known = [known_of(device, view, signals, tuning, PUSH, motor=False) for view in device.transmissions]
    pushed = TorqueEquation(
        device.transmissions, device.basis, lambda block: block.fit[PUSH], tuple(k for k in known if k is not None)
    )
    inertia, weight = carried_by(device.link)
    return LinkEquation(pushed, inertia, device.link.damping, weight, signals.period, conditioner.exact)


def _noise_before(signals: JointSignals, view: TransmissionView, window: int) -> float:
    """Return the variance of a deflection's noise before filters of a window [rad²]."""
    roles = (signals.roles[role][:ENOUGH] for role in view.deflection_roles(signals.roles))
    return sum(sensor_error(own, window).rms(np.ones(1)) ** 2 for own in roles)


def _reach(device: Device, signals: JointSignals, view: TransmissionView) -> float:
    """Return the largest deflection of a transmission, in that of the largest [1]; one where it never moves."""
    largest = float(np.nanmax(np.abs(deflection_of(signals.roles, view)), initial=0.0))
    return min(largest / device.basis.deflection_scale, 1.0) or 1.0


def _has_a_setpoint_per_run(signals: JointSignals) -> bool:
    """Return whether runs differ in the set-point, which is constant in each: a spring that changes looks the same."""
    if "setpoint" not in signals.roles:
        return False
    by_run = [signals.roles["setpoint"][signals.run == run] for run in np.unique(signals.run)]
    return len(by_run) > 1 and all(np.ptp(own) == 0.0 for own in by_run)


def _is_constant(values: Array) -> bool:
    return bool(np.nanmax(values, initial=-np.inf) <= np.nanmin(values, initial=np.inf))


def _has_link(device: Device, offered: Collection[str]) -> bool:
    return device.link is not None and {PUSH, "link_position"} <= set(offered)


def _causal_noise(
    signals: JointSignals, view: TransmissionView, conditioner: Conditioner, tuning: SmootherTuning
) -> float:
    """Return the variance of a deflection behind the causal filter [rad²], as it differs from what a centred window shows."""
    near = savgol_weights(tuning.default_window, tuning.degree) if conditioner.near is None else conditioner.near[0]
    weights = near[0]
    off = {}
    for role in view.deflection_roles(signals.roles):
        raw = signals.roles[role][:ENOUGH]
        smooth = savgol_filter(raw, weights[None])[0]
        late = kinematic_filter(raw, signals.period, conditioner.settings[role])[0]
        off[role] = late[weights.size // 2 :][: smooth.size] - smooth
    error = deflection_of(off, view)
    known = np.abs(error[np.isfinite(error)])
    # By the median: what a filter does where a run begins is no noise.
    return (float(np.median(known)) / two_sided(0.5)) ** 2 if known.size else 0.0


def _required(torque: str, known: bool, device: Device) -> frozenset[str]:
    """Return the unknowns of an equation that are always estimated: unknown to the rig, or dry friction of the link."""
    if torque == "motor_torque" and not known:
        return frozenset(UNKNOWN_MOTOR[1:])
    rubs = torque == PUSH and device.link is not None and device.link.friction.coulomb > 0.0
    return frozenset(("friction",)) if rubs else frozenset()


def _hidden(
    torque: str,
    equation: CombinedEquation,
    signals: JointSignals,
    conditioner: Conditioner,
    box: int,
    noise_share: float,
) -> frozenset[str]:
    """Return the unknowns of an equation that cannot be identified; `noise_share` as of `_noise_beside_motion`."""
    # A gain is relative to the other equations'. Which of two is wrong only a known inertia tells; else it is the motor's.
    alone = len({torque for torque, _ in equation.parts}) == 1
    if torque == "torque_sensor":
        return frozenset((GAIN,)) if alone or not equation.known else frozenset()
    hidden = {GAIN} if alone else set[str]()
    # Noise of a regressor makes its coefficient smaller by its share of the power, which is not to be reported as a change.
    moved = ["link_position"] if torque == PUSH else [view.motor_position for view in equation.transmissions]
    if max(_noise_of_acceleration(signals.roles[role], conditioner, box) for role in moved) > REPORTED_CHANGE:
        hidden |= {"inertia", GAIN}
    if torque != PUSH and noise_share > REPORTED_CHANGE:
        hidden |= {GAIN}
    return frozenset(hidden)


def _noise_of_acceleration(position: Array, conditioner: Conditioner, box: int) -> float:
    """Return which part of the power of an acceleration, averaged over boxes, is noise, at most."""
    if conditioner.kind == "kinematic":
        return 1.0
    # The average of an acceleration is a difference of speeds.
    speed, position = conditioner.weights[1], position[:ENOUGH]
    weights = np.concatenate((speed, np.zeros(box))) - np.concatenate((np.zeros(box), speed))
    moved = rms(savgol_filter(position, weights[None])[0])
    return min(sensor_error(position, weights.size).rms(weights) ** 2 / moved**2, 1.0) if moved else 1.0


def _noise_beside_motion(signals: JointSignals, view: TransmissionView, conditioner: Conditioner, box: int) -> float:
    """Return which part of a deflection's power that the motor's speed and acceleration do not explain is noise, at most.

    A stiff spring moves the link with the motor: its torque is nearly proportional to the acceleration.
    """
    if conditioner.kind == "kinematic":
        return 0.0
    roles = {
        role: signals.roles[role][:ENOUGH] for role in (*view.deflection_roles(signals.roles), view.motor_position)
    }
    weights = np.stack([np.convolve(own, np.full(box, 1.0 / box)) for own in conditioner.weights])
    phi = savgol_filter(deflection_of(roles, view), weights[:1])[0]
    moved = savgol_filter(roles[view.motor_position], weights)[1:].T
    known = np.isfinite(phi) & np.isfinite(moved).all(axis=1)
    columns = np.column_stack((np.ones(np.count_nonzero(known)), moved[known]))
    left = rms(phi[known] - columns @ np.linalg.lstsq(columns, phi[known], rcond=None)[0])
    noise = sum(
        sensor_error(roles[role], weights.shape[1]).rms(weights[0]) ** 2 for role in view.deflection_roles(roles)
    )
    return min(noise / left**2, 1.0) if left else 1.0
