"""Document of `reproduce`: printed numbers next to ours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from vsalog.report.document import Block, Cell, Document, Facts, Section, Table, Tone, Words
from vsalog.reproduce.catalogue import ITEMS, Item
from vsalog.reproduce.rows import Row, Spread

TONES: Mapping[str, Tone] = {
    "worse": "bad",
    "does not hold": "bad",
    "better": "good",
    "better after the transient": "open",
    "as printed after the transient": "open",
    "within our spread": "open",
    "holds": "good",
}
HEADS = ("settings", "of", "quantity", "printed", "ours", "counted", "whole run", "verdict")


def items_document() -> Document:
    """Return the items that can be reproduced."""
    rows = tuple((item.name, item.title) for item in ITEMS.values())
    return Document("Items", "What can be reproduced", (Table("", ("", ""), rows, texts=2),))


def rows_document(
    items: Sequence[Item], rows: Mapping[str, Sequence[Row]], seeds: Sequence[int], figures: Sequence[Path]
) -> Document:
    """Return a table per item, its conditions, and the reasons where ours is worse."""
    blocks: list[Block] = []
    for item in items:
        own = rows[item.name]
        title = f"{own[0].paper}, {item.title}  ({item.name})"
        blocks.append(Section(title, (_table(own), *map(Words, _remarks(own)))))
    every = [row for own in rows.values() for row in own]
    counts = {v: sum(r.verdict == v for r in every) for v in dict.fromkeys(r.verdict for r in every)}
    summed = f"{len(every)} rows: " + ", ".join(f"{n} {verdict}" for verdict, n in counts.items())
    blocks += [Words(summed), Words("Ours is the median over the seeds, [lowest … highest] where they differ.")]
    blocks += [Facts((("figures", ", ".join(map(str, figures))),))] if figures else []
    data = [{**msgspec.to_builtins(row), "verdict": row.verdict} for row in every]
    return Document("Reproduction", "The papers' numbers next to ours", tuple(blocks), {
        "seeds": list(seeds), "rows": data, "figures": [str(f) for f in figures],
    })  # fmt: skip


def _remarks(rows: Sequence[Row]) -> Iterator[str]:
    for label, texts in (
        ("conditions", (r.conditions for r in rows)),
        ("chosen, not printed", (r.chosen for r in rows)),
        ("conditions differ", (r.differs for r in rows)),
        ("why", _reasons(rows)),
        ("remark", (r.remark for r in rows)),
    ):
        yield from (f"{label}: {text}" for text in dict.fromkeys(filter(None, texts)))


def _reasons(rows: Iterable[Row]) -> Iterator[str]:
    """Yield reasons, each with the rows it is for."""
    groups: dict[str, dict[str, None]] = {}
    for row in rows:
        if row.reason:
            groups.setdefault(row.reason, {})[", ".join(filter(None, (row.settings, row.of)))] = None
    for reason, named in groups.items():
        yield f"{reason} [{'; '.join(named)}]"


def _table(rows: Sequence[Row]) -> Table:
    cells = []
    before = None
    for row in rows:
        quantity = f"{row.quantity} [{row.unit}]" if row.unit else row.quantity
        cells.append((
            row.settings if row.settings != before else "", row.of, quantity, shown(row.printed), shown(row.ours), row.window,
            shown(row.whole_run), Cell(row.verdict, tone=TONES.get(row.verdict, "")),
        ))  # fmt: skip
        before = row.settings
    return Table("", HEADS, tuple(cells), keys=3, texts=3)


def shown(value: float | str | Spread | None) -> str:
    """Return a printed number, a statement or a spread as text; a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return f"{value:.6g}"
    if value.low == value.high:
        return f"{value.median:.3g}"
    return f"{value.median:.3g} [{value.low:.3g} … {value.high:.3g}]"
