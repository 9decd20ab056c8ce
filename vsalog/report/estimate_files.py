"""The files one run of `estimate` leaves: trace, model and, when asked for, a log of the trace."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vsalog.core.errors import WriteError
from vsalog.core.trace import Trace
from vsalog.estimation.job import Job
from vsalog.estimation.joint import JointEstimate
from vsalog.report.page_estimate import write_estimate_page
from vsalog.report.paper_figures import write_estimate_figures
from vsalog.writers.atomic import atomic_path
from vsalog.writers.recording_mcap import write_topics_mcap
from vsalog.writers.recording_topics import Topic, scalar_topic
from vsalog.writers.trace import TraceWriter


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where the results go; a page, figures and a log of the trace only where they are asked for."""

    trace: Path
    model: Path
    mcap: Path | None = None
    page: Path | None = None
    figures: Path | None = None

    @classmethod
    def named(
        cls,
        logs: Sequence[Path],
        output: str | None,
        mcap: Path | None,
        page: Path | None = None,
        figures: Path | None = None,
    ) -> Outputs:
        """Name the results after the first log, in the current folder, or as `output` says.

        Raises
        ------
        WriteError
            A result would overwrite one of the logs or another result, or the folder asked for is not there.
        """
        stem = _stem(logs[0])
        if output is None or Path(output).is_dir():
            folder = Path(output or "")
            trace = folder / f"{stem}.stiffness.parquet"
        elif output.endswith(("/", os.sep)):
            raise WriteError(f"{output}: there is no such folder")
        else:
            trace = Path(output)
            folder = trace.parent
            stem = re.sub(r"(\.stiffness)?\.parquet$", "", trace.name)
        outputs = cls(trace, folder / f"{stem}.model.toml", mcap, page, figures)
        taken = {outputs.trace.resolve(): "-o", outputs.model.resolve(): "-o"}
        for path, option in ((mcap, "--mcap"), (page, "--report")):
            if path is not None:
                if path.resolve() in taken:
                    raise WriteError(f"{path}: is asked for twice, by {option} and by {taken[path.resolve()]}")
                taken[path.resolve()] = option
        if figures is not None and figures.exists() and not figures.is_dir():
            raise WriteError(f"{figures}: is no folder; name one for the figures")
        for path in (outputs.trace, outputs.model, outputs.mcap, outputs.page):
            if path is not None and any(path.exists() and log.exists() and path.samefile(log) for log in logs):
                raise WriteError(f"{path}: is the log itself; choose another name with -o")
        return outputs


def _stem(log: Path) -> str:
    name = log.resolve().name
    return name if log.is_dir() else Path(name).stem


def write_results(job: Job, outputs: Outputs, progress: Callable[[str], None] = lambda _: None) -> list[JointEstimate]:
    """Run a job and write its results; they appear together when all went well, and not at all otherwise.

    Raises
    ------
    VsalogError
        The estimation failed, or a file cannot be written.
    """
    if outputs.mcap is not None and job.is_long:
        raise WriteError(
            f"{outputs.mcap}: the log is too long for its trace to be held in memory, as --mcap does; choose a part of it with"
            " --start and --end, or leave --mcap out: the Parquet trace is written in any case"
        )
    provenance = job.provenance()
    kept: list[Trace] = []
    with ExitStack() as stack:
        log = stack.enter_context(atomic_path(outputs.mcap)) if outputs.mcap is not None else None
        page = stack.enter_context(atomic_path(outputs.page)) if outputs.page is not None else None
        model = stack.enter_context(atomic_path(outputs.model))
        writer = stack.enter_context(TraceWriter(outputs.trace, provenance))

        def sink(trace: Trace) -> None:
            writer.write(trace)
            if log is not None:
                kept.append(trace)

        estimates = job.run(sink, progress)
        writer.add_findings(e.findings for e in estimates)
        model.write_text(job.model_file(estimates, provenance).to_toml(), encoding="utf-8")
        if log is not None:
            progress("writing the MCAP log")
            write_trace_mcap(kept, log, provenance)
        # All that takes time is done before the first file appears.
        writer.finish()
        if page is not None:
            progress("writing the report")
            write_estimate_page(page, job, writer.written, estimates, provenance)
        if outputs.figures is not None:
            progress("drawing the figures")
            write_estimate_figures(outputs.figures, job, writer.written, estimates)
    return estimates


def write_trace_mcap(traces: Sequence[Trace], path: Path, provenance: dict[str, str]) -> None:
    """Write traces as a log: per joint and transmission one Float64 topic per column that means something over time.

    Raises
    ------
    WriteError
        The stamps do not fit into a ROS log.
    """
    topics: list[Topic] = []
    for joint in dict.fromkeys(t.joint for t in traces):
        whole = Trace.concatenate([t for t in traces if t.joint == joint])
        order = np.argsort(whole.stamps, kind="stable")
        first = np.append(True, np.diff(whole.stamps[order]) > 0)
        rows = order[first]
        for name, columns in whole.transmissions.items():
            for column, values in columns.items():
                if not column.startswith("coefficient_"):
                    topic = "/".join(
                        ("/vsalog", _token(joint), f"transmission_{name}" if name != "total" else name, column)
                    )
                    topics.append(scalar_topic(topic, whole.stamps[rows], np.asarray(values[rows], np.float64)))
    write_topics_mcap(topics, path, metadata={"vsalog.provenance": provenance})


def _token(name: str) -> str:
    """Return a name as ROS allows it in a topic."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name) or "_"
