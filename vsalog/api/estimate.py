"""`vsalog.estimate`: the stiffness of a log's joints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, overload

import pyarrow as pa

from vsalog.api.results import Logs, Results, names, paths, texts, warned
from vsalog.core.finding import Finding
from vsalog.core.model import ModelFile
from vsalog.core.recording import Recording
from vsalog.estimation.evidence import setpoint_unit
from vsalog.estimation.job import Job, Options, prepare
from vsalog.estimation.joint import JointEstimate, tuning
from vsalog.estimation.trace_evidence import evidence_of
from vsalog.figures.joint_figures import plot_charts
from vsalog.report.document import Document
from vsalog.report.estimate import estimate_data, estimate_document
from vsalog.report.plot import Drawn
from vsalog.rig import Rig


class Estimate(Results, Sequence[JointEstimate]):
    """The stiffness of joints over time, with their fitted models; a `JointEstimate` per joint, by number or name."""

    def __init__(self, job: Job, estimates: Sequence[JointEstimate]) -> None:
        self._job, self._estimates = job, tuple(estimates)

    @overload
    def __getitem__(self, at: int | str) -> JointEstimate: ...

    @overload
    def __getitem__(self, at: slice) -> tuple[JointEstimate, ...]: ...

    def __getitem__(self, at: int | str | slice) -> JointEstimate | tuple[JointEstimate, ...]:
        if isinstance(at, str):
            return {e.joint: e for e in self._estimates}[at]
        return self._estimates[at]

    def __len__(self) -> int:
        return len(self._estimates)

    @property
    def data(self) -> dict[str, Any]:
        """What ``vsalog estimate --json`` prints, but for the files that it writes."""
        return estimate_data(self._job, self._estimates)

    @property
    def rig(self) -> Rig:
        """The rig of the estimate."""
        return self._job.rig

    @property
    def model(self) -> ModelFile:
        """The content of LOG.model.toml: ``model.to_toml()`` is its text but for the comment at the end."""
        return self._job.model_file(self._estimates, self._job.provenance())

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about the logs, the rig and the joints."""
        return (*self._job.findings, *(finding for e in self._estimates for finding in e.findings))

    def _document(self) -> Document:
        return estimate_document(self._job, self._estimates)

    def _figures(self) -> Iterator[Drawn]:
        for e in self._estimates:
            if e.summary.transmissions:
                evidence = evidence_of(e.trace.to_table(), e, setpoint_unit(self.rig.joints[e.joint]))
                for part, charts in plot_charts(evidence).items():
                    yield from (Drawn(chart, e.joint, part) for chart in charts)

    def to_arrow(self) -> pa.Table:
        """Return the trace of all joints as LOG.stiffness.parquet has it: a row per sample and transmission."""
        tables = [e.trace.to_table() for e in self._estimates]
        joined = pa.concat_tables(tables, promote_options="default")
        return joined.replace_schema_metadata(self._job.provenance())


def estimate(
    logs: Logs,
    rig: Rig | str | Path | None = None,
    *,
    joints: str | Sequence[str] = (),
    estimator: str = "auto",
    preset_tuning: str | None = None,
    tune: Mapping[str, object] | None = None,
    causal: bool = False,
    set: Mapping[str, object] | None = None,
    rate: float | None = None,
    time: str = "auto",
    start: str | None = None,
    end: str | None = None,
) -> Estimate:
    """Estimate the stiffness of the joints of a log, as ``vsalog estimate`` does, without writing files.

    Parameters
    ----------
    logs : a log's path or a recording, or several that make one model
    rig : a rig, its file or a preset's name; that in the log, or next to it, when absent
    joints : names of the joints wanted; all when empty
    estimator : a method's name, as ``vsalog estimate --help`` lists them, or ``auto``
    preset_tuning : ``paper`` uses the values of the estimator's paper; ``tune`` overrides them
    tune : tuning, e.g. ``{"forgetting": 0.98}``; docs/explanation/estimators/ lists it, a page per method
    causal : estimate each sample from those before it, as in a control loop
    set : changes to the rig, e.g. ``{"joint.elbow.motor.damping": "1 N*mm*s/rad"}``; ``setpoint`` fixes the set-point
    rate : samples per second of a table without a time column [Hz]
    time : which clock to trust: auto, header, log or publish
    start, end : the part of each log that is used: seconds from its beginning, ``"2 min"``, an ISO 8601 date or a time since the
        epoch

    Returns
    -------
    a sequence of one `JointEstimate` per joint, with its `trace`, `model`, `summary` and `findings`; ``(joint,) = estimate(log)``

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    given = logs if isinstance(logs, Iterable) and not isinstance(logs, str) else [logs]
    how = tuning(preset_tuning, texts(tune), causal)
    options = Options(rig, names(joints), estimator, how, texts(set), rate, time, start, end)
    job = prepare([log if isinstance(log, Recording) else paths(log)[0] for log in given], options)
    return warned(Estimate(job, job.run()))
