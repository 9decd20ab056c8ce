"""Writes docs/reference/causes from the classes of the catalogue: ``python docs/make_causes.py``."""

from pathlib import Path

from vsalog.report.explain import Explanation, explained_causes

FOLDER = Path(__file__).parent / "reference" / "causes"
HEAD = """# Causes

Written by `python docs/make_causes.py` from the classes in `vsalog/diagnosis/causes`; `vsalog explain CAUSE` prints the
texts of these pages. [Diagnosis](../../explanation/diagnosis.md) explains how causes are distinguished from one another.
"""
SIDES = {
    "motor": "Motor",
    "drive": "Drive",
    "transmission": "Transmission",
    "link": "Link",
    "sensor": "Sensors",
    "pneumatic": "Muscles",
}


def entry(found: Explanation) -> list[str]:
    """Return what a page has of a cause."""
    facts = [f"- {what}: {fact}" for what, fact in found.facts.items()]
    return [f"## {found.name}", "", *found.texts, "", *facts, ""]


def page(side: str) -> str:
    """Return the causes of a side as Markdown."""
    own = [entry(found) for name, found in explained_causes().items() if name.startswith(f"{side}.")]
    return "\n".join([f"# Causes: {SIDES[side]}", "", *(line for lines in own for line in lines)])


def index() -> str:
    """Return the list of causes by side."""
    parts = [HEAD, "| side | causes |", "| --- | --- |"]
    for side, heading in SIDES.items():
        names = [name for name in explained_causes() if name.startswith(f"{side}.")]
        links = ", ".join(f"[{name.partition('.')[2]}]({side}.md#{name.replace('.', '')})" for name in names)
        parts.append(f"| [{heading}]({side}.md) | {links} |")
    return "\n".join([*parts, "", "```{toctree}", ":hidden:", "", *SIDES, "```", ""])


def pages() -> dict[str, str]:
    """Return the catalogue: name of a page → Markdown."""
    return {"index": index(), **{side: page(side) for side in SIDES}}


if __name__ == "__main__":
    for stem, text in pages().items():
        (FOLDER / f"{stem}.md").write_text(text, encoding="utf-8")
