"""The names in a table's header, and its texts in messages."""

from __future__ import annotations

from vsalog.core.printable import printable


def unique_names(names: list[str]) -> list[str]:
    """Return names for all columns: ``column_3`` for an empty one, ``x#2`` for the second ``x``."""
    taken: dict[str, int] = {}
    result = []
    for i, name in enumerate(names):
        name = printable(name).strip() or f"column_{i}"
        taken[name] = taken.get(name, 0) + 1
        result.append(name if taken[name] == 1 else f"{name}#{taken[name]}")
    return result


def printable_cell(text: str) -> str:
    """Return a cell or line for a message: short, without anything that could disturb a terminal."""
    text = printable(text)
    return text if len(text) <= 40 else text[:39] + "…"
