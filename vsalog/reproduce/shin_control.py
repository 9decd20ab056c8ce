"""Shin 2021, Fig. 14: controllers of pneumatic muscles that read the pressures alone, on other machines than their model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from msgspec.structs import replace as with_fields
from numpy.typing import NDArray

from vsalog.core.live_estimator import Said
from vsalog.core.recording import Recording
from vsalog.estimation.live import LiveEstimate
from vsalog.estimators.methods.pam_ukf import OTHERS, PRESSURES, PamEstimate
from vsalog.estimators.pam_states import Column, PamFold
from vsalog.mechanics.pneumatics import joint_torque
from vsalog.reproduce.drawing import Panel, figure, over
from vsalog.reproduce.measure import Study
from vsalog.reproduce.rows import Result, Row, Spread
from vsalog.reproduce.shin_machines import MACHINES, STATED, machine
from vsalog.rig import Rig
from vsalog.rig.schema import PneumaticJoint, RigFile
from vsalog.simulation.control import PiControl
from vsalog.simulation.control_pi import COLUMNS
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.inputs import table
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Trials:
    """Chosen values, which no paper prints.

    Attributes
    ----------
    steady : how long before the next step an error counts as steady [s]
    seeds : how many machines are controlled with the paper's settings, five times as many samples, and with vsalog's
    period : of the controller with vsalog's settings [s]; the paper's has 1 ms
    """

    steady: float = 1.0
    seeds: tuple[int, int] = (1, 3)
    period: float = 5e-3


TRIALS = Trials()
PAPER = "Shin 2021"


@dataclass(frozen=True, slots=True)
class Task:
    """The controlled quantity of Fig. 14.

    Attributes
    ----------
    scenario : that has the paper's gains
    role : name of the truth
    title, unit, scale : in figures
    span : of the references, by which the error is divided
    printed : largest steady error by that [%]
    times, values : steps of the reference [s], in SI
    """

    scenario: str
    role: str
    title: str
    unit: str
    scale: float
    span: float
    printed: float
    times: tuple[float, ...]
    values: tuple[float, ...]


# The angle comes to rest in some 12 s under the paper's gains, the torque in a third of it.
TASKS = (
    Task("pam-angle-control", "link_position", "angle", "°", 180.0 / np.pi, np.radians(40.0), 5.25, (1.0, 15.0),
         (np.radians(20.0), np.radians(-20.0))),
    Task("pam-torque-control", "transmission_torque", "torque", "N·m", 1.0, 4.0, 5.0, (1.0, 6.0), (2.0, -2.0)),
)  # fmt: skip
END = {"pam-angle-control": 29.0, "pam-torque-control": 11.0}


@dataclass(frozen=True, slots=True)
class Controlled:
    """A run: shape (N,) each, in SI; `estimated` is the controller's feedback."""

    time: Array
    reference: Array
    actual: Array
    estimated: Array


class FilterAlone(LiveEstimate):
    """The filter in the loop, without the stiffness that `pam-ukf` also estimates: a controller does not read that."""

    def prepare(self, dry: Recording) -> None:
        """Build the filter for signals like those of a run without feedback."""
        super().prepare(dry)
        assert isinstance(self.fold, PamEstimate)
        self.filter, self.estimates = self.fold.fold.start(), list[dict[str, float]]()

    def take(self, k: int, readings: Said) -> dict[str, float]:
        """Return angle and torque after sample `k`."""
        fold: PamFold = self.fold.fold
        given = [
            np.array([readings[self.joint][r]]) if r in readings[self.joint] else None for r in (*PRESSURES, *OTHERS)
        ]
        self.filter, found = fold.block(self.filter, *given)  # type: ignore[arg-type]
        p1, p2, psi = (float(found.x[0, i]) for i in (Column.PRESSURE_1, Column.PRESSURE_2, Column.ANGLE))
        estimates = {"link_position": psi, "flexibility_torque": float(joint_torque(fold.joint, psi, p1, p2))}
        self.estimates.append(estimates)
        return estimates


def pressures_alone(study: Study) -> Result:
    """Shin 2021 §IV-C: the PI controller on the filter's angle, and on its torque; with Fig. 14."""
    rows, panels = [], []
    for task in TASKS:
        common = Row(
            item="shin-control", paper=PAPER, place="§IV-C, Fig. 14", quantity="largest steady error by its range",
            unit="%", of=task.title, estimator="pam-ukf", printed=task.printed, window=f"last {TRIALS.steady:g} s of each step",
            conditions="two pneumatic muscles under the paper's PI controller, which reads the pressures alone;"
            + (" the joint clamped at 0°" if task.role != "link_position" else " the joint free"),
            chosen="references: steps of 14 s (angle) and 5 s (torque) to either end of their range; T_I as a gain per second",
            remark=STATED,
        )  # fmt: skip
        printed, derived = (study.seeds[:count] for count in TRIALS.seeds)
        runs = [_run(study, task, seed, 1e-3, "printed") for seed in printed]
        others = [_run(study, task, seed, TRIALS.period, "derived") for seed in derived]
        rows += [
            common.with_values(
                settings=label, tune={"covariances": covariances}, differs=differs,
                ours=Spread.of([100.0 * steady_error(r.time, r.reference, r.actual) / task.span for r in found]),
            )
            for label, covariances, found, differs in (
                ("the paper's", "printed", runs, MACHINES),
                ("vsalog's default", "derived", others, f"{MACHINES}; samples of 5 ms, printed 1 ms; derived covariances"),
            )
        ]  # fmt: skip
        panels += _drawn(task, runs[0])
    conditions = "two pneumatic muscles under the paper's PI controller, samples of 1 ms, printed covariances"
    title = "PI control on the filter's angle and torque"
    return Result(rows, [figure(PAPER, 14, title, tuple(panels), conditions, f"{common.chosen}; {STATED}")])


def _drawn(task: Task, run: Controlled) -> list[Panel]:
    lines = {"estimated": run.estimated, "measured": run.actual, "reference": run.reference}
    unit = f"[{task.unit}]"
    return [
        over(run.time, lines, f"{task.title} {unit}", scale=task.scale),
        over(run.time, {"tracking error": run.reference - run.actual}, f"error {unit}", scale=task.scale),
    ]


def _run(study: Study, task: Task, seed: int, period: float, covariances: str) -> Controlled:
    """Control a machine that differs from the rig."""
    study.say(f"shin-control: {task.title}, {covariances} covariances, machine {seed}")
    rig = Rig.preset("pam").file
    joint = rig.joint["pam"]
    assert isinstance(joint, PneumaticJoint)
    if task.role != "link_position":
        joint = with_fields(joint, seesaw=with_fields(joint.seesaw, held_at=0.0))
    believed, actual = (with_fields(rig, joint={"pam": j}) for j in (joint, machine(joint, seed)))
    reference = table(np.array([0.0, *task.times]), np.array([0.0, *task.values]), held=True)
    asked = Scenario.load(task.scenario).controllers(believed)["pam"]
    assert isinstance(asked, PiControl)
    control = replace(asked, reference=reference, tune={"covariances": covariances})
    watchers: list[FilterAlone] = []

    def watcher(rig: RigFile, joint: str, name: str, tune: Mapping[str, str]) -> FilterAlone:
        watchers.append(FilterAlone(rig, joint, name, tune))
        return watchers[-1]

    simulated: Experiment = simulate(
        actual, {}, END[task.scenario], period=period, seed=seed, controllers={"pam": control}, believed=believed,
        estimator=watcher,
    )  # fmt: skip
    estimates = np.array([each[COLUMNS[control.of]] for each in watchers[0].estimates])
    estimated = np.append(estimates, estimates[-1])[: simulated.time.size]
    return Controlled(simulated.time, np.asarray(reference(simulated.time)), simulated.truth[task.role], estimated)


def steady_error(time: Array, reference: Array, truth: Array) -> float:
    """Return the largest error in the time before each step of the reference, and before the end."""
    steps = [*time[1:][np.diff(reference) != 0.0], time[-1]]
    late = np.any([(time < end) & (time >= end - TRIALS.steady) for end in steps], axis=0)
    return float(np.max(np.abs(reference - truth)[late]))
