"""De Luca, Schröder, Thümmel, ICRA 2007: what is said of the acceleration observer's errors. No number of them is printed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vsalog.reproduce.measure import Study, with_noise
from vsalog.reproduce.planned import Column, Planned, root_mean_square, row_of
from vsalog.reproduce.rows import Result, Row
from vsalog.rig import Rig
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]

PAPER = "De Luca 2007"
OBSERVER = Planned("the acceleration observer", ("acceleration-observer", "elastic-joint-observer", "deluca"))
RIG, SCENARIO, JOINT = "kuka-kr15", "kuka-kr15-exp1", "axis1"
CONDITIONS = (
    "an arm of the size of a KUKA KR15/2, its first axis, through the preset's motion; state over the whole run"
)
CHOSEN = "everything of the arm but the observer's frequency near 250 rad/s: preset and scenario kuka-kr15"


def observer(study: Study) -> Result:
    """§V: state errors of the observer on the first axis."""

    @cache
    def experiments() -> list[Experiment]:
        rig = Rig.preset(RIG).file
        scenario = Scenario.find(SCENARIO, rig)
        return with_noise(simulate(rig, scenario.inputs(rig), scenario.file.duration, ideal=True), study.seeds)

    common = Row(
        item="deluca2007",
        paper=PAPER,
        place="Figs. 3–4",
        quantity="",
        settings="the paper's",
        window="whole run",
        conditions=CONDITIONS,
        chosen=CHOSEN,
        compare="none",
    )
    rows = [
        row_of(
            common.with_values(quantity=f"rms error of the observed {what}", unit=unit, of="axis 1", printed=printed),
            OBSERVER,
            Column(column, _truth(column), root_mean_square),
            experiments,
            JOINT,
            study,
        )
        for what, unit, column, printed in (
            ("link position", "rad", "link_position", "barely visible beside the angle itself"),
            ("link velocity", "rad/s", "link_velocity", "small, with some peaks"),
            ("motor position", "rad", "motor_position", "very close, being measured"),
            ("motor velocity", "rad/s", "motor_velocity", "very close"),
        )
    ]
    return Result(rows, [])


def _truth(name: str) -> Callable[[Experiment, str], Array]:
    def truth(experiment: Experiment, joint: str) -> Array:
        return experiment.joints[joint].truth[name]

    return truth
