"""A validation's figures, drawn as soon as a transmission is judged: an hour's samples need not be kept for them."""

from __future__ import annotations

from collections.abc import Collection

from vsalog.core.model import ModelFile
from vsalog.report.page import JointCharts, charts_of, columns_for
from vsalog.report.page_charts import Chart
from vsalog.report.page_decimate import FIGURE_COLUMNS
from vsalog.validation.evidence import JointEvidence

# Per log: joint → transmission → figures.
_Charts = list[dict[str, dict[str, list[Chart]]]]


class Drawings:
    """Take evidence as it comes, one transmission at a time, and keep its figures.

    Parameters
    ----------
    model : whose transmissions will come
    joints : names of those that are wanted; all when empty
    logs : how many
    paper : whether figures are wanted as files, too
    """

    def __init__(self, model: ModelFile, joints: Collection[str], logs: int, paper: bool) -> None:
        fitted = [len(joint.transmission) for name, joint in model.joint.items() if not joints or name in joints]
        # Several have their sum too.
        self._columns = columns_for(logs * sum(n + 1 if n > 1 else n for n in fitted))
        self._paper_too = paper
        self._page: _Charts = [{} for _ in range(logs)]
        self._paper: _Charts = [{} for _ in range(logs)]

    def __call__(self, log: int, joint: JointEvidence) -> None:
        """Draw a joint's transmissions."""
        for name in joint.transmissions:
            self._page[log].setdefault(joint.joint, {})[name] = charts_of(joint, name, self._columns)
            if self._paper_too:
                self._paper[log].setdefault(joint.joint, {})[name] = charts_of(joint, name, FIGURE_COLUMNS)

    def page(self) -> list[list[JointCharts]]:
        """Return the figures of the page: per log, its joints."""
        return _joints(self._page)

    def paper(self) -> list[list[JointCharts]]:
        """Return the figures for files."""
        return _joints(self._paper)


def _joints(charts: _Charts) -> list[list[JointCharts]]:
    return [[JointCharts(joint, parts) for joint, parts in log.items()] for log in charts]
