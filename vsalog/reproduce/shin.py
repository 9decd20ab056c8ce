"""Shin, Ibayashi, Kogiso, IEEE/ASME Trans. Mechatronics 2021, §V-A: offline errors of the model alone and of the UKF."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vsalog.reproduce.measure import Study, with_noise
from vsalog.reproduce.planned import Column, Planned, largest, root_mean_square, row_of
from vsalog.reproduce.rows import Result, Row
from vsalog.rig import Rig
from vsalog.simulation.experiment import Experiment
from vsalog.simulation.scenario import Scenario
from vsalog.simulation.simulate import simulate

Array = NDArray[np.float64]

PAPER = "Shin 2021"
# §V-A: RMSE, largest error and its share of the signal's range, of the angle [deg] and the torque [N·m].
MODEL_ALONE = {"angle": (1.053, 3.50, 8.87), "torque": (0.162, 0.494, 10.23)}
UKF = {"angle": (0.838, 2.42, 6.13), "torque": (0.108, 0.238, 4.94)}
UNITS = {"angle": ("°", "°", "%"), "torque": ("N·m", "N·m", "%")}
COLUMNS = {"angle": "link_position", "torque": "flexibility_torque"}
QUANTITIES = ("RMSE", "largest error", "largest error by the signal's range")

FILTER = Planned("the UKF", ("pam-ukf",))
CONDITIONS = "two pneumatic muscles, pressures of 200 to 700 kPa, offline"
RECORDINGS = (
    "needs the authors' recordings: the model's error is what the real muscles do and the model does not. In a simulation"
    " the model is the machine, and the error would be whatever one chose to make wrong"
)
SIMULATED = (
    "ours is on simulated signals (pam-exp1), where the model has no error of its own: not comparable with the printed"
    " number, which is on the authors' recordings"
)


def offline(study: Study) -> Result:
    """§V-A: angle and torque from the pressures, model alone against UKF."""

    @cache
    def experiments() -> list[Experiment]:
        rig = Rig.preset("pam").file
        scenario = Scenario.find("pam-exp1", rig)
        return with_noise(simulate(rig, scenario.inputs(rig), scenario.file.duration, ideal=True), study.seeds)

    rows: list[Row] = []
    for signal in ("angle", "torque"):
        scale = 180.0 / np.pi if signal == "angle" else 1.0
        for i, quantity in enumerate(QUANTITIES):
            common = Row(
                item="shin-offline",
                paper=PAPER,
                place="§V-A",
                quantity=f"{quantity} of the {signal}",
                unit=UNITS[signal][i],
                settings="the paper's",
                window="whole run",
                conditions=CONDITIONS,
                compare="none",
            )
            rows.append(
                common.with_values(
                    of="model alone", printed=MODEL_ALONE[signal][i], status="not there yet", reason=RECORDINGS
                )
            )
            rows.append(
                row_of(
                    common.with_values(of="UKF", printed=UKF[signal][i], remark=SIMULATED if FILTER.registered else ""),
                    FILTER,
                    Column(COLUMNS[signal], _truth(signal), _error(i, scale)),
                    experiments,
                    "pam",
                    study,
                )
            )
    return Result(rows, [])


def _truth(signal: str) -> Callable[[Experiment, str], Array]:
    name = "link_position" if signal == "angle" else "transmission_torque"

    def truth(experiment: Experiment, joint: str) -> Array:
        return experiment.joints[joint].truth[name]

    return truth


def _error(kind: int, scale: float) -> Callable[[Array, Array], float]:
    def error(estimated: Array, true: Array) -> float:
        if kind == 0:
            return scale * root_mean_square(estimated, true)
        if kind == 1:
            return scale * largest(estimated, true)
        return 100.0 * largest(estimated, true) / float(np.ptp(true))

    return error
