"""The items of `vsalog reproduce`: what there is, and choosing among it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import cast

from vsalog.core.errors import VsalogError, did_you_mean
from vsalog.reproduce.measure import Study
from vsalog.reproduce.rows import Result


class ReproduceError(VsalogError):
    """There is no such item."""


@dataclass(frozen=True, slots=True)
class Item:
    """Something a paper prints.

    Attributes
    ----------
    name : on the command line
    paper : name on the command line that selects all items of the paper
    title : what it is
    module, function : where it is computed, imported when it runs
    work : how long it takes next to the others, about [ms of a processor of 3 GHz]
    """

    name: str
    paper: str
    title: str
    module: str
    function: str
    work: int = 3000

    def run(self, study: Study) -> Result:
        """Compute it; deterministic for the study's seeds."""
        function = getattr(import_module(f"vsalog.reproduce.{self.module}"), self.function)
        return cast(Callable[[Study], Result], function)(study)


ITEMS = {
    item.name: item
    for item in (
        Item("flacco2012-table1", "flacco2012", "Table 1: VSA-II, three modalities", "flacco2012", "table1"),
        Item("flacco2012-table2", "flacco2012", "Table 2: AwAS, three modalities", "flacco2012", "table2"),
        Item(
            "flacco2012-fig21",
            "flacco2012",
            "Fig. 21: stability factor on the AwAS",
            "flacco2012_robustness",
            "stability_factor",
            work=800,
        ),
        Item(
            "flacco2012-fig22",
            "flacco2012",
            "Fig. 22: constant factors instead of the stability factor",
            "flacco2012_robustness",
            "constant_factor",
            work=1500,
        ),
        Item(
            "flacco2012-fig23",
            "flacco2012",
            "Fig. 23: encoder resolution, VSA-II",
            "flacco2012_robustness",
            "sweep_vsa2",
            work=7500,
        ),
        Item(
            "flacco2012-fig24",
            "flacco2012",
            "Fig. 24: encoder resolution, AwAS",
            "flacco2012_robustness",
            "sweep_awas",
            work=7500,
        ),
        Item("flacco2012-2r", "flacco2012", "§6.3: 2R arm with two VSA-IIs", "flacco2012_arm", "two_joints"),
        Item(
            "flacco2012-experiment",
            "flacco2012",
            "§8: experiment on the AwAS, and its validation",
            "flacco2012_experiment",
            "experiment",
        ),
        Item(
            "flacco2014-table1",
            "flacco2014",
            "Table I: three methods on ideal signals",
            "flacco2014",
            "table1",
            work=1200,
        ),
        Item("flacco2014-noisy", "flacco2014", "§VII: VSA-II with noise", "flacco2014", "noisy"),
        Item("flacco2014-cubic", "flacco2014", "§VII: cubic springs with noise", "flacco2014", "cubic"),
        Item(
            "serio2011",
            "serio2011",
            "Figs. 4–5: errors of the impedance observer",
            "serio2011",
            "simulated",
            work=12000,
        ),
        Item(
            "deluca2007",
            "deluca2007",
            "Theorem 1, remark 1, Fig. 2: the acceleration observer",
            "deluca2007",
            "observer",
        ),
        Item(
            "deluca2007-control",
            "deluca2007",
            "Figs. 3–6: observed state and state controller, 5° and 30°",
            "deluca2007_motion",
            "motions",
            work=9000,
        ),
        Item(
            "shin-parameters",
            "shin",
            "Fig. 4: what the model's parameters do",
            "shin_parameters",
            "guideline",
            work=300,
        ),
        Item("shin-offline", "shin", "§IV-A: model alone against UKF", "shin", "offline", work=8500),
        Item("shin-online", "shin", "§IV-B: UKF sample by sample, time per sample", "shin", "online", work=1000),
        Item("shin-models", "shin", "Tables III, IV: the UKF with simpler models", "shin", "simpler", work=8500),
        Item(
            "shin-control",
            "shin",
            "§IV-C: PI control without encoder and torque sensor",
            "shin_control",
            "pressures_alone",
            work=36000,
        ),
    )
}


def select(names: Iterable[str]) -> list[Item]:
    """Return the items of these names or papers in the catalogue's order, all of them when none is named.

    Raises
    ------
    ReproduceError
        There is no such item or paper; the nearest names are suggested.
    """
    papers = {item.paper for item in ITEMS.values()}
    wanted = list(names)
    for name in wanted:
        if name not in ITEMS and name not in papers:
            known = [*ITEMS, *sorted(papers - set(ITEMS))]
            raise ReproduceError(
                f"there is nothing to reproduce named '{name}'{did_you_mean(name, known) or '.'}"
                f" There are: {', '.join(known)}"
            )
    return [i for i in ITEMS.values() if not wanted or i.name in wanted or i.paper in wanted]
