"""`vsalog.validate`: test a frozen model on other experiments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from vsalog.api.estimate import Estimate
from vsalog.api.results import Listed, Paths, columns, logs_of, names, texts, warned
from vsalog.core.errors import VsalogError
from vsalog.core.finding import Finding
from vsalog.core.model import ModelFile
from vsalog.figures.chart import Chart
from vsalog.figures.dot_plots import logs_chart
from vsalog.figures.joint_figures import Drawings
from vsalog.report.document import Document
from vsalog.report.plot import Drawn
from vsalog.report.validate import report_document, worded
from vsalog.rig import Rig
from vsalog.validation.document import Report, Score
from vsalog.validation.frozen import frozen
from vsalog.validation.run import Options
from vsalog.validation.run import validate as run
from vsalog.validation.verdict import overview

FIGURES = ("mse", "rmse", "nrmse", "msrep", "r2", "bias")


class Validation(Listed):
    """Whether a frozen model holds in other experiments."""

    def __init__(self, report: Report, charts: Sequence[Mapping[str, Mapping[str, Sequence[Chart]]]]) -> None:
        self._report, self._charts = report, charts

    @property
    def data(self) -> Report:
        """What ``report.json`` holds."""
        return self._report

    @property
    def verdicts(self) -> dict[tuple[str, str], str]:
        """(log, joint) → ``holds``, ``fails``, ``undecided`` or ``cannot be judged``."""
        return {(log.log, joint.joint): joint.verdict for log in self._report.logs for joint in log.joints}

    @property
    def met(self) -> bool:
        """Whether all requested thresholds are met."""
        return all(threshold.met for threshold in self._report.thresholds)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about all logs."""
        return tuple(finding for log in self._report.logs for joint in log.joints for finding in joint.findings)

    def _document(self) -> Document:
        return report_document(self._report)

    def _figures(self) -> Iterator[Drawn]:
        for log, joints in zip(self._report.logs, self._charts, strict=True):
            for joint, parts in joints.items():
                for part, charts in parts.items():
                    yield from (Drawn(chart, joint, part, log.log) for chart in charts)
        if sum(len(log.joints) for log in self._report.logs) > 1:
            yield Drawn(logs_chart(overview(self._report)))

    _columns = columns(
        log=str, joint=str, transmission=str, verdict=str, judged_on=str, quantity=str, unit=str, reference=str, where=str,
        samples=int, effective_samples=float, span=float, largest=float,
        **{f"{name}{end}": float for name in FIGURES for end in ("", "_low", "_high")},
    )  # fmt: skip

    def _rows(self) -> Iterator[Mapping[str, object]]:
        for log in self._report.logs:
            for joint in log.joints:
                for part in joint.transmissions:
                    for comparison in part.comparisons:
                        for where, score in (("inside", comparison.inside), ("outside", comparison.outside)):
                            if score is not None:
                                yield {
                                    "log": log.log,
                                    "joint": joint.joint,
                                    "transmission": part.transmission,
                                    "verdict": joint.verdict,
                                    "judged_on": part.judged_on,
                                    "quantity": comparison.quantity,
                                    "unit": comparison.unit,
                                    "reference": comparison.reference,
                                    "where": where,
                                } | dict(_scores(score))


def _scores(score: Score) -> Iterator[tuple[str, object]]:
    yield from (("samples", score.samples), ("effective_samples", score.effective_samples), ("span", score.span))
    for name in FIGURES:
        figure = getattr(score, name)
        yield from ((name, figure.value), (f"{name}_low", figure.low), (f"{name}_high", figure.high))
    yield "largest", score.largest


def validate(
    model: str | Path | ModelFile | Estimate,
    logs: Paths,
    *,
    rig: Rig | str | Path | None = None,
    joints: str | Sequence[str] = (),
    set: Mapping[str, object] | None = None,
    rate: float | None = None,
    time: str = "auto",
    start: str | None = None,
    end: str | None = None,
    modalities: bool | None = None,
    max_nrmse: float | None = None,
    max_msrep: float | None = None,
) -> Validation:
    """Test a fitted model on other experiments, as ``vsalog validate`` does, without writing files.

    Parameters
    ----------
    model : a LOG.model.toml, or what `vsalog.estimate` returned
    logs : another experiment's path, or several
    rig : a rig, its file or a preset's name; the log's own, else the model's, when absent
    joints : names of the joints wanted; all when empty
    set : changes to the rig, e.g. ``{"joint.elbow.motor.damping": "1 N*mm*s/rad"}``
    rate : samples per second of a table without a time column [Hz]
    time : which clock to trust: auto, header, log or publish
    start, end : the part of each log that is used: seconds from its beginning, ``"2 min"``, an ISO 8601 date or a time since the
        epoch
    modalities : estimate the logs by MODEL, SENSOR and RESIDUAL too; for logs of up to 300 000 samples when absent
    max_nrmse, max_msrep : thresholds of the torque's error [%]; `Validation.met` is whether they are met

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    given = logs_of(logs)
    options = Options(rig, names(joints), texts(set), rate, time, modalities, max_nrmse, max_msrep, start, end)
    with TemporaryDirectory(prefix="vsalog-") as folder:
        file = Path(model) if isinstance(model, str | Path) else _written(model, Path(folder))
        drawings = Drawings(frozen(file), options.joints, len(given), paper=False)
        report = worded(run(file, given, options, draw=drawings))
    return warned(Validation(report, drawings.page))


def _written(model: ModelFile | Estimate, folder: Path) -> Path:
    whole = model.model if isinstance(model, Estimate) else model
    if not isinstance(whole, ModelFile):
        kind = type(model).__name__
        raise VsalogError(f"a {kind} is no model: give a LOG.model.toml, or the whole result of vsalog.estimate")
    text = whole.to_toml()
    file = folder / "estimate.model.toml"
    file.write_text(text, encoding="utf-8")
    return file
