"""Names and numbers as people read them, on a terminal as on a page."""

from __future__ import annotations

import html
import math
import unicodedata


def plain(text: str) -> str:
    """Return a text without what could act on a reader: control, format and surrogate characters become visible."""
    if text.isprintable():
        return text
    return "".join("�" if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp") else c for c in text)


def label(text: str) -> str:
    """Return a text for plotly, whose labels know some tags of their own; it turns entities back into characters."""
    return html.escape(plain(text), quote=False)


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
