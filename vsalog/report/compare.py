"""What `compare` says: a table on stdout, warnings on stderr, and a page."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from rich.markup import escape
from rich.table import Table

from vsalog.comparison.references import References
from vsalog.comparison.run import Comparison, Run
from vsalog.core.documents import document_text
from vsalog.core.finding_texts import sentences_of
from vsalog.core.printable import printable
from vsalog.estimation.joint import JointEstimate
from vsalog.report.console import console_for_stdout, print_findings
from vsalog.report.page import Part, Section, assembled, columns_for, joint_charts
from vsalog.report.page_comparison import comparison_charts
from vsalog.report.page_tables import summary_table, warnings_box
from vsalog.report.page_text import bounded
from vsalog.validation.evidence import JointEvidence, TransmissionEvidence, setpoint_unit
from vsalog.writers.atomic import write_text


def worded(found: Comparison) -> Comparison:
    """Return a comparison with its findings in sentences."""
    return replace(found, warnings=sentences_of(found.findings))


def print_comparison(found: Comparison) -> None:
    """Print the table for people."""
    console = console_for_stdout(markup=True)
    print_findings(found.findings)
    table = Table(box=None, pad_edge=False, padding=(0, 2))
    for heading in ("joint", "transmission", "estimator"):
        table.add_column(heading, no_wrap=True)
    for heading in (
        "stiffness [N·m/rad]",
        "± (1 std)",
        "RMS residual [N·m]",
        "off sensor [N·m]",
        "excited",
        "agrees",
        "differs",
        "MSREP to truth [%]",
    ):
        table.add_column(heading.replace("[", "\\["), justify="right")
    for row in sorted(found.rows, key=lambda r: (r.joint, r.transmission)):
        span = "–" if row.stiffness_low is None else f"{row.stiffness_low:.4g} … {row.stiffness_high:.4g}"
        truth = None if row.against_truth is None else row.against_truth.msrep.value
        table.add_row(
            escape(printable(row.joint)), row.transmission, escape(printable(row.estimator)), span, _percent(row.relative_std),
            bounded(row.torque_left), bounded(row.off_sensor), _percent(row.excited_share), _percent(row.agrees_share),
            _percent(row.difference), bounded(truth),
        )  # fmt: skip
    console.print(table)
    console.print(
        "RMS residual: of the fit; off sensor: the fitted torque from the torque sensor; agrees: share of the time"
        " within the 95 % interval of the difference from the first; differs: root mean square, of the first",
        soft_wrap=True,
    )
    for name, reason in found.left_out.items():
        said = reason.removeprefix(f"{name}: ")
        console.print(f"left out: {escape(printable(name))}: {escape(printable(said))}", soft_wrap=True)
    for name, fault in found.failed.items():
        console.print(f"failed: {escape(printable(name))}: {escape(printable(fault))}", soft_wrap=True)


def print_json(found: Comparison) -> None:
    """Print the comparison as one JSON document."""
    sys.stdout.buffer.write(document_text(found).encode())
    sys.stdout.buffer.flush()


def write_comparison_page(path: Path, found: Comparison, runs: Sequence[Run], references: References) -> None:
    """Write a page with one figure of all estimators, and the figures of every single one.

    Raises
    ------
    WriteError
        The file cannot be written.
    """
    log = ", ".join(found.logs)
    columns = columns_for(sum(len(e.summary.transmissions) for run in runs for e in run.estimates))
    sections = []
    for name in dict.fromkeys(row.joint for row in found.rows):
        figures = [Part(part, "", [chart]) for part, chart in comparison_charts(name, runs, references, columns)]
        sections.append(Section(f"{name} by all", log, "", figures))
    for run in runs:
        for estimate in run.estimates:
            joint = _evidence(estimate, setpoint_unit(run.job.rig.joints[estimate.joint]))
            parts = [Part(n, "", charts) for n, charts in joint_charts(joint, columns).parts.items()]
            about = summary_table(estimate.summary.transmissions)
            sections.append(Section(f"{estimate.joint} by {run.contender.label}", log, about, parts))
    write_text(path, assembled(f"Estimators on {log}", "Comparison", warnings_box(found.warnings), sections, ""))


def _evidence(estimate: JointEstimate, unit: str) -> JointEvidence:
    trace = estimate.trace
    assert trace is not None
    names = list(trace.transmissions)
    names = [n for n in names if n != "total"] if len(names) == 2 else names
    parts = {n: _part(trace.transmissions[n], estimate.model.modality) for n in names}
    setpoint = trace.transmissions[names[0]].get("setpoint")
    moves = setpoint is not None and bool(np.isfinite(np.asarray(setpoint, dtype=np.float64)).any())
    return JointEvidence(
        estimate.joint,
        trace.time,
        np.asarray(setpoint, dtype=np.float64) if moves else None,
        unit,
        parts,
        estimate.model,
        {},
        parts[names[-1]].inside,
    )


def _part(columns: Mapping[str, NDArray[Any]], modality: str) -> TransmissionEvidence:
    def of(name: str) -> NDArray[np.float64]:
        return np.asarray(columns[name], dtype=np.float64)

    lagged = "residual" in columns
    fit = of("residual_fit" if lagged else "flexibility_torque_fit")
    return TransmissionEvidence(
        of("deflection"), fit, np.full(fit.shape, np.nan), of("residual" if lagged else "flexibility_torque"), modality.lower(),
        of("stiffness"), of("stiffness_std"), None, of("excited") > 0.0,
    )  # fmt: skip


def _percent(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.0%}" if value >= 0.1 else f"{100.0 * value:.2g} %"
