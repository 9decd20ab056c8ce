"""`index.html`: a row per log and joint, to be sorted, with links to what was written."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any
from urllib.parse import quote

from vsalog.batch.records import Do, Record
from vsalog.batch.summary import rows_of
from vsalog.core.printable import plural
from vsalog.report.page_text import escaped, name, number

NAME = "index.html"
MOST_ROWS = 20_000
"""Rows of the page, 10 MB: with more a browser is slow, and the table is there to be queried."""

# A click sorts by what a cell's data-v says, numbers as numbers; a second one the other way round. What has no value comes last.
SCRIPT = """
(() => {
  const table = document.querySelector("table.logs");
  if (!table) return;
  const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
  const value = (row, i) => { const cell = row.cells[i]; return cell.dataset.v ?? cell.textContent; };
  heads.forEach((head, i) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1, numeric = head.classList.contains("n");
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
      const rows = [...body.rows].map((row) => [value(row, i), row]);
      rows.sort(([a], [b]) => {
        if (a === "" || b === "") return (a === "") - (b === "");
        return way * (numeric ? a - b : a < b ? -1 : a > b ? 1 : 0);
      });
      body.append(...rows.map(([, row]) => row));
    });
  });
})();
"""
STYLE = """
main { max-width: none; }
.logs thead th { position: sticky; top: 0; background: var(--paper); }
.logs thead button { border: 0; background: none; padding: 0; color: inherit; font: inherit; font-weight: 600; text-align: left; }
.logs thead th[aria-sort="ascending"] button::after { content: " ▲"; }
.logs thead th[aria-sort="descending"] button::after { content: " ▼"; }
.logs td.reason { min-width: 18rem; max-width: 40rem; overflow-wrap: anywhere; }
.logs th[scope="row"] { max-width: 28rem; overflow-wrap: anywhere; }
"""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the page: its heading, what it shows, and whether that is a number."""

    head: str
    key: str
    numeric: bool = False
    digits: int = 3
    percent: bool = False


LAST = (Column("warnings", "warnings", True), Column("files", "files"), Column("reason", "reason"))
COLUMNS: dict[Do, tuple[Column, ...]] = {
    "estimate": (
        Column("estimator", "estimator"),
        Column("duration [s]", "duration", True, 4),
        Column("stiffness, 1 % [N·m/rad]", "stiffness_low", True, 4),
        Column("99 % [N·m/rad]", "stiffness_high", True, 4),
        Column("± (1 std) [%]", "relative_std", True, percent=True),
        Column("RMS residual [%]", "fit_share", True, percent=True),
        Column("excited [%]", "excited_share", True, percent=True),
    ),
    "validate": (
        Column("verdict", "verdict"),
        Column("judged by", "judged_on"),
        Column("NRMSE [%]", "nrmse", True),
        Column("MSREP [%]", "msrep", True),
        Column("R²", "r2", True, 4),
        Column("inside the region [%]", "inside_share", True, percent=True),
    ),
    "diagnose": (
        Column("verdict", "verdict"),
        Column("causes", "causes"),
        Column("unexplained [%]", "unexplained", True, percent=True),
    ),
}
FIRST = (Column("joint", "joint"), Column("status", "status"), Column("device", "device"), Column("date", "date"))
_LABELS = {"report": "report", "trace": "trace", "model": "model", "document": "data", "rig": "extended rig"}


def index_page(records: Sequence[Record], do: Do) -> str:
    """Return the page's HTML.

    Parameters
    ----------
    records : sorted by log
    do : the command that was run
    """
    columns = (*FIRST, *COLUMNS[do], *LAST)
    logs = plural(len(records), "log")
    bad = sum(r.status == "failed" for r in records)
    missed = sum(not r.met for r in records)
    counts = f"{logs}: {len(records) - bad} done, {bad} failed."
    if missed:
        counts += f" {missed} missed a threshold."
    rows, cut = [], ""
    for i, row in enumerate(rows_of(records)):
        if i == MOST_ROWS:
            cut = f"<p>The first {MOST_ROWS} rows; all are in <code>summary.parquet</code>.</p>"
            break
        rows.append(f"<tr>{''.join(_cells(row, columns))}</tr>")
    heads = "".join(f'<th scope="col"{" class=n" if c.numeric else ""}>{escaped(c.head)}</th>' for c in columns)
    style = resources.files("vsalog.report").joinpath("templates", "page.css").read_text(encoding="utf-8") + STYLE
    # Only this very script may run, whatever a log is called.
    policy = f"default-src 'none'; script-src '{_hash(SCRIPT)}'; style-src '{_hash(style)}'; img-src data:"
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
            f"<main><p>{counts}</p>{cut}",
            '<div class="scroll" tabindex="0" role="region" aria-label="Logs"><table class="logs">',
            f'<thead><tr><th scope="col">log</th>{heads}</tr></thead>',
            f"<tbody>{''.join(rows)}</tbody></table></div></main>",
            "<footer><p>Click a heading to sort by it, again to sort the other way round. Written by vsalog.</p></footer>",
            f"<script>{SCRIPT}</script></body></html>\n",
        )
    )


def _cells(row: dict[str, Any], columns: Iterable[Column]) -> Iterator[str]:
    log = name(row["log"])
    shown = f'<a href="{_link(row["report"])}">{log}</a>' if row["report"] else log
    yield f'<th scope="row" data-v="{escaped(row["log"])}">{shown}</th>'
    for column in columns:
        yield _cell(row, column)


def _cell(row: dict[str, Any], column: Column) -> str:
    value = row.get(column.key)
    if column.key == "files":
        there = [what for what in _LABELS if row[what]]
        links = ", ".join(f'<a href="{_link(row[what])}">{_LABELS[what]}</a>' for what in there)
        return f'<td data-v="{len(there)}">{links}</td>'
    if column.key == "warnings":
        if not value:
            return '<td class="n" data-v="0"></td>'
        said = "".join(f"<li>{escaped(w)}</li>" for w in value)
        return f'<td data-v="{len(value)}"><details><summary>{len(value)}</summary><ul>{said}</ul></details></td>'
    if column.key == "status":
        kind = "met" if value == "done" else "missed"
        return f'<td><span class="verdict {kind}">{escaped(str(value))}</span></td>'
    if column.key == "causes":
        value = ", ".join(str(c["cause"]) for c in value or ())
    if column.key == "reason":
        return f'<td class="reason">{escaped(str(value or ""))}</td>'
    if column.numeric:
        if value is None:
            return '<td class="n" data-v=""></td>'
        value = 100.0 * value if column.percent else value
        return f'<td class="n" data-v="{float(value)!r}">{number(float(value), column.digits)}</td>'
    if value is None:
        return '<td data-v=""></td>'
    return f"<td>{name(str(value)) if column.key in ('joint', 'device') else escaped(str(value))}</td>"


def _link(file: str) -> str:
    """Return a file's name in the batch as a link: its percent signs are part of the name."""
    return escaped(quote(file, safe="/"))


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
