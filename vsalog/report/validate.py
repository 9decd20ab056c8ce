"""Document of `validate`: verdicts, scores, what the error depends on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from msgspec.structs import replace

from vsalog.core.finding import Finding
from vsalog.core.finding_texts import says, sentence, sentences_of
from vsalog.core.notation import between, number, unit_text
from vsalog.figures.chart import Charts
from vsalog.figures.dot_plots import logs_chart
from vsalog.figures.joint_figures import Drawings
from vsalog.figures.paper import write_figures
from vsalog.report.document import (
    TONES,
    Block,
    Cell,
    Document,
    Facts,
    Figures,
    Notes,
    Section,
    Table,
    Verdict,
    Words,
    led,
    provenance,
)
from vsalog.report.outputs import write_report
from vsalog.validation.document import Comparison, Dependence, Figure, JointReport, Report, Score, TransmissionReport
from vsalog.validation.frozen import frozen
from vsalog.validation.run import Options, validate
from vsalog.validation.verdict import Line, overview

# Scores of an error ten times the signal's standard deviation [%, %, 1]: beyond, digits have no meaning.
TENFOLD: Mapping[str, float] = {"nrmse": 1000.0, "msrep": 10_000.0, "r2": -99.0}
DEPENDENCES = {
    "torque": "torque (gain)",
    "offset": "constant offset",
    "zero": "zero of the deflection",
    "side": "size of the torque (asymmetry)",
    "gap": "sign of the deflection (backlash)",
    "deflection": "deflection (shape of the spring)",
    "position": "position of link or motor",
    "setpoint": "set-point",
    "velocity": "velocity of the deflection",
    "late": "velocity of link or motor",
    "direction": "direction of motion",
    "loading": "loading or unloading",
    "time": "time (torque)",
    "zero over time": "time (deflection)",
    "gain over time": "time (gain)",
    "resolution": "resolution of the torque sensor",
    "stuck": "a torque sensor that is stuck",
    "itself": "its own past (not white)",
}


def worded(report: Report) -> Report:
    """Return a report with its findings in sentences."""
    return replace(
        report, logs=tuple(replace(log, joints=tuple(_described(j) for j in log.joints)) for log in report.logs)
    )


def _described(joint: JointReport) -> JointReport:
    computed = [says(f) for f in joint.reasons if f.code.startswith("torque.")]
    parts = [replace(t, dependence=tuple(map(_dependence, t.dependence))) for t in joint.transmissions]
    return replace(
        joint,
        transmissions=tuple(parts),
        sentences=tuple(map(_reason, joint.reasons)),
        stiffness=None
        if joint.stiffness is None
        else replace(joint.stiffness, sentence=_reason(joint.stiffness.reason)),
        not_independent=computed[0] if computed else None,
        warnings=sentences_of(joint.findings),
    )


def _dependence(found: Dependence) -> Dependence:
    return replace(found, words=says(Finding(code=found.code, evidence=found.evidence)).removesuffix("."))


def _reason(finding: Finding) -> str:
    words = sentence(finding, joint=False)
    if "p_value" in finding.evidence and finding.value is not None:
        return f"{100.0 * finding.value:.3g} % of the error's mean square shows: {words}"
    # A role is written as the rig has it.
    return words if "_" in words.split()[0] else f"{words[0].upper()}{words[1:]}"


def report_document(
    report: Report, files: Mapping[str, str] = {}, drawn: Sequence[Mapping[str, Charts]] = ()
) -> Document:
    """Return a validation.

    Parameters
    ----------
    report : what was found, in words
    files : what was written: what each is, and its path
    drawn : per log, its joints' figures; none when empty
    """
    logs = [log.log for log in report.logs]
    several = sum(len(log.joints) for log in report.logs) > 1
    items: list[Block] = []
    if several:
        found = overview(report)
        items += [Figures((logs_chart(found),) if drawn else ()), _overview(found)]
    for i, log in enumerate(report.logs):
        for joint in log.joints:
            charts = drawn[i].get(joint.joint, {}) if drawn else {}
            items.append(_section(joint, log.log, charts, f"Joint {joint.joint} in {log.log}" if several else ""))
    for limit in report.thresholds:
        about = f"threshold {limit.name.upper()} ≤ {limit.limit:g} %"
        items.append(Verdict(about, "met" if limit.met else "missed", "good" if limit.met else "bad"))
    items.append(Facts(tuple(files.items()), "terminal"))
    items.append(_provenance(report))
    return Document(
        f"{report.model} against {', '.join(logs)}", "Validation of a stiffness model", tuple(items), report
    )


def write_validation(
    model: Path, logs: Sequence[Path], options: Options, folder: Path | None, figures: Path | None = None,
    progress: Callable[[str], None] = lambda _: None, page: Path | None = None,
) -> tuple[Report, dict[str, str]]:  # fmt: skip
    """Test a model on logs and write the report: `report.json`, `report.html`, and figures for papers.

    Parameters
    ----------
    model, logs, options : of `vsalog.validation.run.validate`
    folder : of the results; the current one when absent
    figures : folder for figures as files, or None
    progress : called with the step that begins
    page : file of the page, if not in that folder

    Returns
    -------
    The report, in words; what each file is, and its path

    Raises
    ------
    VsalogError
        A log or the model is at fault, or a file cannot be written.
    """
    drawings = Drawings(frozen(model), options.joints, len(logs), figures is not None)
    report = worded(validate(model, logs, options, progress, drawings))
    progress("writing the report")
    if figures is not None:
        write_figures(figures, drawings.paper, [log.log for log in report.logs])
    return report, write_report(report_document(report, {}, drawings.page), folder, "report", page=page)


def _overview(found: Sequence[Line]) -> Table:
    """Return several logs in one table: the verdict of each, and its reference."""
    rows: list[tuple[Cell | str, ...]] = []
    for row in found:
        scores = [Cell("–")] * 2 if row.score is None else [_figure(row.score, "nrmse"), _figure(row.score, "msrep")]
        verdict = Cell(row.verdict, tone=TONES[row.verdict])
        stiffness = Cell("–" if row.stiffness is None else row.stiffness, tone=TONES.get(row.stiffness or "", ""))
        inside = number(100.0 * row.inside)
        rows.append((row.log, row.joint, verdict, row.judged_on or "–", stiffness, *scores, inside))
    heads = (
        "log",
        "joint",
        "torque",
        "judged by",
        "stiffness",
        "NRMSE [%], 95 %",
        "MSREP [%], 95 %",
        "inside the region [%]",
    )
    return Table("All logs", heads, tuple(rows), keys=2, texts=5)


def _section(joint: JointReport, log: str, charts: Charts, title: str) -> Section:
    verdict = Verdict(f"{joint.joint} in {log}", f"torque {joint.verdict}", TONES[joint.verdict], joint.sentences)
    items: list[Block] = []
    if joint.stiffness is not None:
        judged = joint.stiffness
        word, tone = f"stiffness {judged.verdict}", TONES[judged.verdict]
        items.append(Verdict(f"{joint.joint} in {log}", word, tone, (judged.sentence,)))
    else:
        items.append(Verdict(f"{joint.joint} in {log}", "stiffness not judged", "", (_unjudged(joint),)))
    items.append(Notes(joint.findings))
    if joint.period > 0.0:
        items.append(Words(f"{joint.duration:.4g} s at {1.0 / joint.period:.4g} Hz.", "page"))
    items += [_scores(joint), _modalities(joint)]
    about = {part.transmission: tuple(_about(part)) for part in joint.transmissions}
    first, rest = led(charts, "torque", f"{log}, {joint.joint}: ", about)
    return Section(title, (*first, *items, *rest), verdict)


def _unjudged(joint: JointReport) -> str:
    """Return why a stiffness has no verdict."""
    if any(c.quantity == "stiffness" and c.inside is not None for t in joint.transmissions for c in t.comparisons):
        return "The rig's nominal stiffness is compared where the torque holds only."
    return "The rig has no nominal stiffness, and the log no true one."


def _scores(joint: JointReport) -> Table:
    """Scores with 95 % intervals, for samples inside and outside the model's region."""
    rows = [
        (part.transmission, _against(part, comparison), where, *_cells(score))
        for part in joint.transmissions
        for comparison in part.comparisons
        for where, score in (("inside", comparison.inside), ("outside", comparison.outside))
        if score is not None
    ]
    heads = ("transmission", "against", "where", "samples", "NRMSE [%]", "RMSE", "R²", "MSREP [%]", "bias", "largest")
    caption = "Scores with 95 % intervals; the verdict is based on those marked *"
    return _of_one(Table(caption, heads, tuple(rows), keys=3, texts=3), joint)


def _of_one(table: Table, joint: JointReport) -> Table:
    """Leave the first column out, which names the transmission, where there is only one."""
    return table.without_first() if len(joint.transmissions) == 1 else table


def _against(part: TransmissionReport, comparison: Comparison) -> str:
    """Return the reference of a prediction, with its unit, marked where the verdict is based on it."""
    is_torque = comparison.quantity == "flexibility_torque"
    mark = "*" if is_torque and comparison.reference == part.judged_on else ""
    quantity = "" if is_torque else " stiffness"
    return f"{comparison.reference}{quantity} [{unit_text(comparison.unit)}]{mark}"


def _cells(score: Score) -> tuple[Cell | str, ...]:
    samples = Cell(str(score.samples), f"{max(round(score.effective_samples), 1)} independent", brief=True)
    figures = (_figure(score, key, brief=key != "nrmse") for key in ("nrmse", "rmse", "r2", "msrep", "bias"))
    return (samples, *figures, number(score.largest))


def _figure(score: Score, key: str, brief: bool = False) -> Cell:
    """Return a score with its interval; no digits where the error is beyond tenfold."""
    figure: Figure = getattr(score, key)
    bound = TENFOLD.get(key)
    digits = 4 if key == "r2" else 3
    bounds = {} if bound is None else {"most": bound} if bound > 0.0 else {"least": bound}
    text = number(figure.value, digits, **bounds)
    whole = figure.low is not None and figure.value is not None and text == number(figure.value, digits)
    return Cell(text, between(figure.low, figure.high, digits) if whole else "", brief)


def _modalities(joint: JointReport) -> Table:
    """The log estimated by each modality, next to each other."""
    rows = [
        (
            part.transmission,
            m.modality,
            between(m.stiffness_low, m.stiffness_high),
            number(m.stiffness_std),
            "–" if m.torque is None else _figure(m.torque, "nrmse"),
            "–" if m.against_truth is None else _figure(m.against_truth, "msrep"),
        )
        for part in joint.transmissions
        for m in part.modalities
    ]
    heads = (
        "transmission",
        "modality",
        "stiffness [N·m/rad]",
        "± (1 std)",
        "torque NRMSE [%]",
        "MSREP of stiffness [%]",
    )
    table = Table("The log itself, estimated by each modality", heads, tuple(rows), keys=2, texts=2)
    return _of_one(table, joint)


def _about(part: TransmissionReport) -> Iterator[Words]:
    """Yield what a transmission's error depends on, and how to find out more."""
    yield Words(
        f"{number(100.0 * part.inside_share)} % of the samples are inside the region that the model was fitted in."
    )
    if part.judged_on is None:
        return
    if not part.dependence:
        yield Words(
            "The error depends on none of the variables checked: offset, torque, deflection, positions, set-point, velocities,"
            " loading, time."
        )
        return
    for d in part.dependence:
        share = f"{number(100.0 * d.share)} % of the error's mean square"
        yield Words(f"The error depends on {DEPENDENCES.get(d.on, d.on)}, {share}: {d.words}.")
    yield Words("'vsalog diagnose LOG' searches for the cause by simulating the rig, and extends the rig by it.")


def _provenance(report: Report) -> Section:
    pairs = [("model", f"{report.model} SHA-256 {report.model_sha256}")]
    pairs += [("model fitted to", f"{log} SHA-256 {digest}") for log, digest in report.model_logs.items()]
    pairs += [("validated on", f"{log.log} SHA-256 {log.sha256}") for log in report.logs]
    return provenance([*pairs, *report.settings.items(), ("vsalog", report.vsalog)], report.rig)
