"""The tables of a report: scores, dependences, modalities, an estimate's key figures; as HTML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from vsalog.estimation.summary import TransmissionSummary
from vsalog.report.page_text import bounded, escaped, name, number, table
from vsalog.validation.document import Comparison, Figure, JointReport, Report, Score, TransmissionReport
from vsalog.validation.verdict import overview

QUANTITIES = {"flexibility_torque": "torque", "stiffness": "stiffness"}
REFERENCES = {
    "sensor": "torque sensor",
    "residual": "residual of the motor equation",
    "nominal": "nominal model of the rig",
    "truth": "simulator's truth",
}
SCORES = ("NRMSE [%]", "RMSE", "MSREP [%]", "R²", "bias", "largest")
# What scores are where the error is ten times the signal's spread [%, %, 1]: beyond, digits say no more.
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


def scores_table(part: TransmissionReport) -> str:
    """Scores with 95 % intervals: a heading per reference, below it samples inside and outside the model's region apart."""
    groups = []
    for comparison in part.comparisons:
        found = (("inside the region", comparison.inside), ("outside: extrapolation", comparison.outside))
        rows = "".join(_score_row(where, score) for where, score in found if score is not None)
        if rows:
            heading = f'<tr class="group"><th colspan="{len(SCORES) + 1}" scope="rowgroup">{_against(part, comparison)}</th></tr>'
            groups.append(f"<tbody>{heading}{rows}</tbody>")
    if not groups:
        return ""
    heads = "".join(f'<th scope="col" class="n">{escaped(head)}</th>' for head in SCORES)
    caption = "Scores with 95 % intervals"
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{caption}">'
        f'<table class="scores"><caption>{caption}</caption>'
        f'<thead><tr><th scope="col">samples</th>{heads}</tr></thead>{"".join(groups)}</table></div>'
    )


def _against(part: TransmissionReport, comparison: Comparison) -> str:
    quantity = QUANTITIES.get(comparison.quantity, comparison.quantity)
    against = f"{quantity.capitalize()} against the {REFERENCES[comparison.reference]}"
    rests = comparison.reference == part.judged_on and comparison.quantity == "flexibility_torque"
    mark = ' <span class="mark">the verdict rests on this</span>' if rests else ""
    return f'{escaped(against)} <span class="ci">[{escaped(unit_text(comparison.unit))}]</span>{mark}'


def _score_row(where: str, score: Score) -> str:
    independent = f"{score.samples}, worth {max(round(score.effective_samples), 1)} independent"
    cells = (
        _figure(score.nrmse, most=TENFOLD["nrmse"]),
        _figure(score.rmse),
        _figure(score.msrep, most=TENFOLD["msrep"]),
        _figure(score.r2, 4, least=TENFOLD["r2"]),
        _figure(score.bias, 2),
        number(score.largest),
    )
    kind = "" if where.startswith("inside") else ' class="outside"'
    # Where the page is narrow each cell carries its own heading.
    row = "".join(f'<td class="n" data-head="{h}">{cell}</td>' for h, cell in zip(SCORES, cells, strict=True))
    return f'<tr{kind}><th scope="row">{where}<br><span class="ci">{independent}</span></th>{row}</tr>'


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: N·m/rad."""
    return unit.replace("*", "·")


def _figure(figure: Figure, digits: int = 3, most: float = math.inf, least: float = -math.inf) -> str:
    """A figure with its interval; beyond `most` or `least` no digits."""
    if figure.value is None:
        return "–"
    if not least <= figure.value <= most:
        return escaped(bounded(figure.value, digits, most, least))
    if figure.low is None or figure.high is None:
        return number(figure.value, digits)
    interval = f"{number(figure.low, digits)} … {number(figure.high, digits)}"
    return f'{number(figure.value, digits)}<br><span class="ci">{interval}</span>'


def dependences_list(part: TransmissionReport) -> str:
    """What the error depends on, in words, and how to find out more."""
    if part.judged_on is None:
        return ""
    if not part.dependence:
        return (
            "<p>The error depends on nothing that was looked at: offset, torque, deflection, positions, set-point, velocities,"
            " loading, time.</p>"
        )
    items = [
        f"<li><strong>{escaped(DEPENDENCES.get(d.on, d.on))}</strong>, {number(100.0 * d.share)} % of the error's mean square:"
        f" {escaped(d.words)}.</li>"
        for d in part.dependence
    ]
    more = "<p><code>vsalog diagnose LOG</code> looks for the cause by a simulation of the rig and extends the rig by it.</p>"
    return f"<p>What the error depends on:</p><ul>{''.join(items)}</ul>{more}"


def modalities_table(part: TransmissionReport) -> str:
    """The log estimated by each modality, side by side."""
    rows = []
    simulated = any(m.against_truth is not None for m in part.modalities)
    for m in part.modalities:
        low, high = m.stiffness_low, m.stiffness_high
        row = [
            escaped(m.modality),
            "–" if low is None or high is None else f"{number(low, 4)} … {number(high, 4)}",
            "–" if m.stiffness_std is None else number(m.stiffness_std),
            "–" if m.torque is None else _figure(m.torque.nrmse, most=TENFOLD["nrmse"]),
        ]
        if simulated:
            row.append("–" if m.against_truth is None else _figure(m.against_truth.msrep, most=TENFOLD["msrep"]))
        rows.append(row)
    heads = ["modality", "stiffness [N·m/rad]", "standard deviation", "torque NRMSE [%]"]
    heads += ["MSREP against the truth [%]"] if simulated else []
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
    heads = ("transmission", "stiffness [N·m/rad]", "± (1 std)", "last [N·m/rad]", "RMS residual [N·m]", "of the torque",
             "excited")  # fmt: skip
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


def overview_table(report: Report) -> str:
    """Several logs in one table: what came of each, by what it was judged."""
    rows = []
    for line in overview(report):
        judged_on = "–" if line.judged_on is None else REFERENCES[line.judged_on]
        scores = ("–", "–")
        if line.score is not None:
            scores = (
                _figure(line.score.nrmse, most=TENFOLD["nrmse"]),
                _figure(line.score.msrep, most=TENFOLD["msrep"]),
            )
        where = f"{name(line.joint)} in {name(line.log)}"
        rows.append((where, escaped(line.verdict), judged_on, *scores, f"{100.0 * line.inside:.3g}"))
    heads = ("log", "verdict", "judged by", "NRMSE [%], 95 %", "MSREP [%]", "inside the region [%]")
    return table("All logs", heads, rows, texts=3)


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
