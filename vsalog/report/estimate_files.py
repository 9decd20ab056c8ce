"""The files one run of `estimate` leaves: trace, model and, when asked for, a log of the trace."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

from vsalog.core.errors import WriteError
from vsalog.core.trace import Trace
from vsalog.estimation.job import Job
from vsalog.estimation.joint import JointEstimate
from vsalog.report.estimate import write_estimate_page
from vsalog.report.outputs import Outputs
from vsalog.report.paper_figures import write_estimate_figures
from vsalog.writers.atomic import atomic_path
from vsalog.writers.trace import TraceWriter
from vsalog.writers.trace_mcap import write_trace_mcap


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
