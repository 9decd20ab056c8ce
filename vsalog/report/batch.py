"""Documents of `batch`: its outcome, and a page with a row per log and joint, with links to the results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, NamedTuple
from urllib.parse import quote

from vsalog.core.notation import duration, number
from vsalog.core.printable import plural
from vsalog.report.document import TONES, Block, Cell, Document, Facts, Table, Words
from vsalog.report.html import page_of

MOST_ROWS = 20_000
"""Rows of the page, 10 MB: with more a browser is slow; the table can be queried instead."""

FIRST = ("joint", "device", "date")
_LABELS = {"report": "report", "trace": "trace", "model": "model", "document": "data", "rig": "extended rig"}


class Column(NamedTuple):
    """A figure on the page: its name in a row, its heading, and whether it is a number and is shown in per cent."""

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
    summary = f"{logs}: {counts['done']} done, {counts['failed']} failed."
    if counts["missed"]:
        summary += f" {counts['missed']} missed a threshold."
    words = [column for column in columns if not column.numeric]
    numbers = [column for column in columns if column.numeric]
    texts = ("log", "status", *FIRST, *(column.head for column in words), "warnings", "files")
    cells = tuple(tuple(_cells(row, words, numbers)) for row in islice(rows, MOST_ROWS))
    heads = (*texts, *(column.head for column in numbers))
    items: list[Block] = [Words(summary), Words("Click a heading to sort by it, again to reverse the order.")]
    if len(cells) == MOST_ROWS:
        items.append(Words(f"The first {MOST_ROWS} rows; all are in summary.parquet."))
    return page_of(Document(logs, do, (*items, Table("Logs", heads, cells, texts=len(texts), sortable=True))))


def outcome_document(found: Mapping[str, Any]) -> Document:
    """Return the outcome of a batch.

    Parameters
    ----------
    found : as `vsalog.batch.outcome.Outcome` has it
    """
    shares, missed, places = found["shares"], len(found["missed"]), found["outputs"]
    before = f" ({found['kept']} of them before)" if found["kept"] else ""
    done = f"{found['done']} done{before}, {len(found['failed'])} failed"
    lines = [f"{plural(found['logs'], 'log')} in {duration(found['seconds'])}: {done}"]
    if shares["logs"] > found["logs"]:
        lines.append(f"of all shares {shares['finished']} of {plural(shares['logs'], 'log')} finished")
    if missed:
        lines.append(f"{plural(missed, 'log')} missed the threshold")
    files = {"data set": places["traces"]} if found["do"] == "estimate" else {}
    files |= {"table": places["summary"], "page": places["page"]}
    return Document("Batch", found["do"], (*map(Words, lines), Facts(tuple(files.items()))), found)


def failure_words(found: Mapping[str, Any]) -> str:
    """Return how many logs failed, and which files give the reasons; nothing where none did."""
    bad, places = len(found["failed"]), found["outputs"]
    listed = f"{places['page']} and {places['summary']} list them with the reasons"
    return f"vsalog: {bad} of {plural(found['logs'], 'log')} failed; {listed}" if bad else ""


def _cells(row: Mapping[str, Any], words: Sequence[Column], numbers: Sequence[Column]) -> Iterator[Cell]:
    log, report = row["log"], row["report"]
    yield Cell("" if report else log, value=log, links=(_link(log, report),) if report else ())
    yield Cell(row["status"], tone="good" if row["status"] == "done" else "bad")
    for name in FIRST:
        yield Cell(row[name] or "")
    for column in words:
        word = _word(row.get(column.name))
        yield Cell(word, tone=TONES[word] if column.name == "verdict" and word else "")
    # The reason of a failure comes first, then findings.
    first, *more = [*filter(None, [row["reason"]]), *row["warnings"]] or [""]
    yield Cell(first, value=len(more) + bool(first), more=tuple(more))
    links = tuple(_link(label, row[what]) for what, label in _LABELS.items() if row[what])
    yield Cell("", value=len(links), links=links)
    for column in numbers:
        value = row.get(column.name)
        if value is None:
            yield Cell("", value="")
        else:
            shown = 100.0 * value if column.share else float(value)
            yield Cell(number(shown, 4), value=shown)


def _word(value: Any) -> str:
    return ", ".join(str(cause["cause"]) for cause in value) if isinstance(value, list) else str(value or "")


def _link(label: str, file: str) -> tuple[str, str]:
    """Return a link to a file of the batch: the percent signs of its name are part of it."""
    return label, quote(file, safe="/")
