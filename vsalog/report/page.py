"""The page of a report: one HTML file that needs nothing else, no network above all.

plotly's script lies in it, compressed, which makes the page a third of its size; a policy in the page forbids every request.
"""

from __future__ import annotations

import base64
import gzip
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from pathlib import Path

from vsalog.report.page_characteristic import characteristic_charts
from vsalog.report.page_charts import Chart
from vsalog.report.page_data import chart_data
from vsalog.report.page_decimate import FIGURE_COLUMNS, one_after_the_other
from vsalog.report.page_errors import error_charts
from vsalog.report.page_figures import convergence_charts, expanded_chart, stiffness_chart, torque_chart
from vsalog.report.page_frame import asset, checksum, framed
from vsalog.report.page_tables import (
    dependences_list,
    facts,
    joint_box,
    modalities_table,
    overview_table,
    scores_table,
    warnings_box,
)
from vsalog.report.page_text import escaped, lines, name, script_json
from vsalog.validation.document import JointReport, Report, TransmissionReport
from vsalog.validation.evidence import JointEvidence
from vsalog.writers.atomic import write_text

POLICY = "default-src 'none'; script-src {scripts} 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:"
"""No other script runs than those whose checksums are named, even if one got in; plotly's surfaces make functions of texts."""

FOOTER = (
    "<p class=keys>Figures: drag to zoom, double-click to see all again. With the keyboard: Tab to a figure, arrow keys move,"
    " + and − zoom, 0 shows all.</p><p>Written by vsalog; figures drawn by plotly.js (MIT licence).</p>"
)


@dataclass(frozen=True, slots=True)
class JointCharts:
    """A joint's figures, by transmission."""

    joint: str
    parts: Mapping[str, Sequence[Chart]]


@dataclass(frozen=True, slots=True)
class Part:
    """A transmission on the page, or a part with a heading (HTML) of its own: HTML before the figures, and the figures."""

    name: str
    html: str
    charts: Sequence[Chart]
    heading: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A joint of a log on the page, or a section with a heading (HTML) of its own; `html` stands before its parts."""

    joint: str
    log: str
    html: str
    parts: Sequence[Part]
    heading: str = ""


def write_page(path: Path, title: str, report: Report | None, drawn: Sequence[Sequence[JointCharts]]) -> None:
    """Write a validation's report as one page.

    Parameters
    ----------
    path : of the page
    title : of it
    report : what was found; without one, only the figures are shown
    drawn : per log, its joints' figures

    Raises
    ------
    WriteError
        The file cannot be written.
    """
    sections, top, bottom = [], "", ""
    if report is not None:
        top, bottom = _verdicts(report), _provenance(report)
    for i, joints in enumerate(drawn):
        log = report.logs[i] if report is not None else None
        found = {} if log is None else {j.joint: j for j in log.joints}
        for joint in joints:
            about = found.get(joint.joint)
            html = "" if about is None else warnings_box(about.warnings) + _length(about)
            parts = [
                Part(part, "" if about is None else _about(about, part), charts) for part, charts in joint.parts.items()
            ]
            sections.append(Section(joint.joint, f"log {i + 1}" if log is None else log.log, html, parts))
    write_text(path, assembled(title, "Validation of a stiffness model", top, sections, bottom))


def columns_for(transmissions: int) -> int:
    """Return the pixel columns per figure that so many transmissions leave to each: a page grows by the root of their number."""
    return math.ceil(FIGURE_COLUMNS / math.sqrt(max(transmissions, 1)))


def joint_charts(joint: JointEvidence, columns: int) -> JointCharts:
    """Return the figures of all transmissions of a joint."""
    return JointCharts(joint.joint, {name: charts_of(joint, name, columns) for name in joint.transmissions})


def charts_of(joint: JointEvidence, name: str, columns: int) -> list[Chart]:
    """Return the figures of a transmission, in the order of the page; several runs follow one another in time."""
    joint = replace(joint, time=one_after_the_other(joint.time))
    part = joint.transmissions[name]
    charts = [torque_chart(joint, part, columns)]
    expanded = expanded_chart(joint, part, columns)
    if expanded is not None:
        charts.append(expanded)
    charts.append(stiffness_chart(joint, part, columns))
    charts += characteristic_charts(joint, name, part)
    charts += error_charts(joint, part)
    if name == next(iter(joint.transmissions)):
        charts += convergence_charts(joint, columns)
    return charts


def assembled(title: str, kind: str, top: str, sections: Sequence[Section], bottom: str) -> str:
    """Return the page's HTML.

    Parameters
    ----------
    title : a plain text
    kind : what the page is, a plain text
    top, bottom : HTML before and after the sections
    sections : one joint of a log each
    """
    body = "".join(_section(i, section) for i, section in enumerate(sections))
    contents = ""
    if len(sections) > 1:
        named = (s.heading or f"{name(s.joint)} in {name(s.log)}" for s in sections)
        links = (f'<li><a href="#s{i}">{heading}</a></li>' for i, heading in enumerate(named))
        contents = f'<nav aria-label="Contents"><ul>{"".join(links)}</ul></nav>'
    scripts = f'<script type="text/plain" id="library">{_library()}</script>\n<script>{asset("page.js")}</script>\n'
    figures = "<noscript><p>The figures need JavaScript; the tables and sentences say the same.</p></noscript>"
    theme = '\n<button id="theme" type="button" hidden>Dark colours</button>'
    return framed(title, kind, _policy(), f"{top}{contents}\n{figures}\n{body}{bottom}", FOOTER, scripts, tools=theme)


def _section(i: int, section: Section) -> str:
    inner = []
    for j, part in enumerate(section.parts):
        key = f"s{i}p{j}"
        title = part.heading or ("" if len(section.parts) == 1 else _part_heading(part.name))
        heading = f'<h3 id="{key}">{title}</h3>' if title else ""
        figures = "".join(_figure(f"{key}f{k}", key, chart) for k, chart in enumerate(part.charts))
        inner.append(f'{heading}{part.html}<div class="figures">{figures}</div>')
    title = section.heading or f"Joint {name(section.joint)} in {name(section.log)}"
    heading = f'<h2 id="s{i}">{title}</h2>'
    return f'<section aria-labelledby="s{i}">{heading}{section.html}{"".join(inner)}</section>'


def _part_heading(part: str) -> str:
    return "Both transmissions together" if part == "total" else f"Transmission {name(part)}"


def _figure(key: str, group: str, chart: Chart) -> str:
    words = escaped(chart.words)
    return (
        f'<figure><h4 id="{key}h">{escaped(chart.title)}</h4>'
        f'<div class="plot" role="img" tabindex="0" data-chart="{key}" data-group="{group}"'
        f' aria-label="{escaped(chart.title)}. {words}"><p class="wait">{escaped(chart.title)} …</p></div>'
        f"<figcaption>{words}</figcaption>"
        f'<script type="application/json" id="{key}">{script_json(chart_data(chart))}</script></figure>'
    )


def _verdicts(report: Report) -> str:
    boxes = "".join(joint_box(joint, log.log) for log in report.logs for joint in log.joints)
    limits = "".join(
        f'<p><span class="verdict {"met" if t.met else "missed"}">{"met" if t.met else "missed"}</span> threshold'
        f" {escaped(t.name.upper())} ≤ {t.limit:g} %</p>"
        for t in report.thresholds
    )
    overall = overview_table(report) if len(report.logs) > 1 else ""
    return f'<section aria-label="Verdict">{overall}{boxes}{limits}</section>'


def _length(joint: JointReport) -> str:
    return f"<p>{joint.duration:.4g} s at {1.0 / joint.period:.4g} Hz.</p>" if joint.period > 0.0 else ""


def _about(joint: JointReport, part: str) -> str:
    found: TransmissionReport | None = next((t for t in joint.transmissions if t.transmission == part), None)
    if found is None:
        return ""
    share = (
        f"<p>{100.0 * found.inside_share:.3g} % of the samples lie inside the region that the model was fitted in.</p>"
    )
    return share + scores_table(found) + dependences_list(found) + modalities_table(found)


def _provenance(report: Report) -> str:
    pairs = [("model", f"{name(report.model)} {_hash(report.model_sha256)}")]
    pairs += [("model learnt from", f"{name(log)} {_hash(digest)}") for log, digest in report.model_logs.items()]
    pairs += [("validated on", f"{name(log.log)} {_hash(log.sha256)}") for log in report.logs]
    pairs += [(escaped(key), f"<code>{escaped(value)}</code>") for key, value in report.settings.items()]
    pairs.append(("vsalog", escaped(report.vsalog)))
    return provenance(pairs, report.rig)


def provenance(pairs: Sequence[tuple[str, str]], rig: str) -> str:
    """Return where it all comes from: pairs of HTML, and the rig as TOML text."""
    return (
        f'<section aria-labelledby="provenance"><h2 id="provenance">Provenance</h2>{facts(pairs)}'
        f"<details><summary>The rig, as TOML</summary><pre tabindex=0>{lines(rig)}</pre></details></section>"
    )


def _hash(digest: str) -> str:
    return f"<code>SHA-256 {escaped(digest)}</code>" if digest else ""


@cache
def _library() -> str:
    """Plotly's script, compressed, as base64."""
    return base64.b64encode(gzip.compress(_plotly(), 6, mtime=0)).decode("ascii")


def _plotly() -> bytes:
    return resources.files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()


@cache
def _policy() -> str:
    """Return the page's content security policy."""
    return POLICY.format(scripts=f"{checksum(asset('page.js').encode())} {checksum(_plotly())}")
