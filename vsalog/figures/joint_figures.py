"""The figures of joints by transmission: of an estimate at once, of a validation as soon as a transmission is judged.

An hour's samples need not be kept for them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

from vsalog.core.model import ModelFile
from vsalog.estimation.evidence import JointEvidence
from vsalog.figures.characteristic import characteristic_charts, stiffness_surface_chart
from vsalog.figures.chart import Chart
from vsalog.figures.decimation import FIGURE_COLUMNS, one_after_the_other
from vsalog.figures.error_statistics import error_charts
from vsalog.figures.paper import SIZES
from vsalog.figures.time_series import convergence_charts, expanded_chart, stiffness_chart, torque_chart, with_deviation


class Drawings:
    """Take evidence as it comes, one transmission at a time, and keep its figures.

    Parameters
    ----------
    model : whose transmissions will come
    joints : names of those that are wanted; all when empty
    logs : number of logs
    paper : whether figures are wanted as files, too

    Attributes
    ----------
    page, paper : per log, joint → figures
    """

    def __init__(self, model: ModelFile, joints: Collection[str], logs: int, paper: bool) -> None:
        fitted = [len(joint.transmission) for name, joint in model.joint.items() if not joints or name in joints]
        # Several have their sum too.
        self._columns = columns_for(logs * sum(n + 1 if n > 1 else n for n in fitted))
        self._paper_too = paper
        self.page: list[dict[str, dict[str, Sequence[Chart]]]] = [{} for _ in range(logs)]
        self.paper: list[dict[str, dict[str, Sequence[Chart]]]] = [{} for _ in range(logs)]

    def __call__(self, log: int, joint: JointEvidence) -> None:
        """Draw a joint's transmissions."""
        self.page[log].setdefault(joint.joint, {}).update(joint_charts(joint, self._columns))
        if self._paper_too:
            self.paper[log].setdefault(joint.joint, {}).update(joint_charts(joint, FIGURE_COLUMNS))


def columns_for(transmissions: int) -> int:
    """Return the pixel columns of a figure; it falls with the root of the number of transmissions, which all have figures."""
    return math.ceil(FIGURE_COLUMNS / math.sqrt(max(transmissions, 1)))


def joint_charts(joint: JointEvidence, columns: int) -> dict[str, Sequence[Chart]]:
    """Return the figures of all transmissions of a joint; several runs follow one another in time."""
    joint = replace(joint, time=one_after_the_other(joint.time))
    found: dict[str, Sequence[Chart]] = {}
    for name, part in joint.transmissions.items():
        expanded = expanded_chart(joint, part, columns)
        found[name] = [
            torque_chart(joint, part, columns),
            *([] if expanded is None else [expanded]),
            stiffness_chart(joint, part, columns),
            *characteristic_charts(joint, name, part),
            *error_charts(joint, part),
            *([] if found else convergence_charts(joint, columns)),
        ]
    return found


def plot_charts(joint: JointEvidence) -> dict[str, list[Chart]]:
    """Return all figures of a joint's transmissions for a file or a screen of their own.

    They are those of reports, and the stiffness over deflection and set-point. Where the stiffness's band is narrower than a
    line, the standard deviation has axes of its own.
    """
    found: dict[str, list[Chart]] = {}
    for name, charts in joint_charts(joint, FIGURE_COLUMNS).items():
        part = joint.transmissions[name]
        surface = stiffness_surface_chart(joint, name, part)
        # What is plotted most often comes first.
        found[name] = sorted([*charts, *([] if surface is None else [surface])], key=_rank)
        found[name][0] = with_deviation(found[name][0], joint, part, SIZES["column"].lines)
    return found


def _rank(chart: Chart) -> int:
    first = ("stiffness", "torque_over_deflection", "stiffness_surface")
    return first.index(chart.name) if chart.name in first else len(first)
