"""The tables of a report: scores, dependences, modalities, an estimate's key figures; as HTML."""

from __future__ import annotations

from collections.abc import Sequence

from vsalog.report.page_text import escaped


def warnings_box(warnings: Sequence[str]) -> str:
    """What a person should know."""
    if not warnings:
        return ""
    items = "".join(f"<li>{escaped(w)}</li>" for w in warnings)
    return f'<div class="warnings" role="note"><p><strong>Warnings</strong></p><ul>{items}</ul></div>'


def facts(pairs: Sequence[tuple[str, str]]) -> str:
    """Names and values as a list of definitions; both HTML."""
    return "<dl>" + "".join(f"<dt>{key}</dt><dd>{value}</dd>" for key, value in pairs) + "</dl>"
