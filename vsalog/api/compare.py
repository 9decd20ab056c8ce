"""`vsalog.compare`: several estimators on one log."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from msgspec.structs import asdict

from vsalog.api.results import Listed, Paths, columns, logs_of, names, texts, warned
from vsalog.comparison import run as comparison
from vsalog.comparison.references import References
from vsalog.core.finding import Finding
from vsalog.estimation.job import Options
from vsalog.report.compare import comparison_charts, comparison_document, worded
from vsalog.report.document import Document
from vsalog.report.plot import Drawn
from vsalog.rig import Rig


class Comparison(Listed):
    """Several estimators on one log, side by side."""

    def __init__(self, found: comparison.Comparison, runs: Sequence[comparison.Run], references: References) -> None:
        self._found, self._runs, self._references = found, runs, references

    @property
    def data(self) -> comparison.Comparison:
        """What ``vsalog compare --json`` prints."""
        return self._found

    @property
    def left_out(self) -> Mapping[str, str]:
        """Estimators that the log does not allow, and why."""
        return self._found.left_out

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings."""
        return self._found.findings

    def _document(self) -> Document:
        return comparison_document(self._found)

    def _figures(self) -> Iterator[Drawn]:
        for joint in dict.fromkeys(row.joint for row in self._found.rows):
            for part, chart in comparison_charts(joint, self._runs, self._references):
                yield Drawn(chart, joint, part)

    _columns = columns(
        estimator=str, joint=str, transmission=str, stiffness_low=float, stiffness_high=float, relative_std=float,
        torque_left=float, off_sensor=float, excited_share=float, agrees_share=float, difference=float, msrep_to_truth=float,
    )  # fmt: skip

    def _rows(self) -> Iterator[Mapping[str, object]]:
        for row in self._found.rows:
            score = row.against_truth
            yield asdict(row) | {"msrep_to_truth": None if score is None else score.msrep.value}


def compare(
    logs: Paths,
    rig: Rig | str | Path | None = None,
    *,
    estimators: str | Sequence[str] = (),
    joints: str | Sequence[str] = (),
    set: Mapping[str, object] | None = None,
    rate: float | None = None,
    time: str = "auto",
    start: str | None = None,
    end: str | None = None,
) -> Comparison:
    """Run several estimators on the same log, as ``vsalog compare`` does.

    Parameters
    ----------
    logs : a log's path, or several that make one model
    rig : a rig, its file or a preset's name; that in the log, or next to it, when absent
    estimators : names, each with its tuning, e.g. ``"qr-rls:forgetting=0.98"``; all that the log allows when empty
    joints : names of the joints wanted; all when empty
    set : changes to the rig, e.g. ``{"joint.elbow.motor.damping": "1 N*mm*s/rad"}``
    rate : samples per second of a table without a time column [Hz]
    time : which clock to trust: auto, header, log or publish
    start, end : the part of each log that is used: seconds from its beginning, ``"2 min"``, an ISO 8601 date or a time since the
        epoch

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    options = Options(rig, names(joints), "auto", {}, texts(set), rate, time, start, end)
    asked = [name for text in names(estimators) for name in text.split(",") if name.strip()]
    found, runs, references = comparison.compare(logs_of(logs), options, asked, keep_going=False)
    return warned(Comparison(worded(found), runs, references))
