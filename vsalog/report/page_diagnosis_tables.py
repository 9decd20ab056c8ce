"""The tables of a diagnosis, as HTML: errors, ranking, parameters, gain, equations, and the change of the rig."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from vsalog.diagnosis.document import Diagnosis, EquationError, FoundCause, Gain, SignalError
from vsalog.report.diagnosis_words import (
    change_text,
    confidence_text,
    nothing_left,
    parameter_text,
    reduction_text,
    share_text,
    signal_name,
    unit_of,
)
from vsalog.report.page_text import escaped, name, number, table


def ranking_table(diagnosis: Diagnosis, several: bool) -> str:
    """Causes: the error they remove, what they do to the stiffness, their confidence, and their classes."""
    rows = []
    for cause in diagnosis.causes:
        others = ", ".join(f"<code>{escaped(o)}</code>" for o in cause.indistinguishable_from)
        rows.append(
            [
                _cause(cause, several),
                _bar(cause.error_removed),
                change_text(cause.stiffness_change),
                _bar(cause.confidence, confidence_text(cause)),
                others or "–",
            ]
        )
    if rows and not nothing_left(diagnosis.unexplained):
        rows.append(["left unexplained", _bar(diagnosis.unexplained.fraction), "–", "–", "–"])
    heads = ("cause", "error it removes", "moves stiffness by", "confidence", "this log cannot tell it from")
    return table("Ranking of the causes", heads, rows, texts=5)


def parameters_table(causes: Sequence[FoundCause], several: bool) -> str:
    """All parameters with their 95 % intervals."""
    rows = [
        [
            f"<code>{escaped(c.cause)}</code>{_joint(c.joint, several)}",
            escaped(signal_name(n)),
            escaped(parameter_text(p)),
        ]
        for c in causes
        for n, p in c.parameters.items()
    ]
    return table("Parameters of the causes, with 95 % intervals", ("cause", "parameter", "value"), rows, texts=2)


def errors_table(errors: Sequence[SignalError], several: bool) -> str:
    """How far the rig's simulation is from each signal."""
    heads = ["signal", "error (rmse), in windows", "noise floor", "of its span"]
    whole = any(e.rmse_whole_log is not None for e in errors)
    if whole:
        heads.append("error, whole log in one go")
    rows = []
    for e in errors:
        unit = unit_of(e.unit)
        cells = [f"{number(e.rmse)}{unit}", f"{number(e.noise_floor)}{unit}", f"{number(e.nrmse)} %"]
        if whole:
            cells.append("–" if e.rmse_whole_log is None else f"{number(e.rmse_whole_log)}{unit}")
        rows.append([escaped(signal_name(e.signal)) + _joint(e.joint, several), *map(escaped, cells)])
    return table("Error of the simulation with the rig as it stands", heads, rows)


def gain_table(gains: Sequence[Gain], several: bool) -> str:
    """Simulation errors before and after."""
    rows = []
    for g in gains:
        unit = unit_of(g.unit)
        cells = [f"{number(v)}{unit}" for v in (g.rmse_before, g.rmse_after, g.noise_floor)]
        rows.append(
            [
                escaped(signal_name(g.signal)) + _joint(g.joint, several),
                *map(escaped, cells),
                escaped(reduction_text(g)),
            ]
        )
    heads = ("signal", "rig as it stands", "extended rig", "noise floor", "less by (95 % interval)")
    return table("Error of the simulation (rmse)", heads, rows)


def equations_table(errors: Sequence[EquationError], several: bool) -> str:
    """The RMS residual of each equation."""
    rows = []
    for e in errors:
        unit = unit_of(e.unit)
        cells = [f"{number(v)}{unit}" for v in (e.rms_before, e.rms_after, e.noise)]
        title = escaped(signal_name(e.equation)) + _joint(e.joint, several)
        rows.append([title, escaped(e.side), *map(escaped, cells)])
    heads = ("equation", "side", "rig as it stands", "extended rig", "noise floor")
    return table("RMS residual of each equation", heads, rows, texts=2)


def rig_change(rig: str, extended: str) -> str:
    """The lines in which the extended rig differs, as added and removed ones."""
    changed = difflib.unified_diff(
        rig.splitlines(), extended.splitlines(), "rig", "extended.rig.toml", lineterm="", n=3
    )
    shown = []
    for i, line in enumerate(changed):
        text = escaped(line)
        if i < 2 or line.startswith("@@"):
            shown.append(f'<span class="where">{text}</span>')
        else:
            shown.append(
                f"<ins>{text}</ins>" if line.startswith("+") else f"<del>{text}</del>" if line.startswith("-") else text
            )
    if not shown:
        return "<p>It says the same as the rig.</p>"
    lines = "\n".join(shown)
    return f'<pre class="diff" tabindex="0" role="region" aria-label="What changes in the rig">{lines}</pre>'


def _cause(cause: FoundCause, several: bool) -> str:
    mark = "" if cause.material else ", immaterial"
    return f"{escaped(cause.title)}<br><code>{escaped(cause.cause)}</code>{mark}{_joint(cause.joint, several)}"


def _joint(joint: str, several: bool) -> str:
    return f' <span class="ci">in {name(joint)}</span>' if several else ""


def _bar(share: float, text: str = "") -> str:
    """A share as a bar and as a number."""
    wide = min(max(share, 0.0), 1.0)
    bar = f'<span class="bar" aria-hidden="true"><span style="width:{100.0 * wide:.1f}%"></span></span>'
    return f'<span class="share">{bar} {escaped(text or share_text(share))}</span>'
