"""Texts on a page: everything that comes out of a log or a rig is hostile until it went through here."""

from __future__ import annotations

import html
import json
import math
import unicodedata
from collections.abc import Sequence
from typing import Any


def plain(text: str) -> str:
    """Return a text without what could act on a reader: control, format and surrogate characters become visible."""
    return "".join("�" if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp") else c for c in text)


def escaped(text: str) -> str:
    """Return a text as HTML, for elements and for attributes in quotes."""
    return html.escape(plain(text), quote=True)


def lines(text: str) -> str:
    """Return a text of several lines as HTML."""
    return "\n".join(escaped(line) for line in text.split("\n"))


def label(text: str) -> str:
    """Return a text for plotly, whose labels know some tags of their own; it turns entities back into characters."""
    return html.escape(plain(text), quote=False)


def name(text: str) -> str:
    """Return a name as HTML that neither its letters' direction nor its length disturbs."""
    return f'<bdi class="name">{escaped(text)}</bdi>'


def script_json(data: Any) -> str:
    """Return data as JSON that can stand in a script element: it holds no character that HTML reads."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], texts: int = 1) -> str:
    """Return a table as HTML in a box that scrolls by itself; its rows become small grids where the page is too narrow for it.

    Parameters
    ----------
    caption, heads : plain texts
    rows : of cells, HTML; the first of each is its head
    texts : columns that hold words; the others hold numbers
    """
    if not rows:
        return ""
    kinds = ["" if i < texts else ' class="n"' for i in range(len(heads))]
    head = "".join(f'<th scope="col"{k}>{escaped(h)}</th>' for k, h in zip(kinds, heads, strict=True))
    body = []
    for row in rows:
        cells = "".join(
            f'<td{k} data-head="{escaped(h)}">{cell}</td>'
            for k, h, cell in zip(kinds[1:], heads[1:], row[1:], strict=True)
        )
        body.append(f'<tr><th scope="row">{row[0]}</th>{cells}</tr>')
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escaped(caption)}"><table class="scores stacking">'
        f"<caption>{escaped(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table></div>"
    )


def bounded(value: float | None, digits: int = 3, most: float = math.inf, least: float = -math.inf) -> str:
    """Return a number for people; of one beyond a bound, that."""
    if value is None:
        return "–"
    return f"> {most:g}" if value > most else f"< {least:g}" if value < least else f"{value:.{digits}g}"


def number(value: float | None, digits: int = 3, most: float = math.inf, least: float = -math.inf) -> str:
    """Return a number as people read it, without an exponent where it need not have one; of one beyond a bound, that."""
    if value is None or not math.isfinite(value):
        return "–"
    if not least <= value <= most:
        return f"> {most:g}" if value > most else f"< {least:g}".replace("-", "−")
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{value:.0f}" if abs(value) >= 1.0 else f"{value:.6f}".rstrip("0")
    return text.replace("-", "−")


def between(low: float | None, high: float | None, digits: int = 4) -> str:
    """Return a range of numbers."""
    return "–" if low is None or high is None else f"{number(low, digits)} … {number(high, digits)}"


def percent(share: float | None, digits: int = 3) -> str:
    """Return a share in per cent."""
    return "–" if share is None else f"{number(100.0 * share, digits)} %"


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: N·m/rad."""
    return unit.replace("*", "·").replace("^2", "²").replace("^3", "³")
