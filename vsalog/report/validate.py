"""What `validate` says: a compact table on stdout, warnings on stderr."""

from __future__ import annotations

import sys

from rich.markup import escape
from rich.table import Table

from vsalog.core.documents import document_text
from vsalog.core.printable import printable
from vsalog.report.console import console_for_stdout, fits, print_findings
from vsalog.report.page_tables import TENFOLD
from vsalog.report.page_text import bounded
from vsalog.report.validate_files import Outputs
from vsalog.validation.document import Comparison, Figure, JointReport, Report, Score
from vsalog.validation.verdict import overview

_STYLE = {"holds": "green", "fails": "bold red", "undecided": "yellow", "cannot be judged": "yellow"}


def print_report(report: Report, outputs: Outputs) -> None:
    """Print verdicts, sentences and scores for people."""
    console = console_for_stdout(markup=True)
    if len(report.logs) > 1:
        console.print(_overview(report))
    for log in report.logs:
        for joint in log.joints:
            print_findings(joint.findings)
            name = f"{escape(printable(log.log))}, {escape(printable(joint.joint))}"
            console.print(f"[bold]{name}[/]: [{_STYLE[joint.verdict]}]{joint.verdict}[/]")
            for sentence in joint.sentences:
                console.print(f"  {escape(printable(sentence))}", soft_wrap=True)
            scores = _scores(joint, wide=True)
            console.print(scores if fits(scores, console) else _scores(joint, wide=False))
            if any(t.modalities for t in joint.transmissions):
                console.print(_modalities(joint))
    for threshold in report.thresholds:
        met = "met" if threshold.met else "[bold red]missed[/]"
        console.print(f"threshold {threshold.name} ≤ {threshold.limit:g} %: {met}")
    console.print(
        f"report: {escape(printable(str(outputs.page)))}   data: {escape(printable(str(outputs.document)))}",
        soft_wrap=True,
    )


def _overview(report: Report) -> Table:
    """Several logs in one table: what came of each, by what it was judged."""
    table = Table(box=None, pad_edge=False, padding=(0, 2))
    for heading in ("log", "joint", "verdict", "judged by"):
        table.add_column(heading)
    for heading in ("NRMSE [%], 95 %", "MSREP [%]", "inside [%]"):
        table.add_column(heading.replace("[", "\\["), justify="right")
    for row in overview(report):
        style = _STYLE[row.verdict]
        scores = (
            (_interval(row.score.nrmse), bounded(row.score.msrep.value, most=TENFOLD["msrep"]))
            if row.score
            else ("–", "–")
        )
        name, joint = escape(printable(row.log)), escape(printable(row.joint))
        table.add_row(
            name, joint, f"[{style}]{row.verdict}[/]", row.judged_on or "–", *scores, f"{100.0 * row.inside:.3g}"
        )
    return table


def print_json(report: Report, outputs: Outputs) -> None:
    """Print the report as one JSON document."""
    sys.stdout.buffer.write(document_text(report).encode())
    sys.stdout.buffer.flush()


def _scores(joint: JointReport, wide: bool) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2))
    for heading in ("transmission", "against", "where"):
        table.add_column(heading, no_wrap=wide)
    for heading in ("samples", "NRMSE [%], 95 %", "RMSE", "R²", "MSREP [%]", "bias", "largest"):
        table.add_column(heading.replace("[", "\\["), justify="right", no_wrap=wide)
    for part in joint.transmissions:
        for comparison in part.comparisons:
            for where, score in (("inside", comparison.inside), ("outside", comparison.outside)):
                if score is not None:
                    table.add_row(part.transmission, _against(comparison), where, *_cells(score))
    return table


def _against(comparison: Comparison) -> str:
    quantity = "" if comparison.quantity == "flexibility_torque" else " stiffness"
    return f"{comparison.reference}{quantity} [{comparison.unit.replace('*', '·')}]".replace("[", "\\[")


def _cells(score: Score) -> tuple[str, ...]:
    return (
        str(score.samples),
        _interval(score.nrmse),
        bounded(score.rmse.value),
        bounded(score.r2.value, 4, least=TENFOLD["r2"]),
        bounded(score.msrep.value, most=TENFOLD["msrep"]),
        bounded(score.bias.value),
        f"{score.largest:.3g}",
    )


def _modalities(joint: JointReport) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2))
    for heading in ("transmission", "modality"):
        table.add_column(heading)
    for heading in ("stiffness [N·m/rad]", "± (1 std)", "torque NRMSE [%]", "MSREP of stiffness [%]"):
        table.add_column(heading.replace("[", "\\["), justify="right")
    for part in joint.transmissions:
        for m in part.modalities:
            span = "–" if m.stiffness_low is None else f"{m.stiffness_low:.4g} … {m.stiffness_high:.4g}"
            torque = "–" if m.torque is None else bounded(m.torque.nrmse.value, most=TENFOLD["nrmse"])
            truth = "–" if m.against_truth is None else bounded(m.against_truth.msrep.value)
            table.add_row(part.transmission, m.modality, span, bounded(m.stiffness_std), torque, truth)
    return table


def _interval(figure: Figure) -> str:
    if figure.value is None:
        return "–"
    if figure.low is None or figure.value > TENFOLD["nrmse"]:
        return bounded(figure.value, most=TENFOLD["nrmse"])
    return f"{figure.value:.3g}  ({figure.low:.3g} … {figure.high:.3g})"
