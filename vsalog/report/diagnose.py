"""Document of `diagnose`: verdict, causes, errors before and after, remaining residual, next experiment."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

from vsalog.core.notation import number, share_text, signal_name, unit_of
from vsalog.core.printable import printable
from vsalog.diagnosis.document import Diagnosis, EquationError, FoundCause, Gain, SignalError
from vsalog.diagnosis.evidence import CauseEvidence, JointEvidence
from vsalog.diagnosis.run import Options, diagnose
from vsalog.figures.chart import Chart
from vsalog.figures.dot_plots import equations_chart, gain_chart, reduction_text
from vsalog.figures.equation_residuals import cause_chart, remainder_chart
from vsalog.figures.joint_figures import columns_for
from vsalog.figures.simulated_signals import signal_charts
from vsalog.report import document as tree
from vsalog.report.diagnosis_sentences import (
    confidence_text,
    confidence_words,
    further_findings,
    kind_text,
    nothing_left,
    open_experiment,
    parameter_text,
    unexplained_words,
    worded,
)
from vsalog.report.document import TONES, Block, Cell, Document, Facts, Figures, Notes, Section, Source, Table, Words
from vsalog.report.experiment import FILE as EXPERIMENT
from vsalog.report.experiment import scenario_text
from vsalog.report.outputs import sealed, write_report


def diagnosis_document(
    found: Diagnosis, files: Mapping[str, str] = {}, evidence: Sequence[JointEvidence] = (), extended: str | None = None
) -> Document:  # fmt: skip
    """Return a diagnosis.

    Parameters
    ----------
    found : what was found, in words
    files : what was written: what each is, and its path
    evidence : what the figures draw, joint by joint
    extended : the rig with the causes filled in, as TOML; None where there is nothing to fill in
    """
    parts: Iterable[JointEvidence | EquationError | SignalError | FoundCause]
    parts = chain(evidence, found.equations, found.simulation_error, found.causes)
    joints = list(dict.fromkeys(part.joint for part in parts))
    several = len(joints) > 1
    drawn = {
        joint.joint: simulated_charts(found, joint, columns_for(sum(len(j.signals) for j in evidence)))
        for joint in evidence
    }
    lead = next((chart for charts in drawn.values() for chart in charts), None)
    items: list[Block] = [
        tree.Verdict(found.log, found.verdict, TONES[found.verdict], found.sentences),
        Figures(() if lead is None else (lead,), next(iter(drawn), "")),
        Notes(tuple(further_findings(found))),
        _wrong(found, drawn, lead, several),
        Section("Causes", tuple(_causes(found, evidence, several)), where="both" if found.causes else "page"),
        *_gain(found, joints, several),
        *_logs(found),
        *_extended(found, extended),
        _left(found),
    ]
    more = open_experiment(found)
    items += [Section("Next experiment", (Words(more),))] if more else []
    items += [Section("", (Facts(tuple(files.items())),), where="terminal"), _provenance(found)]
    return Document(f"Diagnosis of {found.log}", "Errors of the simulation and their causes", tuple(items), found)


def write_diagnosis(
    log: Path | Sequence[Path],
    holdout: Path | Sequence[Path] | None,
    options: Options,
    folder: Path | None,
    progress: Callable[[str], None] = lambda _: None,
    page: Path | None = None,
) -> tuple[Diagnosis, dict[str, str]]:
    """Diagnose a log and write what was found.

    Parameters
    ----------
    log, holdout, options : of `vsalog.diagnosis.run.diagnose`
    folder : of the results; the current one when absent
    progress : called with the step that begins
    page : file of the page, if not in that folder

    Returns
    -------
    The diagnosis, in words; what each file is, and its path

    Raises
    ------
    VsalogError
        A log or the rig is at fault, or a file cannot be written.
    """
    outcome = diagnose(log, holdout, options, progress)
    found = worded(outcome)
    progress("writing the report")
    extended = None if outcome.extended is None else outcome.extended.to_toml()
    scenario = None if outcome.proposed is None else scenario_text(outcome.proposed)
    return found, diagnosis_files(found, outcome.evidence, extended, folder, scenario, page)


def _logs(found: Diagnosis) -> Iterator[Section]:
    """Yield the results of each of several logs, and the differences between them."""
    if found.logs:
        rows = tuple(
            (
                e.log,
                e.begin or "–",
                f"{signal_name(e.signal)} [{unit_of(e.unit).strip() or '1'}]",
                number(e.rmse_before),
                number(e.rmse_after),
            )
            for e in found.logs
        )
        heads = ("log", "begins", "signal", "original rig", "extended rig")
        yield Section("Each log", (Table("Error of the simulation (rmse)", heads, rows, keys=3, texts=3),))
    for trend in found.trends:
        low_high = [f"{number(a)} … {number(b)}" for a, b in trend.intervals]
        values = tuple(
            (log, begin or "–", number(v, 4), text)
            for log, begin, v, text in zip(trend.logs, trend.begins, trend.values, low_high, strict=True)
        )
        about = f"{trend.cause}, {signal_name(trend.part)}: {signal_name(trend.number)}"
        caption = f"{about} [{unit_of(trend.unit).strip() or '1'}]; rig: {number(trend.rig)}"
        words = ["In the last log it does not differ from the rig's value."]
        if trend.since is not None:
            low, high = (log or "none" for log in trend.since_interval)
            about = "" if low == high else f" (95 %: {low} … {high})"
            words = [f"It differs from the rig's value since {trend.since}{about}."]
        if trend.per_day is not None and trend.per_day_interval is not None:
            slowest, fastest = (number(rate) for rate in trend.per_day_interval)
            words.append(f"It changes by {number(trend.per_day)} a day since then (95 %: {slowest} … {fastest}).")
        table = Table(caption, ("log", "begins", "value", "95 % interval"), values, keys=2, texts=2)
        yield Section("Differences between the logs", (table, Words(" ".join(words))))


def diagnosis_files(
    found: Diagnosis,
    evidence: Sequence[JointEvidence],
    extended: str | None,
    folder: Path | None,
    scenario: str | None = None,
    page: Path | None = None,
) -> dict[str, str]:
    """Write all of it: `diagnosis.json`, `diagnosis.html`, `extended.rig.toml` and `next.scenario.toml`.

    Parameters
    ----------
    found : what was found, in words
    evidence : what the page's figures draw
    extended : the rig with the causes filled in, as TOML; None where there is nothing to fill in: an older file of that name is
        never deleted, but reported as old
        folder : of the results; the current one when absent
        scenario : the experiment that is proposed, as TOML; None where none is
        page : file of the page, if not in that folder

    Returns
    -------
    What each file is, and its path; and a note about an older rig

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    rig, experiment = extra_paths(folder)
    others = {}
    if extended is not None:
        # The name of a log must not end the comment about the rig's origin.
        causes = ", ".join(f"{c.cause} in joint {c.joint}" for c in found.causes)
        heading = printable(f"# Extended by vsalog {found.vsalog} with what {found.log} shows: {causes}")
        others["extended rig"] = rig, sealed(f"{heading}\n{extended}", [found.log_sha256])
    if scenario is not None:
        others["next experiment"] = experiment, sealed(scenario, [found.log_sha256])
    files = write_report(diagnosis_document(found, {}, evidence, extended), folder, "diagnosis", others, page)
    if extended is None and rig.exists():
        was = "is from an earlier run and was kept: this diagnosis found nothing to extend the rig by."
        files["note"] = f"{rig} {was}"
    return files


def extra_paths(folder: Path | None) -> tuple[Path, Path]:
    """Return where the extended rig and the proposed experiment go."""
    where = Path() if folder is None else folder
    return where / "extended.rig.toml", where / EXPERIMENT


def simulated_charts(found: Diagnosis, joint: JointEvidence, columns: int) -> list[Chart]:
    """Return the figures of a joint's signals, measured and simulated."""
    noise = {e.signal: e.noise_floor for e in found.simulation_error if e.joint == joint.joint}
    noise |= {g.signal: g.noise_floor for g in found.gain.signals if g.joint == joint.joint}
    return signal_charts(joint, noise, columns)


def _causes(found: Diagnosis, evidence: Sequence[JointEvidence], several: bool) -> Iterator[Block]:
    if not found.causes:
        nothing = "None is needed." if found.verdict == "consistent" else "The unexplained residual is described below."
        yield Words(f"No cause of the catalogue was found. {nothing}", "page")
        return
    yield _ranking(found, several)
    views = {(j.joint, v.cause, v.part): (j, v) for j in evidence for v in j.causes}
    for i, cause in enumerate(found.causes, 1):
        where = f", joint {cause.joint}" if several else ""
        title = f"{i}. {cause.title} ({kind_text(cause)}{where})"
        view = views.get((cause.joint, cause.cause, cause.part))
        yield Section(title, tuple(_about(cause, view)))


def _about(cause: FoundCause, view: tuple[JointEvidence, CauseEvidence] | None) -> Iterator[Block]:
    """Yield what a cause is, the evidence for it, and how to confirm it."""
    for name, value in cause.parameters.items():
        yield Words(f"{signal_name(name)} {parameter_text(value)}")
    yield Words(f"{confidence_words(cause)}.")
    if cause.indistinguishable_from:
        yield Words(f"This log cannot separate it from {', '.join(cause.indistinguishable_from)}.")
    yield Words(cause.why, "page")
    if cause.how_to_confirm:
        yield Words(f"To confirm it: {cause.how_to_confirm}")
    if cause.tell_apart:
        yield Words(cause.tell_apart)
    if cause.reference:
        yield Words(cause.reference, "page")
    chart = None if view is None else cause_chart(*view)
    yield Figures(() if chart is None else (chart,))


def _ranking(found: Diagnosis, several: bool) -> Table:
    """Causes: the error they remove, what they do to the stiffness, their confidence, and their classes."""
    rows: list[tuple[Cell | str, ...]] = [
        (
            *_joint(cause, several),
            Cell(cause.title, kind_text(cause)),
            Cell(share_text(cause.error_removed), share=cause.error_removed),
            "–" if cause.stiffness_change is None else share_text(cause.stiffness_change),
            Cell(confidence_text(cause), share=cause.confidence),
            ", ".join(cause.indistinguishable_from) or "–",
        )
        for cause in found.causes
    ]
    left = found.unexplained.fraction
    if not nothing_left(found.unexplained):
        rows.append((*("–",) * several, "unexplained", Cell(share_text(left), share=left), "–", "–", "–"))
    heads = ("cause", "error it removes", "stiffness changes by", "confidence", "not separable from")
    return _table("Ranking of the causes", heads, rows, several, 5, where="page")


def _wrong(found: Diagnosis, drawn: Mapping[str, Sequence[Chart]], lead: Chart | None, several: bool) -> Section:
    """The error of the rig's simulation in each signal."""
    whole = any(e.rmse_whole_log is not None for e in found.simulation_error)
    rows = [
        (
            *_joint(e, several),
            _signal(e),
            number(e.rmse),
            number(e.noise_floor),
            f"{number(e.nrmse)} %",
            *((number(e.rmse_whole_log),) if whole else ()),
        )
        for e in found.simulation_error
    ]
    heads = ["signal", "error (rmse), in windows", "noise floor", "of its span"]
    heads += ["error, whole log without restart"] if whole else []
    table = _table("Error of the simulation with the original rig", heads, rows, several)
    figures = []
    for joint, charts in drawn.items():
        shown = tuple(chart for chart in charts if chart is not lead)
        figures.append(Section(f"Joint {joint}" if several else "", (Figures(shown, joint),), where="page"))
    nothing = [] if rows else [Words("Nothing could be simulated.", "page")]
    return Section("Simulation error", (*nothing, table, *figures), where="page" if found.gain.signals else "both")


def _gain(found: Diagnosis, joints: Sequence[str], several: bool) -> Iterator[Section]:
    """Errors of signals and equations before and after."""
    gain = found.gain
    rows = [
        (*_joint(g, several), _signal(g), *map(number, (g.rmse_before, g.rmse_after, g.noise_floor)), reduction_text(g))
        for g in gain.signals
    ]
    heads = ("signal", "original rig", "extended rig", "noise floor", "reduced by (95 %)")
    charts = (gain_chart([g for g in gain.signals if g.joint == joint], gain.where) for joint in joints)
    table = _table("Error of the simulation (rmse)", heads, rows, several)
    if rows:
        kind = "another log, to which nothing was fitted" if gain.holdout else "no other log was given"
        where = Words(f"Measured on {gain.where} ({kind}).")
        yield Section("Improvement", (where, table, Figures(tuple(c for c in charts if c is not None))))
    equations = [
        (*_joint(e, several), _signal(e), e.side, *map(number, (e.rms_before, e.rms_after, e.noise)))
        for e in found.equations
    ]
    heads = ("equation", "side", "original rig", "extended rig", "noise floor")
    charts = (equations_chart([e for e in found.equations if e.joint == joint]) for joint in joints)
    table = _table("RMS residual of each equation", heads, equations, several, 2)
    yield Section("The joint's equations", (table, Figures(tuple(c for c in charts if c is not None))), where="page")


def _extended(found: Diagnosis, extended: str | None) -> Iterator[Section]:
    if extended is not None:
        words = (
            "extended.rig.toml is the rig with these causes filled in, an ordinary rig to simulate, estimate and validate with."
            " Its changes:"
        )
        before, after = found.rig.splitlines(), extended.splitlines()
        changed = "\n".join(difflib.unified_diff(before, after, "rig", "extended.rig.toml", lineterm="", n=3))
        yield Section("The extended rig", (Words(words), Source("Changes in the rig", changed)), where="page")


def _left(found: Diagnosis) -> Section:
    unit = next((e.unit for e in found.equations if e.equation == found.unexplained.equation), "")
    chart = remainder_chart(found.unexplained, unit)
    figures = Figures(() if chart is None else (chart,))
    return Section("Unexplained residual", (Words(unexplained_words(found.unexplained)), figures))


def _provenance(found: Diagnosis) -> Section:
    pairs = [("log", f"{found.log} SHA-256 {found.log_sha256}")]
    if found.holdout is not None:
        pairs.append(("held-out log", f"{found.holdout} SHA-256 {found.holdout_sha256}"))
    return tree.provenance([*pairs, *found.settings.items(), ("vsalog", found.vsalog)], found.rig)


def _table(
    caption: str, heads: Sequence[str], rows: Sequence[tuple[Cell | str, ...]], several: bool, texts: int = 1,
    where: tree.Where = "both",
) -> Table:  # fmt: skip
    """Return a table whose rows begin with their joint where there are several."""
    heads = (*(("joint",) * several), *heads)
    return Table(caption, heads, tuple(rows), keys=1 + several, texts=texts + several, where=where)


def _joint(part: FoundCause | Gain | SignalError | EquationError, several: bool) -> tuple[str, ...]:
    return (part.joint,) * several


def _signal(found: Gain | SignalError | EquationError) -> str:
    name = found.equation if isinstance(found, EquationError) else found.signal
    # A stiffness has no measured value: the row is the difference between its estimates by sensor and by motor.
    name = name.replace("stiffness", "stiffness, sensor − motor", 1) if isinstance(found, Gain) else name
    return f"{signal_name(name)} [{unit_of(found.unit).strip() or '1'}]"
