"""Names and numbers for people, on a terminal and on a page."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence

# Decimal exponents that are printed without a power of ten.
PLAIN = range(-4, 6)
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 3, most: float = math.inf, least: float = -math.inf) -> str:
    """Return a number for people, without an exponent if possible; beyond a bound, the bound."""
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


def digits_apart(low: float, high: float, least: int = 4) -> int:
    """Return how many digits two numbers need to differ in the last but one, no fewer than `least`."""
    size, apart = max(abs(low), abs(high)), abs(high - low)
    if not (0.0 < apart < math.inf and size < math.inf):
        return least
    return max(least, min(math.floor(math.log10(size / apart)) + 2, sys.float_info.dig))


def percent(share: float | None, digits: int = 3) -> str:
    """Return a share in per cent."""
    return "–" if share is None else f"{number(100.0 * share, digits)} %"


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: N·m/rad."""
    return unit.replace("*", "·").replace("^2", "²").replace("^3", "³")


def unit_of(unit: str) -> str:
    """Return a unit as it is printed, after a space; nothing for a plain number."""
    return "" if unit in ("", "1") else f" {unit_text(unit)}"


def signal_name(role: str) -> str:
    """Return the readable name of a signal, an equation or a parameter."""
    return role.replace("_", " ")


def with_interval(value: float, half: float | None) -> str:
    """Return a value ± half its interval: the half to two digits, the value to the same place.

    Parameters
    ----------
    value : any number
    half : not negative; None where it is not known
    """
    if not math.isfinite(value):
        return "–"
    if half is None or not math.isfinite(half):
        return number(value, 4)
    if half <= 0.0:
        return f"{number(value, 4)} ± 0"
    exponent = math.floor(math.log10(max(abs(value), half)))
    # Rounded to two digits first: 0.0996 is 0.10, with a place less.
    places = 1 - math.floor(math.log10(float(f"{half:.1e}")))
    scale = 0 if exponent in PLAIN else exponent
    digits = max(places + scale, 0)
    text = f"{value / 10**scale:.{digits}f} ± {half / 10**scale:.{digits}f}".replace("-", "−")
    return text if scale == 0 else f"({text}) × 10{str(scale).translate(SUPERSCRIPTS)}"


def share_text(share: float) -> str:
    """Return a share in per cent: with a decimal only near 0 and 100 %, since 99.6 % is not all and 0.4 % not nothing."""
    if not math.isfinite(share):
        return "–"
    per_cent = 100.0 * share
    digits = 1 if 0.05 <= abs(per_cent) < 1.0 or 99.0 < per_cent < 99.95 else 0
    return f"{per_cent:.{digits}f} %".replace("-", "−")


def term_name(term: str) -> str:
    """Return a basis function, or another parameter, as people write it: phi^3*c^2 is φ³ c²."""
    raised = re.sub(r"\^(\d+)", lambda m: "" if m[1] == "1" else m[1].translate(SUPERSCRIPTS), term)
    return signal_name(raised.replace("phi", "φ").replace("*", " ").replace(":", ": "))


def part_name(part: str) -> str:
    """Return the readable name of a part of a joint: motor_1 is the first motor."""
    name, _, place = part.rpartition("_")
    ordinal = {"1": "first", "2": "second"}.get(place)
    return signal_name(part if ordinal is None else f"{ordinal}_{name}")


def listed(names: Sequence[str]) -> str:
    """Return names as listed in a sentence: a, b and c."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def axis_label(name: str, unit: str) -> str:
    """Return an axis' label; a plain number has no unit."""
    return f"{name} [{unit_text(unit)}]" if unit_of(unit) else name


def duration(seconds: float) -> str:
    """Return a duration as people write it."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def transmission_title(part: str) -> str:
    """Return the readable name of a transmission."""
    return "Both transmissions together" if part == "total" else f"Transmission {part}"
