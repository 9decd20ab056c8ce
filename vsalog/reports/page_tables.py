"""The tables of a report: scores, dependences, modalities, an estimate's key figures; as HTML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from vsalog.reports.page_figures import number
from vsalog.reports.page_text import escaped, name, table
from vsalog.summary import TransmissionSummary
from vsalog.validation.document import Comparison, Figure, JointReport, Score, TransmissionReport

QUANTITIES = {"flexibility_torque": "torque", "stiffness": "stiffness"}
REFERENCES = {
    "sensor": "torque sensor",
    "residual": "residual of the motor equation",
    "nominal": "nominal model of the rig",
    "truth": "simulator's truth",
}
DEPENDENCES = {
    "torque": "torque (gain)",
    "offset": "constant offset",
    "deflection": "deflection",
    "setpoint": "set-point",
    "velocity": "velocity of the deflection",
    "direction": "direction of motion",
    "loading": "loading or unloading",
    "time": "time",
    "itself": "its own past (not white)",
}


def scores_table(part: TransmissionReport) -> str:
    """Scores with 95 % intervals; samples inside and outside the model's region apart."""
    rows = []
    for comparison in part.comparisons:
        for where, score in (("inside", comparison.inside), ("outside", comparison.outside)):
            if score is not None:
                rows.append(_score_row(part, comparison, where, score))
    heads = ("judged against", "samples", "NRMSE [%]", "RMSE", "MSREP [%]", "R²", "bias", "largest")
    return table("Scores with 95 % intervals", heads, rows, texts=2)


def _score_row(part: TransmissionReport, comparison: Comparison, where: str, score: Score) -> list[str]:
    against = f"{QUANTITIES.get(comparison.quantity, comparison.quantity)}: {REFERENCES[comparison.reference]}"
    judged = comparison.reference == part.judged_on and comparison.quantity == "flexibility_torque"
    told = "inside" if where == "inside" else '<span class="outside">outside (extrapolation)</span>'
    verdict = " <small>(the verdict)</small>" if judged and where == "inside" else ""
    return [
        f'{escaped(against)} <span class="ci">[{escaped(unit_text(comparison.unit))}]</span>{verdict}',
        f'{told}<br><span class="ci fixed">{score.samples}, worth {number(score.effective_samples)}</span>',
        *(_figure(f) for f in (score.nrmse, score.rmse, score.msrep)),
        _figure(score.r2, 4),
        _figure(score.bias, 2),
        number(score.largest),
    ]


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: N·m/rad."""
    return unit.replace("*", "·")


def _figure(figure: Figure, digits: int = 3) -> str:
    if figure.value is None:
        return "–"
    if figure.low is None or figure.high is None:
        return number(figure.value, digits)
    interval = f"{number(figure.low, digits)} … {number(figure.high, digits)}"
    return f'{number(figure.value, digits)}<br><span class="ci">{interval}</span>'


def dependences_list(part: TransmissionReport) -> str:
    """What the error depends on, in words, strongest first."""
    if part.judged_on is None:
        return ""
    if not part.dependence:
        return "<p>The error depends on nothing that was looked at: offset, torque, deflection, set-point, speed, time.</p>"
    items = [
        f"<li><strong>{escaped(DEPENDENCES.get(d.on, d.on))}</strong>, {number(100.0 * d.share)} % of the error's mean square:"
        f" {escaped(d.words)}.</li>"
        for d in part.dependence
    ]
    return f"<p>What the error depends on:</p><ul>{''.join(items)}</ul>"


def modalities_table(part: TransmissionReport) -> str:
    """The log estimated by each modality, side by side."""
    rows = []
    for m in part.modalities:
        low, high = m.stiffness_low, m.stiffness_high
        span = "–" if low is None or high is None else f"{number(low, 4)} … {number(high, 4)}"
        rows.append(
            [
                escaped(m.modality),
                span,
                "–" if m.stiffness_std is None else number(m.stiffness_std),
                "–" if m.torque is None else _figure(m.torque.nrmse),
                "–" if m.against_truth is None else _figure(m.against_truth.msrep),
            ]
        )
    heads = ("modality", "stiffness [N·m/rad]", "standard deviation", "torque NRMSE [%]", "MSREP against the truth [%]")
    return table("The log itself, estimated by each modality", heads, rows)


def summary_table(parts: Sequence[TransmissionSummary]) -> str:
    """An estimate's key figures."""
    rows = []
    for p in parts:
        low, high = p.stiffness_low, p.stiffness_high
        rows.append(
            [
                escaped(p.transmission),
                "–" if low is None or high is None else f"{number(low, 4)} … {number(high, 4)}",
                _percent(p.relative_std),
                "–" if p.stiffness_last is None else number(p.stiffness_last, 4),
                "–" if p.fit_rms is None else number(p.fit_rms),
                _percent(p.fit_share),
                _percent(p.excited_share),
            ]
        )
    heads = ("transmission", "stiffness [N·m/rad]", "± (1 std)", "last [N·m/rad]", "torque left over [N·m]", "of its spread",
             "supported")  # fmt: skip
    return table("Estimate", heads, rows)


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{number(100.0 * share)} %"


def motor_table(found: Mapping[str, float]) -> str:
    """What was estimated of the motors."""
    rows = []
    for key in (k for k in found if not k.endswith("_std")):
        unit = "kg·m²" if key.startswith("inertia") else "N·m·s/rad"
        rows.append(
            [escaped(key.replace("_", " ")), number(found[key], 5), number(found.get(f"{key}_std", math.nan), 2), unit]
        )
    return table("Motor, as estimated", ("parameter", "value", "± (1 std)", "unit"), rows)


def joint_box(joint: JointReport, log: str) -> str:
    """Verdict and sentences of a joint."""
    kind = joint.verdict.split(" ")[0]
    sentences = " ".join(map(escaped, joint.sentences))
    return (
        f'<div class="joint"><p><span class="verdict {kind}">{escaped(joint.verdict)}</span>'
        f" {name(joint.joint)} in {name(log)}</p>"
        f"<p>{sentences}</p></div>"
    )


def warnings_box(warnings: Sequence[str]) -> str:
    """What a person should know."""
    if not warnings:
        return ""
    items = "".join(f"<li>{escaped(w)}</li>" for w in warnings)
    return f'<div class="warnings" role="note"><p><strong>Warnings</strong></p><ul>{items}</ul></div>'


def facts(pairs: Sequence[tuple[str, str]]) -> str:
    """Names and values as a list of definitions; both HTML."""
    return "<dl>" + "".join(f"<dt>{key}</dt><dd>{value}</dd>" for key, value in pairs) + "</dl>"
