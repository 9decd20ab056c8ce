"""What `reproduce` says: printed numbers next to ours as tables on stdout, or as one JSON document."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from rich.table import Table
from rich.text import Text

from vsalog.report.console import console_for_stdout
from vsalog.reproduce.catalogue import ITEMS, Item
from vsalog.reproduce.rows import Row, Spread

# Verdicts are words first; the colour only helps to find them.
STYLES = {"worse": "red", "does not hold": "red", "better": "green", "holds": "green", "not there yet": "yellow"}


def print_items() -> None:
    """List what there is to reproduce."""
    console = console_for_stdout()
    width = max(map(len, ITEMS))
    for item in ITEMS.values():
        console.print(f"{item.name.ljust(width)}  {item.title}", soft_wrap=True)


def print_rows(items: Sequence[Item], rows: Mapping[str, Sequence[Row]], figures: Sequence[Path]) -> None:
    """Print a table per item, what it was found under, and the reasons where ours is worse."""
    console = console_for_stdout()
    for item in items:
        own = rows[item.name]
        console.print(Text(f"{own[0].paper}, {item.title}  ({item.name})", style="bold"))
        console.print(_table(own))
        for label, texts in (
            ("conditions", (r.conditions for r in own)),
            ("chosen, not printed", (r.chosen for r in own)),
            ("why", _reasons(own)),
            ("remark", (r.remark for r in own)),
        ):
            for text in dict.fromkeys(t for t in texts if t):
                console.print(f"  {label}: {text}")
        console.print()
    every = [row for item in items for row in rows[item.name]]
    counts = {v: sum(r.verdict == v for r in every) for v in dict.fromkeys(r.verdict for r in every)}
    console.print(f"{len(every)} rows: " + ", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    console.print("Ours is the median over the seeds, [lowest … highest] where they differ.")
    if figures:
        console.print(f"figures: {', '.join(map(str, figures))}", soft_wrap=True)


def _reasons(rows: Iterable[Row]) -> Iterable[str]:
    """Reasons, each with the rows it is for."""
    groups: dict[str, list[str]] = {}
    for row in rows:
        if row.reason:
            groups.setdefault(row.reason, []).append(_short(row))
    for reason, of in groups.items():
        named = "; ".join(dict.fromkeys(of))
        yield f"{reason} [{named}]"


def _short(row: Row) -> str:
    return ", ".join(part for part in (row.settings, row.of) if part)


def _table(rows: Sequence[Row]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("settings", overflow="fold")
    table.add_column("of", overflow="fold")
    table.add_column("quantity", overflow="fold")
    table.add_column("printed", justify="right", overflow="fold", max_width=40)
    table.add_column("ours", justify="right", overflow="fold")
    table.add_column("counted", overflow="fold")
    table.add_column("whole run", justify="right", overflow="fold")
    table.add_column("verdict", overflow="fold")
    before = None
    for row in rows:
        unit = f" [{row.unit}]" if row.unit else ""
        table.add_row(
            Text(row.settings if row.settings != before else ""),
            Text(row.of),
            Text(row.quantity + unit),
            Text(shown(row.printed)),
            Text(shown(row.ours)),
            Text(row.window),
            Text(shown(row.whole_run)),
            Text(row.verdict, style=STYLES.get(row.verdict, "")),
        )
        before = row.settings
    return table


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


def as_document(rows: Mapping[str, Sequence[Row]], seeds: Sequence[int], figures: Sequence[Path]) -> str:
    """Return the rows as JSON; numbers that are not finite become null."""
    every = [{**msgspec.to_builtins(row), "verdict": row.verdict} for own in rows.values() for row in own]
    document = {"seeds": list(seeds), "rows": every, "figures": [str(f) for f in figures]}
    return json.dumps(_finite(document), indent=2, ensure_ascii=False, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    return [_finite(v) for v in value] if isinstance(value, list) else value
