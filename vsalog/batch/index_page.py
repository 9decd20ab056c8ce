"""`index.html`: a row per log and joint, to be sorted, with links to what was written."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib import resources
from itertools import islice
from typing import Any
from urllib.parse import quote

from vsalog.batch.records import Do, Record
from vsalog.batch.summary import FIGURES, NUMBER, Figure, rows_of
from vsalog.core.printable import plural
from vsalog.report.page_text import escaped, name, number, table

NAME = "index.html"
MOST_ROWS = 20_000
"""Rows of the page, 10 MB: with more a browser is slow, and the table is there to be queried."""

STYLE = """
main { max-width: none; }
thead th { position: sticky; top: 0; background: var(--paper); }
thead button { border: 0; background: none; padding: 0; color: inherit; font: inherit; font-weight: 600; text-align: left; }
thead th[aria-sort="ascending"] button::after { content: " ▲"; }
thead th[aria-sort="descending"] button::after { content: " ▼"; }
"""
_LABELS = {"report": "report", "trace": "trace", "model": "model", "document": "data", "rig": "extended rig"}


def index_page(records: Sequence[Record], do: Do) -> str:
    """Return the page's HTML.

    Parameters
    ----------
    records : sorted by log
    do : the command that was run
    """
    logs = plural(len(records), "log")
    bad = sum(r.status == "failed" for r in records)
    counts = f"{logs}: {len(records) - bad} done, {bad} failed."
    if missed := sum(not r.met for r in records):
        counts += f" {missed} missed a threshold."
    figures = [figure for figure in FIGURES[do] if figure.head]
    words = [figure for figure in figures if figure.kind != NUMBER]
    numbers = [figure for figure in figures if figure.kind == NUMBER]
    first = ("log", "joint", "status", "device", "date", *(figure.head for figure in words), "files", "reason")
    rows = [_cells(row, words, numbers) for row in islice(rows_of(records), MOST_ROWS)]
    cut = (
        f"<p>The first {MOST_ROWS} rows; all are in <code>summary.parquet</code>.</p>" if len(rows) == MOST_ROWS else ""
    )
    shown = table("Logs", (*first, *(figure.head for figure in numbers), "warnings"), rows, len(first))
    style, script = _asset("page.css") + STYLE, _asset("sort.js")
    # Only this very script may run, whatever a log is called.
    policy = f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; img-src data:"
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            f"<title>vsalog {do}: {logs}</title>",
            f"<style>{style}</style></head><body>",
            f'<header><div><h1>{logs}</h1><p class="kind">{do}</p></div></header>',
            f"<main><p>{counts}</p>{cut}{shown}</main>",
            "<footer><p>Click a heading to sort by it, again to sort the other way round. Written by vsalog.</p></footer>",
            f"<script>{script}</script></body></html>\n",
        )
    )


def _cells(row: dict[str, Any], words: Sequence[Figure], numbers: Sequence[Figure]) -> list[str]:
    """Return a row's cells as HTML, first those of words."""
    log, kind, warnings = name(row["log"]), "met" if row["status"] == "done" else "missed", row["warnings"]
    items = "".join(f"<li>{escaped(warning)}</li>" for warning in warnings)
    return [
        _link(row["report"], log) if row["report"] else log,
        name(row["joint"] or ""),
        f'<span class="verdict {kind}">{escaped(row["status"])}</span>',
        name(row["device"] or ""),
        escaped(row["date"] or ""),
        *(escaped(_word(row.get(figure.name))) for figure in words),
        ", ".join(_link(row[what], label) for what, label in _LABELS.items() if row[what]),
        escaped(row["reason"] or ""),
        *(_number(row.get(figure.name), figure) for figure in numbers),
        f"<details><summary>{len(warnings)}</summary><ul>{items}</ul></details>" if warnings else "",
    ]


def _word(value: Any) -> str:
    return ", ".join(str(cause["cause"]) for cause in value) if isinstance(value, list) else str(value or "")


def _number(value: float | None, figure: Figure) -> str:
    if value is None:
        return ""
    return number(100.0 * value if figure.head.endswith("[%]") and figure.unit != "%" else value, 4)


def _link(file: str, label: str) -> str:
    """Return a link to a file of the batch: the percent signs of its name are part of it; `label` is HTML."""
    return f'<a href="{escaped(quote(file, safe="/"))}">{label}</a>'


def _asset(file: str) -> str:
    return resources.files("vsalog.report").joinpath(file).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
