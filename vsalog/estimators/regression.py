"""The fold that the least-squares estimators share: filter, form equations, solve recursively, evaluate the stiffness.

Methods differ in their equation (terms and their sum) and their solver; the fold connects them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.model import JointModel, TransmissionModel, basis_spec
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.device import Device, deflection_of
from vsalog.estimators.equation import (
    MOST_OF_LOG,
    NEGLIGIBLE_SHARE,
    SUPPORTED_SHARE,
    Equation,
    EquationRows,
    Solver,
)
from vsalog.estimators.equations import regressors
from vsalog.estimators.fold_state import FoldState
from vsalog.estimators.region import Region, lengths
from vsalog.estimators.residual_motion import MotionRows, motion_rows_block, motion_rows_start, residual_findings
from vsalog.estimators.screening import NOTHING_FOUND, Screening
from vsalog.estimators.tuning import Tuning
from vsalog.filters.conditioning import Conditioned, Conditioner, ConditionerState
from vsalog.filters.direction import direction_start, loading_block

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Windows of the filter after which a deflection counts as covered [1]: its noise lasts as long as one.
WINDOWS_UNTIL_COVERED = 2


class RegressionFold:
    """An estimator: a fold over blocks of signals.

    Attributes
    ----------
    passes : how often the signals are gone through: once, or twice when nothing is given out before all is known
    chosen : tuning that was derived from the log in addition to that of the filters and the solver
    look : findings about the log before the first sample
    fits_torque : whether it is torques that it fits, so that their residual shows something
    delay : samples after which data count for `excited`; `memory`, an equation's own, may be longer than the filters'
    """

    fits_torque: ClassVar[bool] = True

    def __init__(
        self,
        name: str,
        modality: str,
        device: Device,
        conditioner: Conditioner,
        equations: tuple[Equation, ...],
        solver: Solver,
        *,
        passes: int = 1,
        chosen: Mapping[str, float] = MappingProxyType({}),
        look: Screening = NOTHING_FOUND,
        memory: int = 0,
    ) -> None:
        self.name, self.modality, self.device, self.conditioner = name, modality, device, conditioner
        self.equations, self.solver, self.passes = equations, solver, passes
        self.chosen, self.look = chosen, look
        self.delay = WINDOWS_UNTIL_COVERED * max(conditioner.window, memory)

    @property
    def derived(self) -> dict[str, float]:
        """Parameters derived from the log where the tuning left them open."""
        filters = self.conditioner
        window = {} if filters.kind == "kinematic" else {"window": (filters.window - 1) * filters.period}
        return {"p0": self.solver.p0, "settle": filters.settle * filters.period, **window, **self.chosen}

    def start(self) -> FoldState:
        """Return the state before the first sample."""
        return FoldState(
            self.conditioner.start(),
            [e.start() for e in self.equations],
            [self.solver.start(e.size) for e in self.equations],
            {t.name: Region.behind(self.delay) for t in self.device.transmissions},
            {},
            True,
        )

    def freeze(self, state: FoldState) -> FoldState:
        """Go back to the first sample with the result, which no longer changes."""
        return replace(
            self.start(),
            solvers=state.solvers,
            regions={name: region.whole() for name, region in state.regions.items()},
            learning=False,
        )

    def step(self, state: FoldState, block: JointSignals) -> tuple[FoldState, list[Trace]]:
        """Take a block of samples; give the new state and the trace of the rows that are ready."""
        filters, ready = self.conditioner.step(state.filters, block)
        return self._estimate(state, filters, ready)

    def finish(self, state: FoldState) -> tuple[FoldState, list[Trace]]:
        """Give out the rows a look-ahead still holds back."""
        filters, ready = self.conditioner.finish(state.filters)
        return self._estimate(state, filters, ready)

    def _estimate(
        self, state: FoldState, filters: ConditionerState, ready: list[Conditioned]
    ) -> tuple[FoldState, list[Trace]]:
        new = FoldState(
            filters,
            list(state.equations),
            list(state.solvers),
            dict(state.regions),
            dict(state.directions),
            state.learning,
            state.seen,
            dict(state.doubted),
            dict(state.supported),
            dict(state.claimed),
            dict(state.residual_rows),
        )
        traces = []
        for block in (rows for rows in ready if len(rows.rows)):
            block = self._with_branches(new, block)
            new.seen += len(block.rows)
            columns: dict[str, dict[str, Any]] = {}
            variance = np.zeros(len(block.rows))
            for i, equation in enumerate(self.equations):
                new.equations[i], rows = equation.rows(new.equations[i], block)
                new.solvers[i], part, spread = self._solve(new, equation, new.solvers[i], rows, block)
                columns.update(part)
                variance += spread
                if rows.doubted is not None:
                    names = " and ".join(t.name for t in equation.transmissions)
                    new.doubted[names] = new.doubted.get(names, 0) + int(np.count_nonzero(rows.doubted))
            columns["total"] = _total(columns, variance, self.device)
            if "total" in rows.fed:
                columns["total"]["flexibility_torque"] = self._fed(rows.fed["total"])
            traces.append(Trace.of_rows(block.rows, columns))
        return new, traces

    def _with_branches(self, state: FoldState, block: Conditioned) -> Conditioned:
        """Add, where the basis has branches, which one each sample is on."""
        if not self.device.basis.branches:
            return block
        if block.rows.starts[0]:
            state.directions.clear()
        flags: list[dict[str, Flags]] = []
        for kind, values in (("fit", block.fit), ("now", block.now)):
            flags.append({})
            for view in self.device.transmissions:
                key = f"{kind}:{view.name}"
                state.directions[key], flags[-1][view.name] = loading_block(
                    state.directions.get(key, direction_start()),
                    deflection_of(values, view),
                    NEGLIGIBLE_SHARE * self.device.basis.deflection_scale,
                )
        return replace(block, loading_fit=flags[0], loading_now=flags[1])

    def _solve(
        self, state: FoldState, equation: Equation, solver_state: Any, rows: EquationRows, block: Conditioned
    ) -> tuple[Any, dict[str, dict[str, Any]], Array]:
        E, spread, where = self._functionals(equation, rows, block)
        use = rows.use & state.learning
        # The sum of several transmissions' stiffnesses has a functional of its own: correlation is not lost.
        summed = 4 * len(where) if len(where) > 1 else 1
        solver_state, values, variances, unknowns, extra = self.solver.block(solver_state, rows, use, E, spread)
        # The residual is that of the last pass, in which all unknowns are known.
        if rows.motion is not None and state.learning == (self.passes == 1):
            names = tuple(view.name for view in equation.transmissions)
            F, y = (rows.F, rows.y) if rows.plain is None else rows.plain
            state.residual_rows[names] = motion_rows_block(
                state.residual_rows.get(names, motion_rows_start(equation.size)),
                F, E[:, summed], y, rows.motion, rows.use, block.rows.starts, self.conditioner.window, block.rows.period,
            )  # fmt: skip
        deviations = np.sqrt(variances)
        columns: dict[str, dict[str, Any]] = {}
        for i, view in enumerate(equation.transmissions):
            phi, c = where[i]
            fitted, sigma, d1, d2 = (values[:, 4 * i + s] for s in range(4))
            std = deviations[:, 4 * i + 1]
            phi_fit, c_fit = deflection_of(block.fit, view), block.fit.get("setpoint")
            if self.conditioner.exact:
                # Functions were formed before the filter, which may attenuate a deflection; the torque comes out of the filter.
                phi_fit, c_fit = phi, c
                first = equation.leading + i * self.device.basis.size
                behind = (
                    regressors(self.device.basis, block, view) * unknowns[:, first : first + self.device.basis.size]
                )
                fitted = np.where(np.isfinite(total := behind.sum(axis=1)), total, fitted)
            state.regions[view.name], seen = state.regions[view.name].block(phi_fit, c_fit, use, phi, c)
            with np.errstate(invalid="ignore"):
                supported = (std < SUPPORTED_SHARE * sigma) & (view.name not in self.look.blind)
            # A row whose deflection is not known says neither that the model is known there nor that it is not.
            length, known = np.zeros(std.size, dtype=np.int64), np.isfinite(std)
            # That a spring has no stiffness, as in a backlash, is knowledge, too.
            usual = self._usual_stiffness(equation, solver_state, i)
            with np.errstate(invalid="ignore"):
                certain = supported | (std < SUPPORTED_SHARE * usual)
            length[known] = lengths(certain[known], state.supported.get(view.name, 0))
            if known.any():
                state.supported[view.name] = int(length[known][-1])
            # Even where a model is hardly known, a standard deviation may pass near zero for a moment.
            excited = seen & supported & (length >= max(self.conditioner.window, Tuning.default_window // 2))
            if excited.any():
                state.claimed[view.name] = float(
                    np.min((std / sigma)[excited], initial=state.claimed.get(view.name, np.inf))
                )
            columns[view.name] = {
                "deflection": phi,
                "flexibility_torque": self._fed(rows.fed[view.name]),
                "flexibility_torque_fit": fitted,
                "stiffness": sigma,
                "stiffness_std": std,
                "excited": excited,
                "stiffness_derivative": d1,
                "stiffness_second_derivative": d2,
                **({"setpoint": c} if c is not None else {}),
                **rows.extra.get(view.name, {}),
                **extra,
                **self._coefficients(equation, i, unknowns),
            }
            if "residual" in columns[view.name]:
                # The same fit behind the lag that the residual has, to be compared with it.
                columns[view.name]["residual_fit"] = (rows.F * unknowns).sum(axis=1)
        after = _before_parameters(len(equation.transmissions))
        if equation.parameters:  # the equation of a single transmission
            only = columns[equation.transmissions[0].name]
            only["flexibility_torque"] = self._fed(values[:, after] + rows.fed[equation.transmissions[0].name])
            for h, name in enumerate(equation.parameters):
                only[name] = values[:, after + 1 + h]
                only[f"{name}_std"] = deviations[:, after + 1 + h]
        return solver_state, columns, variances[:, summed]

    def _usual_stiffness(self, equation: Equation, solver_state: Any, transmission: int) -> float:
        """Return the stiffness that a transmission has at large, zero where it is estimated from the samples before alone."""
        return 0.0

    def _fed(self, torque: Array) -> Array:
        """The torque of a row; the pair of filters learns from one half a window old, which belongs to another row."""
        return np.full_like(torque, np.nan) if self.conditioner.kind == "pair" else torque

    def _functionals(
        self, equation: Equation, rows: EquationRows, block: Conditioned
    ) -> tuple[Array, Flags, list[tuple[Array, Array | None]]]:
        """The functionals of the unknowns: per transmission τ_e, σ, σ', σ''; Σσ of several; torque and parameters."""
        basis, count = self.device.basis, len(equation.transmissions)
        after = _before_parameters(count)
        size = after + (1 + len(equation.parameters) if equation.parameters else 0)
        E = np.zeros((len(block.rows), size, equation.size))
        spread = np.zeros(size, dtype=np.bool_)
        where = []
        for i, view in enumerate(equation.transmissions):
            phi = deflection_of(block.now, view)
            c = block.now.get("setpoint") if self.device.has_setpoint else None
            first = equation.leading + i * basis.size
            part = slice(first, first + basis.size)
            loading = block.loading_now.get(view.name)
            E[:, 4 * i : 4 * i + 4, part] = basis.rows(phi, c if basis.has_setpoint else None, 3, loading)
            spread[4 * i + 1] = True
            if count > 1:
                E[:, 4 * count, part] = E[:, 4 * i + 1, part]
                spread[4 * count] = True
            where.append((phi, c))
        if equation.parameters:
            E[:, after, : equation.leading] = rows.dynamics
            for h in range(len(equation.parameters)):
                E[:, after + 1 + h, equation.leading - len(equation.parameters) + h] = 1.0
                spread[after + 1 + h] = True
        return E, spread, where

    def _coefficients(self, equation: Equation, i: int, unknowns: Array) -> dict[str, Array]:
        first = equation.leading + i * self.device.basis.size
        return {f"coefficient_{h}": unknowns[:, first + h] for h in range(self.device.basis.size)}

    def findings(self, state: FoldState) -> tuple[Finding, ...]:
        """Return the first look's findings, where most of a log could not be used, and what the residual correlates with."""
        doubted = (
            Finding(
                code="friction.unknown_direction",
                joint=self.device.joint,
                part=names,
                severity="info",
                value=count / state.seen,
                limit=MOST_OF_LOG,
            )
            for names, count in state.doubted.items()
            if count > MOST_OF_LOG * state.seen
        )
        return (*self.look.findings, *doubted, *self._of_residual(state))

    def _of_residual(self, state: FoldState) -> list[Finding]:
        """Return what the residual correlates with."""
        found: list[Finding] = []
        for equation in self.equations:
            names = tuple(view.name for view in equation.transmissions)
            if names not in state.residual_rows:
                continue
            claimed = max(state.claimed.get(name, np.inf) for name in names)
            step = self.look.step(equation.transmissions)
            found += self._judged(equation, state.residual_rows[names], claimed, step)
        return found

    def _judged(self, equation: Equation, rows: MotionRows, claimed: float, step: float) -> list[Finding]:
        """Return what the residual of an equation shows; `claimed` and `step` as for `residual_motion.followers`."""
        return residual_findings(self.device.joint, equation, rows, claimed, step)

    def model(self, state: FoldState) -> JointModel:
        """Freeze the result into a model."""
        motor: dict[str, float] = {}
        parts: list[TransmissionModel] = []
        for equation, solver_state in zip(self.equations, state.solvers, strict=True):
            xi, covariance, noise = self.solver.solution(solver_state)
            size = self.device.basis.size
            if equation.leading:
                view = equation.transmissions[0]
                for h, quantity in ((1, "inertia"), (2, "damping")):
                    motor[f"{quantity}_{view.name}"] = float(xi[h])
                    motor[f"{quantity}_{view.name}_std"] = float(np.sqrt(covariance[h, h]))
            for i, view in enumerate(equation.transmissions):
                first = equation.leading + i * size
                part = slice(first, first + size)
                region = state.regions[view.name]
                parts.append(
                    TransmissionModel(
                        name=view.name,
                        coefficients=tuple(float(x) for x in xi[part]),
                        covariance=tuple(tuple(float(x) for x in row) for row in covariance[part, part]),
                        noise=noise,
                        samples=region.samples,
                        region=region.vertices(),
                    )
                )
        return JointModel(
            estimator=self.name,
            modality=self.modality,
            basis=basis_spec(self.device.basis),
            transmission=tuple(parts),
            motor=motor,
        )


def _before_parameters(transmissions: int) -> int:
    """Return how many functionals are of transmissions: four of each, and the sum of stiffnesses where there are several."""
    return 4 * transmissions + (transmissions > 1)


def _total(columns: Mapping[str, Mapping[str, Any]], variance: Array, device: Device) -> dict[str, Any]:
    """Device row: torques and stiffnesses add up over the transmissions (Flacco 2012 eq. 9–10)."""
    parts = [columns[t.name] for t in device.transmissions]
    total: dict[str, Any] = {
        "deflection": parts[0]["deflection"] if len(parts) == 1 else np.full(variance.shape, np.nan)
    }
    if device.has_setpoint:
        total["setpoint"] = parts[0]["setpoint"]
    for name in ("flexibility_torque", "flexibility_torque_fit", "stiffness"):
        total[name] = sum(p[name] for p in parts)
    for name in ("residual", "residual_fit"):
        if all(name in p for p in parts):
            total[name] = sum(p[name] for p in parts)
    total["stiffness_std"] = np.sqrt(variance)
    total["excited"] = np.logical_and.reduce([p["excited"] for p in parts])
    for name in ("stiffness_derivative", "stiffness_second_derivative"):
        total[name] = parts[0][name] if len(parts) == 1 else np.full(variance.shape, np.nan)
    return total
