"""The page of a batch: a row per log and joint, to be sorted, with links to what was written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from typing import Any, NamedTuple
from urllib.parse import quote

from vsalog.core.printable import plural
from vsalog.report.page_frame import asset, checksum, framed
from vsalog.report.page_text import escaped, name, number, table

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


class Column(NamedTuple):
    """A figure on the page: its name in a row, its heading, and whether it is a number, and of 1 what is shown in per cent."""

    name: str
    head: str
    numeric: bool
    share: bool


def batch_page(do: str, counts: Mapping[str, int], rows: Iterable[Mapping[str, Any]], columns: Sequence[Column]) -> str:
    """Return the page's HTML.

    Parameters
    ----------
    do : the command that was run
    counts : of logs: done, failed, missed (a threshold)
    rows : of the summary, in its order
    columns : the command's own
    """
    logs = plural(counts["done"] + counts["failed"], "log")
    said = f"{logs}: {counts['done']} done, {counts['failed']} failed."
    if counts["missed"]:
        said += f" {counts['missed']} missed a threshold."
    words = [column for column in columns if not column.numeric]
    numbers = [column for column in columns if column.numeric]
    first = ("log", "joint", "status", "device", "date", *(column.head for column in words), "files", "reason")
    cells = [_cells(row, words, numbers) for row in islice(rows, MOST_ROWS)]
    cut = (
        f"<p>The first {MOST_ROWS} rows; all are in <code>summary.parquet</code>.</p>"
        if len(cells) == MOST_ROWS
        else ""
    )
    shown = table("Logs", (*first, *(column.head for column in numbers), "warnings"), cells, len(first))
    script = asset("sort.js")
    # Only this very script may run, whatever a log is called.
    style = checksum((asset("page.css") + STYLE).encode())
    policy = f"default-src 'none'; script-src {checksum(script.encode())}; style-src {style}; img-src data:"
    foot = "<p>Click a heading to sort by it, again to sort the other way round. Written by vsalog.</p>"
    return framed(logs, do, policy, f"<p>{said}</p>{cut}{shown}", foot, f"<script>{script}</script>", STYLE)


def _cells(row: Mapping[str, Any], words: Sequence[Column], numbers: Sequence[Column]) -> list[str]:
    """Return a row's cells as HTML, first those of words."""
    log, kind, warnings = name(row["log"]), "met" if row["status"] == "done" else "missed", row["warnings"]
    items = "".join(f"<li>{escaped(warning)}</li>" for warning in warnings)
    return [
        _link(row["report"], log) if row["report"] else log,
        name(row["joint"] or ""),
        f'<span class="verdict {kind}">{escaped(row["status"])}</span>',
        name(row["device"] or ""),
        escaped(row["date"] or ""),
        *(escaped(_word(row.get(column.name))) for column in words),
        ", ".join(_link(row[what], label) for what, label in _LABELS.items() if row[what]),
        escaped(row["reason"] or ""),
        *(_number(row.get(column.name), column.share) for column in numbers),
        f"<details><summary>{len(warnings)}</summary><ul>{items}</ul></details>" if warnings else "",
    ]


def _word(value: Any) -> str:
    return ", ".join(str(cause["cause"]) for cause in value) if isinstance(value, list) else str(value or "")


def _number(value: float | None, share: bool) -> str:
    return "" if value is None else number(100.0 * value if share else value, 4)


def _link(file: str, label: str) -> str:
    """Return a link to a file of the batch: the percent signs of its name are part of it; `label` is HTML."""
    return f'<a href="{escaped(quote(file, safe="/"))}">{label}</a>'
