"""Document of `estimate`, and the files that it writes: trace, model, page, figures."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow as pa

from vsalog.core.errors import WriteError
from vsalog.core.notation import between, number, percent, transmission_title
from vsalog.core.printable import printable
from vsalog.core.trace import Trace
from vsalog.estimation.evidence import setpoint_unit
from vsalog.estimation.job import Job
from vsalog.estimation.joint import JointEstimate
from vsalog.estimation.summary import TransmissionSummary
from vsalog.estimation.trace_evidence import distinct, evidence_of, thinned
from vsalog.estimators.equation import SUPPORTED_SHARE
from vsalog.figures.decimation import FIGURE_COLUMNS
from vsalog.figures.joint_figures import columns_for, joint_charts
from vsalog.figures.paper import write_figures
from vsalog.report.document import Block, Cell, Document, Facts, Notes, Section, Table, Verdict, Words, led, provenance
from vsalog.report.html import page_of
from vsalog.report.outputs import Outputs, sealed
from vsalog.writers.atomic import atomic_path, made_folder
from vsalog.writers.trace import TraceWriter
from vsalog.writers.trace_mcap import write_trace_mcap

Layout = Callable[[pa.Table], pa.Table]


def estimate_document(
    job: Job, estimates: Sequence[JointEstimate], outputs: Outputs | None = None, trace: Path | None = None,
    origin: Mapping[str, str] | None = None,
) -> Document:  # fmt: skip
    """Return what was estimated.

    Parameters
    ----------
    job : that was run
    estimates : the results, joint by joint
    outputs : the files to name
    trace : the Parquet file, complete, that figures are drawn of; without one there are none
    origin : provenance, as `Job.provenance` gives it
    """
    log = ", ".join(printable(path.name) for path in job.logs)
    items: list[Block] = [Notes(tuple(job.findings), "terminal"), *_joints(job, estimates, trace)]
    if job.findings:
        items.append(Notes(tuple(job.findings), "page"))
    if outputs is not None:
        items.append(Facts(tuple(outputs.written.items()), "terminal"))
    if origin is not None:
        items.append(_provenance(estimates, origin))
    data = None if outputs is None else estimate_data(job, estimates, outputs)
    return Document(f"Stiffness of {log}", "Estimate", tuple(items), data)


def write_estimate(
    job: Job,
    outputs: Outputs,
    provenance: dict[str, str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
    layout: Layout | None = None,
) -> list[JointEstimate]:
    """Run a job and write its results; they appear together when all went well, and not at all otherwise.

    Parameters
    ----------
    job : ready to run
    outputs : the files to write
    provenance : as `Job.provenance` gives it, which takes a hash of the logs; computed when absent
    progress : called with the step that begins
    layout : of the trace's table, where it is not to be as a trace gives it

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
    provenance = job.provenance() if provenance is None else provenance
    kept: list[Trace] = []
    with ExitStack() as stack:
        stack.enter_context(made_folder(outputs.trace.parent))
        apart = None
        if layout is not None and outputs.page is not None:
            # Figures are drawn of a trace as it is.
            folder = stack.enter_context(TemporaryDirectory(prefix="vsalog-", dir=outputs.trace.parent))
            apart = TraceWriter(Path(folder, "trace.parquet"), provenance)
        log = None if outputs.mcap is None else stack.enter_context(atomic_path(outputs.mcap))
        page = None if outputs.page is None else stack.enter_context(atomic_path(outputs.page))
        model = stack.enter_context(atomic_path(outputs.model))
        first = TraceWriter(outputs.trace, provenance, *([] if layout is None else [layout]))
        writers = [stack.enter_context(w) for w in (first, apart) if w is not None]

        def sink(trace: Trace) -> None:
            for writer in writers:
                writer.write(trace)
            if log is not None:
                kept.append(trace)

        estimates = job.run(sink, progress)
        first.add_findings(e.findings for e in estimates)
        file = job.model_file(estimates, provenance)
        model.write_text(sealed(file.to_toml(), file.log.values()), encoding="utf-8")
        if log is not None:
            progress("writing the MCAP log")
            write_trace_mcap(kept, log, provenance)
        # Everything slow is done before the first file appears.
        for writer in writers:
            writer.finish()
        trace = writers[-1].written
        if page is not None:
            progress("writing the report")
            page.write_text(page_of(estimate_document(job, estimates, None, trace, provenance)), encoding="utf-8")
        if outputs.figures is not None:
            progress("drawing the figures")
            evidence = [
                evidence_of(trace, e, setpoint_unit(job.rig.joints[e.joint]))
                for e in estimates
                if e.summary.transmissions
            ]
            drawn = {joint.joint: joint_charts(joint, FIGURE_COLUMNS) for joint in evidence}
            write_figures(outputs.figures, [drawn])
    return estimates


def _joints(job: Job, estimates: Sequence[JointEstimate], trace: Path | None) -> Iterator[Section]:
    columns = columns_for(sum(len(e.summary.transmissions) for e in estimates))
    for e in estimates:
        parts = distinct(e.summary.transmissions)
        first: list[Block] = []
        rest: list[Block] = []
        if trace is not None and parts:
            unit = setpoint_unit(job.rig.joints[e.joint])
            charts = joint_charts(evidence_of(trace, e, unit), columns)
            if _is_observed(parts):
                # The stiffness is the rig's own.
                charts = {n: [chart for chart in own if chart.name != "stiffness"] for n, own in charts.items()}
            lead = "torque" if _is_observed(parts) else "stiffness"
            first, rest = led(charts, lead, f"{e.joint}: ")
        s, about = e.summary, f"{e.estimator}: {e.reason}."
        about += f" {s.duration:.4g} s at {1.0 / s.period:.4g} Hz." if s.period > 0.0 else ""
        if trace is not None and parts and thinned(e) > 1:
            about += f" The figures are drawn of one sample in {thinned(e)}."
        results: tuple[Block, ...] = (Words(about), _table(parts), *_external(s.transmissions), _motor(e.model.motor))
        title = f"Joint {e.joint}" if len(estimates) > 1 else ""
        yield Section(title, (*first, Notes(e.findings), *results, *rest), _verdict(e, parts))


def _verdict(e: JointEstimate, parts: Sequence[TransmissionSummary]) -> Verdict:
    """Return a joint's outcome in a line; what findings invalidate is not called estimated."""
    known = [p for p in parts if p.stiffness_low is not None]
    spans = [p.deflection_span for p in parts if p.deflection_span is not None]
    if any(f.severity == "invalidates" for f in e.findings):
        return Verdict(e.joint, "partly invalid" if known else "invalid", "bad", tuple(map(_said, known)), brief=True)
    if known:
        warned = any(f.severity == "warning" for f in e.findings)
        word = "estimated, with warnings" if warned else "estimated"
        return Verdict(e.joint, word, "open" if warned else "good", tuple(map(_said, known)), brief=True)
    if spans and _is_observed(parts):
        observed = f"state observed, no stiffness estimated; the deflection spans {spans[0]:.4g} rad"
        return Verdict(e.joint, "observed", "", (observed,))
    return Verdict(e.joint, "not estimated", "open")


def _is_observed(parts: Sequence[TransmissionSummary]) -> bool:
    return all(p.transmission == "total" and p.fit_rms is None and p.stiffness_low is None for p in parts)


def _said(p: TransmissionSummary) -> str:
    span, std = between(p.stiffness_low, p.stiffness_high), percent(p.relative_std)
    excited = percent(p.excited_share)
    stiffness = f"stiffness {span} N·m/rad (1 % to 99 % of the samples) ± {std} (1 std)"
    return f"{transmission_title(p.transmission)}: {stiffness}, excited {excited} of the time."


def _table(parts: Sequence[TransmissionSummary]) -> Table:
    heads = ("transmission", "stiffness [N·m/rad]", "± (1 std)", "last [N·m/rad]", "RMS residual [N·m]", "of the torque",
             "excited")  # fmt: skip
    rows = [
        (
            p.transmission,
            between(p.stiffness_low, p.stiffness_high),
            percent(p.relative_std),
            number(p.stiffness_last, 4),
            number(p.fit_rms),
            percent(p.fit_share),
            percent(p.excited_share),
        )
        for p in parts
    ]
    return Table("Estimate", heads, () if _is_observed(parts) else tuple(rows))


def _external(parts: Sequence[TransmissionSummary]) -> Iterator[Words]:
    """Yield the stiffness at the link from outside, where the rig has the link's weight."""
    for part in parts:
        if part.external_stiffness_low is not None:
            span = between(part.external_stiffness_low, part.external_stiffness_high)
            yield Words(
                f"With the link's weight, the external stiffness σ + ∂g/∂q is {span} N·m/rad (1 % to 99 % of the samples)."
            )


def _motor(found: Mapping[str, float]) -> Table:
    """Return what was estimated of the motors; a value smaller than its uncertainty is not determined."""
    rows = []
    for name in (n for n in found if not n.endswith("_std")):
        value, std = found[name], found[f"{name}_std"]
        unit = "kg·m²" if name.startswith("inertia") else "N·m·s/rad"
        known = value > 0.0 and std < SUPPORTED_SHARE * value
        cell = Cell(f"{number(value, 5)} {unit}", "" if known else "not determined by this log")
        rows.append((name.replace("_", " "), cell, f"{number(std, 2)} {unit}"))
    return Table("Motor, as estimated", ("motor", "value", "± (1 std)"), tuple(rows))


def _provenance(estimates: Sequence[JointEstimate], origin: Mapping[str, str]) -> Section:
    inputs: dict[str, str] = json.loads(origin["vsalog.input"])
    pairs = [(f"log {name}", f"SHA-256 {digest}") for name, digest in inputs.items()]
    settings = {e.joint: ", ".join(f"{key} = {value}" for key, value in e.settings.items()) for e in estimates}
    pairs += [(f"settings of {joint}", words) for joint, words in settings.items()]
    return provenance([*pairs, ("vsalog", origin["vsalog.version"])], origin["vsalog.rig"])


def estimate_data(job: Job, estimates: Sequence[JointEstimate], outputs: Outputs | None = None) -> dict[str, object]:
    """Return what is printed as JSON; without files where none are named."""
    files = {} if outputs is None else {"trace": outputs.trace, "model": outputs.model, "mcap": outputs.mcap}
    named = {what: None if path is None else printable(str(path)) for what, path in files.items()}
    return {
        "logs": [printable(str(log)) for log in job.logs],
        "rig": {
            "name": job.rig.name,
            "path": None if job.rig.path is None else printable(str(job.rig.path)),
            "guessed": job.guessed,
        },
        **({"outputs": named} if named else {}),
        "joints": [
            {
                "joint": e.joint,
                "estimator": e.estimator,
                "reason": e.reason,
                "modality": e.model.modality,
                "settings": e.settings,
                "motor": e.model.motor,
                "summary": e.summary,
                "findings": e.findings,
                "warnings": list(e.warnings),
            }
            for e in estimates
        ],
        "findings": job.findings,
        "warnings": list(job.warnings),
    }
