"""The page of a report: one HTML file that needs nothing else, no network above all.

plotly's script lies in it, compressed, which makes the page a third of its size; a policy in the page forbids every request.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

from vsalog.report.page_charts import Chart
from vsalog.report.page_data import chart_data
from vsalog.report.page_tables import (
    facts,
)
from vsalog.report.page_text import escaped, lines, name, script_json

POLICY = "default-src 'none'; script-src {scripts} 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:"
"""No other script runs than those whose checksums are named, even if one got in; plotly's surfaces make functions of texts."""

FOOTER = (
    "<p class=keys>Figures: drag to zoom, double-click to see all again. With the keyboard: Tab to a figure, arrow keys move,"
    " + and − zoom, 0 shows all.</p><p>Written by vsalog; figures drawn by plotly.js (MIT licence).</p>"
)


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
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_policy()}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            f"<title>{escaped(title)}</title>",
            f"<style>{_asset('page.css')}</style></head><body>",
            '<a class="skip" href="#main">Skip to the report</a>',
            f'<header><div><h1>{escaped(title)}</h1><p class="kind">{escaped(kind)}</p></div>',
            '<button id="theme" type="button" hidden>Dark colours</button></header>',
            f'<main id="main" tabindex="-1">{top}{contents}',
            "<noscript><p>The figures need JavaScript; the tables and sentences say the same.</p></noscript>",
            f"{body}{bottom}</main>",
            f"<footer>{FOOTER}</footer>",
            f'<script type="text/plain" id="library">{_library()}</script>',
            f"<script>{_asset('page.js')}</script>",
            "</body></html>\n",
        )
    )


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


def provenance(pairs: Sequence[tuple[str, str]], rig: str) -> str:
    """Return where it all comes from: pairs of HTML, and the rig as TOML text."""
    return (
        f'<section aria-labelledby="provenance"><h2 id="provenance">Provenance</h2>{facts(pairs)}'
        f"<details><summary>The rig, as TOML</summary><pre tabindex=0>{lines(rig)}</pre></details></section>"
    )


def _asset(file: str) -> str:
    return resources.files("vsalog.report").joinpath("templates", file).read_text(encoding="utf-8")


@cache
def _library() -> str:
    """Plotly's script, compressed, as base64."""
    return base64.b64encode(gzip.compress(_plotly(), 6, mtime=0)).decode("ascii")


def _plotly() -> bytes:
    return resources.files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()


@cache
def _policy() -> str:
    """Return the page's content security policy."""
    scripts = (_asset("page.js").encode(), _plotly())
    digests = (base64.b64encode(hashlib.sha256(script).digest()).decode("ascii") for script in scripts)
    return POLICY.format(scripts=" ".join(f"'sha256-{digest}'" for digest in digests))
