"""Writes the tables of docs/performance/papers from the stored numbers: ``python -m docs.make_reproduce``.

The numbers, docs/reproduce.json, are those of a run: ``vsalog reproduce --json > numbers.json`` and then
``python -m docs.make_reproduce numbers.json`` stores them and writes the tables. A run of some items replaces those alone.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from vsalog.reproduce.catalogue import ITEMS

Row = Mapping[str, Any]

FOLDER = Path(__file__).parent
PAGES, NUMBERS = FOLDER / "performance" / "papers", FOLDER / "reproduce.json"
FIELDS = (
    "item", "place", "quantity", "unit", "of", "settings", "printed", "ours", "whole_run", "window", "verdict", "reproducible",
)  # fmt: skip
SIGNS = {
    "better": "+",
    "better after the transient": "(+)",
    "as printed": "=",
    "as printed after the transient": "(=)",
    "within our spread": "~",
    "worse": "**−**",
    "below, conditions differ": "<",
    "above, conditions differ": ">",
    "holds": "holds",
    "does not hold": "**does not hold**",
    "not compared": "",
}
MARKED = re.compile(r"(<!-- table: (?P<what>\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def stored(rows: Sequence[Row], before: Sequence[Row]) -> str:
    """Return what is kept, a row a line: the rows of a run, and of what it leaves out those from before."""
    items: dict[str, list[Row]] = {}
    for row in rows:
        items.setdefault(row["item"], []).append(row)
    kept = [row for row in before if row["item"] not in items]
    every = [row for name in ITEMS for row in items.get(name, [r for r in kept if r["item"] == name])]
    lines = [json.dumps({name: row[name] for name in FIELDS}, ensure_ascii=False) for row in every]
    return '{"rows": [\n' + ",\n".join(lines) + "\n]}\n"


def page(text: str, rows: Sequence[Row]) -> str:
    """Return the page with its tables written again."""

    def written(found: re.Match[str]) -> str:
        what = found["what"]
        lines = summary(rows) if what == "verdicts" else table([row for row in rows if row["item"] == what])
        return found[1] + "\n" + "\n".join(lines) + "\n\n" + found[3]

    return MARKED.sub(written, text)


def summary(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table of the verdicts, their signs and how many rows have them."""
    yield "| verdict | in the tables | rows |"
    yield "| --- | --- | --- |"
    for verdict, sign in SIGNS.items():
        yield f"| {verdict} | {sign} | {sum(row['verdict'] == verdict for row in rows)} |"


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the rows of an item: one line per quantity, one column per setting."""
    settings = list(dict.fromkeys(row["settings"] for row in rows))
    lines: dict[tuple[str, ...], dict[str, Row]] = {}
    for row in rows:
        unit = f" [{row['unit']}]" if row["unit"] else ""
        key = (row["place"], row["of"], f"{row['quantity']}{unit}", row["window"])
        lines.setdefault(key, {})[row["settings"]] = row
    heads = ("place", "of", "quantity", "counted", "printed", *settings)
    varied = [len({key[i] for key in lines}) > 1 for i in range(4)]
    first = next(iter(lines))
    same = [f"{head}: {first[i]}" for i, head in enumerate(heads[:4]) if first[i] and not varied[i]]
    if same:
        text = "; ".join(same)
        yield text[0].upper() + text[1:] + "."
        yield ""
    shown = [head for i, head in enumerate(heads) if i >= 4 or varied[i]]
    yield "| " + " | ".join(shown) + " |"
    yield "| " + " | ".join("---" for _ in shown) + " |"
    for key, by in lines.items():
        own = [text for text, vary in zip(key, varied, strict=True) if vary]
        printed = next(iter(by.values()))["printed"]
        cells = [cell(by[s]) if s in by else "" for s in settings]
        yield "| " + " | ".join((*own, number(printed, 6), *cells)) + " |"


def cell(row: Row) -> str:
    """Return our number, that of the whole run after a stroke, and the verdict's sign."""
    ours, whole = row["ours"], row["whole_run"]
    text = number(ours if not isinstance(ours, dict) else ours["median"])
    if whole is not None:
        text += f" / {number(whole['median'])}"
    return f"{text} {SIGNS[row['verdict']]}".strip()


def number(value: str | float | None, digits: int = 3) -> str:
    """Return a number rounded to significant digits, a statement as it is, and a dash for none."""
    if value is None:
        return "–"
    return value.replace("|", "\\|") if isinstance(value, str) else f"{value:.{digits}g}"


def main(arguments: Sequence[str]) -> None:
    """Store the numbers of a run, where one is named, and write the tables."""
    if arguments:
        before = json.loads(NUMBERS.read_text(encoding="utf-8"))["rows"] if NUMBERS.exists() else []
        run = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))["rows"]
        NUMBERS.write_text(stored(run, before), encoding="utf-8")
    rows = json.loads(NUMBERS.read_text(encoding="utf-8"))["rows"]
    for path in PAGES.glob("*.md"):
        path.write_text(page(path.read_text(encoding="utf-8"), rows), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
