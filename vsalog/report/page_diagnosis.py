"""The page of a diagnosis: what the simulation gets wrong, why, the extended rig, what it is worth, what is left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vsalog.diagnosis.document import Diagnosis, FoundCause, Verdict
from vsalog.diagnosis.evidence import CauseEvidence, JointEvidence
from vsalog.report.diagnosis_words import confidence_text, unexplained_words
from vsalog.report.drawings import columns_for
from vsalog.report.page import Part, Section, assembled, provenance
from vsalog.report.page_charts import Chart
from vsalog.report.page_diagnosis_causes import cause_chart, remainder_chart
from vsalog.report.page_diagnosis_gain import equations_chart, gain_chart
from vsalog.report.page_diagnosis_signals import signal_charts
from vsalog.report.page_diagnosis_tables import (
    equations_table,
    errors_table,
    gain_table,
    parameters_table,
    ranking_table,
    rig_change,
)
from vsalog.report.page_tables import warnings_box
from vsalog.report.page_text import escaped, name
from vsalog.writers.atomic import write_text

# The verdicts' colours; their words say the same.
KINDS: dict[Verdict, str] = {
    "consistent": "holds",
    "consistent as far as checked": "holds",
    "explained": "explained",
    "partly explained": "partly",
    "unexplained": "fails",
}


def write_diagnosis_page(
    path: Path, diagnosis: Diagnosis, evidence: Sequence[JointEvidence], extended_rig_toml: str | None
) -> None:
    """Write a diagnosis as one page.

    Parameters
    ----------
    path : of the page
    diagnosis : what was found
    evidence : what the figures draw, joint by joint
    extended_rig_toml : the rig with the causes filled in; None where there is nothing to fill in

    Raises
    ------
    WriteError
        The file cannot be written.
    """
    write_text(path, diagnosis_page(diagnosis, evidence, extended_rig_toml))


def diagnosis_page(diagnosis: Diagnosis, evidence: Sequence[JointEvidence], extended_rig_toml: str | None) -> str:
    """Return a diagnosis as HTML."""
    several = len(_joints(diagnosis, evidence)) > 1
    sections = [
        _wrong(diagnosis, evidence, several),
        _why(diagnosis, evidence, several),
        _extended(diagnosis, extended_rig_toml),
        _worth(diagnosis, evidence, several),
        _left(diagnosis),
        _next(diagnosis),
    ]
    title = f"Diagnosis of {diagnosis.log}"
    kind = "What the simulation gets wrong, and why"
    return assembled(title, kind, _verdict(diagnosis), [s for s in sections if s is not None], _provenance(diagnosis))


def _joints(diagnosis: Diagnosis, evidence: Sequence[JointEvidence]) -> list[str]:
    """Return the joints' names, each once."""
    parts = [
        *(e.joint for e in evidence),
        *(e.joint for e in diagnosis.equations),
        *(c.joint for c in diagnosis.causes),
    ]
    return list(dict.fromkeys(parts))


def _section(heading: str, html: str, parts: Sequence[Part] = ()) -> Section:
    return Section("", "", html, parts, heading)


def _verdict(diagnosis: Diagnosis) -> str:
    sentences = "".join(f"<p>{escaped(s)}</p>" for s in diagnosis.sentences)
    return (
        f'<section aria-label="Verdict"><div class="joint"><p><span class="verdict {KINDS[diagnosis.verdict]}">'
        f"{escaped(diagnosis.verdict)}</span> {name(diagnosis.log)}</p>{sentences}</div>"
        f"{warnings_box(diagnosis.warnings)}</section>"
    )


def _wrong(diagnosis: Diagnosis, evidence: Sequence[JointEvidence], several: bool) -> Section:
    columns = columns_for(sum(len(joint.signals) for joint in evidence))
    parts = []
    for joint in evidence:
        noise = {e.signal: e.noise_floor for e in diagnosis.simulation_error if e.joint == joint.joint}
        noise |= {g.signal: g.noise_floor for g in diagnosis.gain.signals if g.joint == joint.joint}
        heading = f"Joint {name(joint.joint)} in {name(joint.signals_log)}"
        charts = signal_charts(joint, noise, columns)
        if charts:
            parts.append(Part(joint.joint, "", charts, heading))
    html = errors_table(diagnosis.simulation_error, several)
    return _section("What the simulation gets wrong", html or "<p>Nothing could be simulated.</p>", parts)


def _why(diagnosis: Diagnosis, evidence: Sequence[JointEvidence], several: bool) -> Section:
    if not diagnosis.causes:
        nothing = "Nothing asks for one." if diagnosis.verdict == "consistent" else "What is left is described below."
        return _section("Why", f"<p>No cause of the catalogue was found. {nothing}</p>")
    views = {(j.joint, v.cause, v.part): (j, v) for j in evidence for v in j.causes}
    parts = []
    for i, cause in enumerate(diagnosis.causes, 1):
        where = f" in joint {name(cause.joint)}" if several else ""
        heading = f"{i}. {escaped(cause.title)}{where}"
        parts.append(
            Part(cause.cause, _about(cause), _charts(views.get((cause.joint, cause.cause, cause.part))), heading)
        )
    html = ranking_table(diagnosis, several) + parameters_table(diagnosis.causes, several)
    return _section("Why", html, parts)


def _charts(view: tuple[JointEvidence, CauseEvidence] | None) -> list[Chart]:
    chart = None if view is None else cause_chart(*view)
    return [] if chart is None else [chart]


def _about(cause: FoundCause) -> str:
    """What a cause is, why it is believed, how to confirm it."""
    parts = [escaped(cause.why)]
    sure = f"Confidence {escaped(confidence_text(cause))}."
    if cause.indistinguishable_from:
        others = ", ".join(f"<code>{escaped(o)}</code>" for o in cause.indistinguishable_from)
        parts.append(f"{sure} This log cannot tell it from {others}.")
    else:
        parts.append(sure)
    if cause.how_to_confirm:
        parts.append(f"<strong>To confirm it:</strong> {escaped(cause.how_to_confirm)}")
    if cause.tell_apart:
        parts.append(f"<strong>To tell it apart:</strong> {escaped(cause.tell_apart)}")
    if cause.reference:
        parts.append(f'<span class="ci">{escaped(cause.reference)}</span>')
    return "".join(f"<p>{text}</p>" for text in parts if text)


def _extended(diagnosis: Diagnosis, extended: str | None) -> Section | None:
    if extended is None:
        return None
    words = (
        "<p><code>extended.rig.toml</code> is the rig with these causes filled in, an ordinary rig to simulate, estimate and"
        " validate with. What changes in it:</p>"
    )
    return _section("The extended rig", words + rig_change(diagnosis.rig, extended))


def _worth(diagnosis: Diagnosis, evidence: Sequence[JointEvidence], several: bool) -> Section:
    gain = diagnosis.gain
    parts = []
    for joint in _joints(diagnosis, evidence):
        charts = [
            gain_chart([g for g in gain.signals if g.joint == joint], gain.where),
            equations_chart([e for e in diagnosis.equations if e.joint == joint]),
        ]
        found = [c for c in charts if c is not None]
        if found:
            parts.append(Part(joint, "", found, f"Joint {name(joint)}" if several else ""))
    where = ""
    if gain.signals:
        kind = "another log, to which nothing was fitted" if gain.holdout else "no other log was given"
        where = f"<p>Measured on {escaped(gain.where)} ({kind}).</p>"
    html = where + gain_table(gain.signals, several) + equations_table(diagnosis.equations, several)
    return _section("What it is worth" if gain.signals else "The joint's equations", html, parts)


def _left(diagnosis: Diagnosis) -> Section:
    left = diagnosis.unexplained
    unit = next((e.unit for e in diagnosis.equations if e.equation == left.equation), "")
    chart = remainder_chart(left, unit)
    parts = [] if chart is None else [Part("remainder", "", [chart])]
    return _section("What is left unexplained", f"<p>{escaped(unexplained_words(left))}</p>", parts)


def _next(diagnosis: Diagnosis) -> Section | None:
    if not diagnosis.next_experiment:
        return None
    return _section("The next experiment", f"<p>{escaped(diagnosis.next_experiment)}</p>")


def _provenance(diagnosis: Diagnosis) -> str:
    pairs = [("log", f"{name(diagnosis.log)} <code>SHA-256 {escaped(diagnosis.log_sha256)}</code>")]
    if diagnosis.holdout is not None:
        digest = f" <code>SHA-256 {escaped(diagnosis.holdout_sha256)}</code>" if diagnosis.holdout_sha256 else ""
        pairs.append(("held-out log", f"{name(diagnosis.holdout)}{digest}"))
    pairs += [(escaped(key), f"<code>{escaped(value)}</code>") for key, value in diagnosis.settings.items()]
    pairs.append(("vsalog", escaped(diagnosis.vsalog)))
    return provenance(pairs, diagnosis.rig)
