"""What a diagnosis says, in words."""

from __future__ import annotations

import re
from collections.abc import Sequence

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.document import FoundCause, Gain, Unexplained, Verdict

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


def sentences(
    verdict: Verdict,
    causes: Sequence[FoundCause],
    gains: Sequence[Gain],
    held_out: str,
    left: Unexplained,
    joints: int,
    simulated: bool,
) -> tuple[str, ...]:
    """Say in three sentences what was found, why one may believe it, and what it is worth."""
    held = _held_out(gains, held_out, bool(causes), verdict)
    if causes and all(c.cause == "sensor.torque_not_independent" for c in causes) and not gains:
        return (
            f"{causes[0].title}.",
            f"{causes[0].why[0].upper()}{causes[0].why[1:]}",
            "What it says cannot confirm the rig, nor contradict it: nothing that rests on it was called right or wrong.",
        )
    if verdict == "consistent":
        return (
            f"Nothing is wrong: the log is consistent with the rig within its noise. {held}".rstrip(),
            "Every equation of the joint closes and its simulation holds to what the sensors' noise explains, and no cause of the"
            " catalogue matters.",
            "What the log does not excite it cannot show: that the rig is right holds for motions like these.",
        )
    if verdict == "consistent as far as checked":
        return (
            "As far as the log can be checked nothing is wrong"
            + ("." if simulated else ": nothing could be simulated, so what only adds up over time was not looked at.")
            + f" {held}".rstrip(),
            "The equations that could be formed close to what the sensors' noise explains; the warnings name the others.",
        )
    # Each may be too little to matter, and all together not.
    material = [c for c in causes if c.material] or causes
    first = f"{_found(verdict, material, joints)} {held}".rstrip()
    return tuple(s for s in (first, *_believe(material, left), _immaterial(causes)) if s)


def _found(verdict: Verdict, causes: Sequence[FoundCause], joints: int) -> str:
    if not causes:
        return "The rig's simulation is wrong, and no cause of the catalogue explains it."
    # A number that two parts have in common is said once.
    first = [c for i, c in enumerate(causes) if not any(_in_common(c, other) for other in causes[:i])]
    told = [f"{_lower(c.title)} ({numbers(c)}{_and_of(c)})" if c.parameters else _lower(c.title) for c in first[:3]]
    if joints > 1:
        told = [f"in {c.joint}, {said}" for c, said in zip(first, told, strict=False)]
    more = f"; and {len(first) - 3} more" if len(first) > 3 else ""
    whole = "; ".join(told) + more
    if verdict == "unexplained":
        return f"The rig's simulation is wrong, and no cause of the catalogue explains it; the nearest is: {whole}."
    start = "What the simulation gets wrong is explained: " if verdict == "explained" else "Part of it is explained: "
    return f"{start}{whole}."


def _in_common(one: FoundCause, other: FoundCause) -> bool:
    return one.joint == other.joint and one.cause == other.cause and one.part in other.common_with


def _and_of(cause: FoundCause) -> str:
    """Say which other parts have the same number, or the same factor on what the rig says."""
    like = "by the same factor" if any(n.rig for n in cause.parameters.values()) else "the same"
    return "".join(f", and {like} for the {part_in_words(part)}" for part in cause.common_with)


def _lower(title: str) -> str:
    return title[0].lower() + title[1:]


def numbers(cause: FoundCause) -> str:
    """Return a cause's parameters with their 95 % intervals."""
    parts = []
    for name, n in cause.parameters.items():
        if not n.determined:
            parts.append(f"{name.replace('_', ' ')} undetermined")
            continue
        spread = "" if n.std is None else f" ± {1.96 * n.std:.2g}"
        parts.append(f"{name.replace('_', ' ')} {n.value:.4g}{spread}{unit_in_words(n.unit)}")
    return ", ".join(parts)


def unit_in_words(unit: str) -> str:
    """Return a unit as people write it, after a space; nothing for a plain number."""
    return "" if unit == "1" else f" {unit.replace('*', '·').replace('^2', '²').replace('^3', '³')}"


def _believe(causes: Sequence[FoundCause], left: Unexplained) -> list[str]:
    """Say how sure the causes are, and what is left."""
    said = []
    if causes:
        weakest = min(causes, key=lambda c: (c.confidence, c.class_confidence))
        of = " of the least certain of them" if len(causes) > 1 else ""
        its = f", that of its class {_per_cent(weakest.class_confidence)}" if weakest.indistinguishable_from else ""
        said.append(f"The confidence{of} is {_per_cent(weakest.confidence)}{its}.")
    # Both parts of a joint may have the same cause.
    said += dict.fromkeys(
        f"This log cannot tell {c.cause} from {', '.join(c.indistinguishable_from)}: they are one class, and the rig's tolerances"
        " chose among them."
        for c in causes
        if c.indistinguishable_from
    )
    if left.where is not None:
        on = f" and depends on {' and '.join(left.depends_on)}" if left.depends_on else ""
        if left.loop:
            on = f": a loop over {left.depends_on[0]}, as far as a log can show that passes it once"
        said.append(
            f"Of what is wrong in the equations {_per_cent(left.fraction)}, in squares beyond noise, is left unexplained; it is"
            f" on the {left.where} side{on}."
        )
    elif not causes:
        said.append(
            "The equations close within their noise where they can be formed: what is wrong shows only where it adds up, in the"
            " simulation of half a second, and not on which side of the joint it is."
        )
    return said


def _immaterial(causes: Sequence[FoundCause]) -> str:  # that are more probable than not
    small = [c for c in causes if not c.material]
    told = dict.fromkeys(c.cause for c in small if c.class_confidence > 0.5)
    return f"Present, but immaterial: {', '.join(told)}." if told and len(small) < len(causes) else ""


def _per_cent(share: float) -> str:
    whole = round(100.0 * share)
    return "above 99 %" if whole > 99 else "below 1 %" if whole < 1 else f"{whole} %"


def _held_out(gains: Sequence[Gain], held_out: str, extended: bool, verdict: Verdict) -> str:
    """Say what the simulation of the rig, extended or not, is worth, for the signal that is farthest from its noise."""
    known = [g for g in gains if g.noise_floor > 0.0]
    if not known:
        return ""
    worst = max(known, key=lambda g: g.rmse_after / g.noise_floor)
    # Where nothing is explained no extended rig is written.
    rig = "the rig" if not extended else "the rig with these causes" if verdict == "unexplained" else "the extended rig"
    signal = worst.signal.replace("_", " ")
    said = f"On {held_out} {rig} simulates {signal}, the signal it is worst at, to {_off(worst, worst.rmse_after)}"
    if not extended:
        return f"{said}."
    before = max(known, key=lambda g: g.rmse_before / g.noise_floor)
    there = "to" if before is worst else f"is worst at {before.signal.replace('_', ' ')}, off by"
    as_it_stands = f"{said}; the rig as it stands {there} {_off(before, before.rmse_before)}"
    if round(before.reduction, 2) == 0.0:
        return f"{as_it_stands}, which is no different."
    way, (low, high) = "reduced", before.ci95
    if before.reduction < 0.0:
        way, low, high = "enlarged", -high, -low
    digits = int(high - low < 0.02)
    shares = (round(100.0 * share, digits) + 0.0 for share in (abs(before.reduction), low, high))
    by, least, most = (f"{share:.{digits}f}" for share in shares)
    return f"{as_it_stands} ({way} by {by} %, 95 %: {least} to {most} %)."


def _off(gain: Gain, error: float) -> str:
    """Say how far off a simulation is."""
    times = error / gain.noise_floor
    told = f"{times:.2g}" if times < 10.0 else f"{times:.0f}"
    return f"{error:.3g} {gain.unit.replace('*', '·')}, {told} times its noise floor"
