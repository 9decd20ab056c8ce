"""How a diagnosis' names and numbers are printed, on the terminal as on the page: plain texts."""

from __future__ import annotations

import math
import re

from vsalog.core.finding import Finding
from vsalog.core.significance import INTERVAL
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.document import Diagnosis, FoundCause, Gain, Number, Unexplained
from vsalog.report.quantities import number, unit_text

# Decimal exponents that are printed without a power of ten.
PLAIN = range(-4, 6)
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def further_findings(diagnosis: Diagnosis) -> list[Finding]:
    """Return the findings that do not lead the account."""
    return [finding for finding in diagnosis.findings if finding.severity != "invalidates"]


_PARTS = {
    "motor": "motor",
    "motor_1": "first motor",
    "motor_2": "second motor",
    "secondary_motor": "secondary motor",
    "transmission": "transmission",
    "transmission_1": "first transmission",
    "transmission_2": "second transmission",
    "link": "link",
    "torque_sensor": "torque sensor",
    "torque_sensor_1": "first torque sensor",
    "torque_sensor_2": "second torque sensor",
    "motor_position": "motor position",
    "motor_position_1": "first motor's position",
    "motor_position_2": "second motor's position",
    "link_position": "link position",
    "deflection": "deflection",
}


def part_in_words(part: str) -> str:
    """Return what people call a part of a joint."""
    return _PARTS.get(part, part.replace("_", " "))


def title_of(cause: str, part: str) -> str:
    """Return a cause's title with its part."""
    return catalogue()[cause].title.replace("{part}", part_in_words(part))


def unfilled(text: str) -> str:
    """Put names where the words of causes that were not fitted ask for their numbers."""
    return re.sub(r"\{(\w+)\}", lambda m: f"its {m[1].replace('_', ' ')}", text)


def unit_of(unit: str) -> str:
    """Return a unit as it is printed, after a space; nothing for a plain number."""
    return "" if unit in ("", "1") else f" {unit_text(unit)}"


def signal_name(role: str) -> str:
    """Return what people call a signal, an equation or a parameter."""
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


def parameter_text(found: Number) -> str:
    """Return a parameter with its 95 % interval and unit, and what the rig has."""
    if not found.determined:
        return "undetermined"
    half = None if found.std is None else INTERVAL * found.std
    rig = "" if found.rig is None else f" (rig: {number(found.rig)})"
    return f"{with_interval(found.value, half)}{unit_of(found.unit)}{rig}"


def kind_text(cause: FoundCause) -> str:
    """Return the name of a cause, and whether it does not matter."""
    return cause.cause if cause.material else f"{cause.cause}, immaterial"


def share_text(share: float) -> str:
    """Return a share in per cent: a decimal only where it matters, for 99.6 % is not all of it, nor 0.4 % nothing."""
    if not math.isfinite(share):
        return "–"
    per_cent = 100.0 * share
    digits = 1 if 0.05 <= abs(per_cent) < 1.0 or 99.0 < per_cent < 99.95 else 0
    return f"{per_cent:.{digits}f} %".replace("-", "−")


def confidence_text(cause: FoundCause) -> str:
    """Return a cause's confidence in per cent, never all of it; of a class also that of the class."""
    own, together = ("> 99 %" if c > 0.99 else share_text(c) for c in (cause.confidence, cause.class_confidence))
    return f"{own}, its class {together}" if cause.indistinguishable_from else own


def reduction_text(gain: Gain) -> str:
    """Return a reduction with its 95 % interval, to the digits that the interval allows."""
    values = (gain.reduction, *gain.ci95)
    if not all(map(math.isfinite, values)):
        return "–"
    if gain.rmse_after > 10.0 * gain.rmse_before:
        return "worse, more than tenfold"
    digits = 1 if values[2] - values[1] < 0.02 else 0
    middle, low, high = (f"{100.0 * value:.{digits}f}".replace("-", "−") for value in values)
    return f"{middle} % ({low} … {high})"


def nothing_left(left: Unexplained) -> bool:
    """Tell whether what no cause explains rounds to 0 %."""
    return round(100.0 * left.fraction) == 0


def unexplained_words(left: Unexplained) -> str:
    """Say what no cause explains."""
    if nothing_left(left) and left.where is None:
        return "The residuals of this log's equations are noise."
    words = f"{share_text(left.fraction)} of what was wrong is left unexplained"
    if left.where is None:
        return f"{words}."
    if left.loop:
        return (
            f"{words}; it is on the {left.where} side, and a loop over {signal_name(left.depends_on[0])}: one way up, another way"
            " down, as far as a log can tell that passes it once."
        )
    words += f"; it is on the {left.where} side and depends on"
    names = [signal_name(n) for n in left.depends_on]
    if not names:
        return f"{words} no signal that was looked at."
    return f"{words} {' and '.join(filter(None, (', '.join(names[:-1]), names[-1])))}."


def confidence_words(cause: FoundCause) -> str:
    """Say a cause's confidence, what error it removes, and what it does to the stiffness."""
    said = f"confidence {confidence_text(cause)}; it removes {share_text(cause.error_removed)} of the error"
    change = cause.stiffness_change
    return said if change is None else f"{said}, and moves the estimated stiffness by {share_text(change)}"


def open_experiment(diagnosis: Diagnosis) -> str:
    """Return the next experiment, unless the causes' own advice says the same."""
    said = [text for c in diagnosis.causes for text in (c.how_to_confirm, c.tell_apart)]
    return "" if diagnosis.next_experiment in said else diagnosis.next_experiment
