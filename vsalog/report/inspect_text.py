"""Words, names and tables as `inspect` prints them."""

from __future__ import annotations

from rich.text import Text

from vsalog.core.printable import printable

# From how many seconds on a unit reads better than the next smaller one, and how long it is [s].
_LONG = ((172_800.0, "d", 86_400.0), (7_200.0, "h", 3_600.0), (120.0, "min", 60.0))


def headed(name: str, style: str, facts: str) -> Text:
    """Return a line that begins with a name."""
    text = Text()
    text.append(printable(name), style=style)
    text.append(f"  {facts}")
    return text


def seconds(value: float | None) -> str:
    """Write a time with the unit that reads best."""
    if value is None:
        return "–"
    size = abs(value)
    for least, unit, length in _LONG:
        if size >= least:
            return f"{_three_digits(value / length)} {unit}"
    if size >= 1.0 or size == 0.0:
        return f"{value:.4g} s"
    return f"{_three_digits(value * 1e3)} ms" if size >= 1e-3 else f"{value * 1e6:.3g} µs"


def _three_digits(value: float) -> str:
    """Write a number with three digits, and more where they stand ahead of the point."""
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"


def size(count: int) -> str:
    """Write a number of bytes with the unit that reads best."""
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
