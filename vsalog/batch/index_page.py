"""`index.html`: a row per log and joint, to be sorted, with links to what was written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any
from urllib.parse import quote

from vsalog.batch.records import Do, Record
from vsalog.batch.summary import rows_of
from vsalog.core.printable import plural
from vsalog.report.document import TONES, Block, Cell, Document, Table, Words
from vsalog.report.html import page_of
from vsalog.report.page_text import number

NAME = "index.html"
MOST_ROWS = 20_000
"""Rows of the page, 10 MB: with more a browser is slow, and the table is there to be queried."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of numbers: its heading, what it shows, and with how many digits."""

    head: str
    key: str
    digits: int = 3
    percent: bool = False


NUMBERS: dict[Do, tuple[Column, ...]] = {
    "estimate": (
        Column("duration [s]", "duration", 4),
        Column("stiffness, 1 % [N·m/rad]", "stiffness_low", 4),
        Column("99 % [N·m/rad]", "stiffness_high", 4),
        Column("± (1 std) [%]", "relative_std", percent=True),
        Column("RMS residual [%]", "fit_share", percent=True),
        Column("excited [%]", "excited_share", percent=True),
    ),
    "validate": (
        Column("NRMSE [%]", "nrmse"),
        Column("MSREP [%]", "msrep"),
        Column("R²", "r2", 4),
        Column("inside the region [%]", "inside_share", percent=True),
    ),
    "diagnose": (Column("unexplained [%]", "unexplained", percent=True),),
}
TEXTS: dict[Do, tuple[tuple[str, str], ...]] = {
    "estimate": (("estimator", "estimator"),),
    "validate": (("verdict", "verdict"), ("judged by", "judged_on")),
    "diagnose": (("verdict", "verdict"), ("causes", "causes")),
}
FIRST = (("joint", "joint"), ("device", "device"), ("date", "date"))
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
    missed = sum(not r.met for r in records)
    counts = f"{logs}: {len(records) - bad} done, {bad} failed."
    if missed:
        counts += f" {missed} missed a threshold."
    texts = (*FIRST, *TEXTS[do])
    heads = ["log", "status", *(head for head, _ in texts), "warnings", "files", *(c.head for c in NUMBERS[do])]
    rows = tuple(tuple(_cells(row, texts, do)) for row in islice(rows_of(records), MOST_ROWS))
    table = Table("Logs", tuple(heads), rows, texts=len(heads) - len(NUMBERS[do]), sortable=True)
    items: list[Block] = [
        Words(counts),
        Words("Click a heading to sort by it, again to sort the other way round."),
        table,
    ]
    if len(rows) == MOST_ROWS:
        items.insert(1, Words(f"The first {MOST_ROWS} rows; all are in summary.parquet."))
    return page_of(Document(logs, do, tuple(items)))


def _cells(row: dict[str, Any], texts: Sequence[tuple[str, str]], do: Do) -> Iterator[Cell]:
    report = row["report"]
    yield Cell(
        "" if report else row["log"], value=row["log"], links=((row["log"], quote(report, safe="/")),) if report else ()
    )
    yield Cell(row["status"], tone="good" if row["status"] == "done" else "bad")
    for _, key in texts:
        value = row.get(key)
        if key == "causes":
            value = ", ".join(str(cause["cause"]) for cause in value or ())
        yield Cell("" if value is None else str(value), tone=TONES[value] if key == "verdict" and value else "")
    # What a log failed of comes first; then what a person should know.
    first, *more = [*filter(None, [row.get("reason")]), *row["warnings"]] or [""]
    yield Cell(first, value=len(more) + bool(first), more=tuple(more))
    there = [what for what in _LABELS if row[what]]
    # A file's percent signs are part of its name.
    yield Cell("", value=len(there), links=tuple((_LABELS[what], quote(row[what], safe="/")) for what in there))
    for column in NUMBERS[do]:
        value = row.get(column.key)
        if value is None:
            yield Cell("", value="")
        else:
            value = 100.0 * value if column.percent else value
            yield Cell(number(float(value), column.digits), value=float(value))
