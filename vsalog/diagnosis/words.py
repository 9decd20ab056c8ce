"""What a diagnosis says, in words."""

from __future__ import annotations

from collections.abc import Sequence

from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.document import FoundCause, Gain, Unexplained, Verdict

# A simulation that is off by so many times what noise makes is said to be, though the equations close.
STILL_OFF = 3.0

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
    if verdict == "consistent":
        return (
            "Nothing is wrong: the log is consistent with the rig within its noise."
            if simulated
            else "Nothing was found to be wrong, but nothing could be simulated: what only adds up over time was not looked at.",
            "Every equation of the joint closes to what the sensors' noise explains, and no cause of the catalogue would improve"
            " it on data it was not fitted to.",
            "What the log does not excite it cannot tell: that the rig is right holds for motions like these.",
        )
    if causes and all(c.cause == "sensor.torque_not_independent" for c in causes) and not gains:
        return (
            f"{causes[0].title}.",
            f"{causes[0].why[0].upper()}{causes[0].why[1:]}",
            "What it says cannot confirm the rig, nor contradict it: nothing that rests on it was called right or wrong.",
        )
    first = _found(verdict, causes, joints)
    return tuple(s for s in (first, _believe(causes, left, gains), _worth(gains, held_out)) if s)


def _found(verdict: Verdict, causes: Sequence[FoundCause], joints: int) -> str:
    if not causes:
        return "The rig's simulation is wrong, and no cause of the catalogue explains it."
    told = [f"{_lower(c.title)} ({numbers(c)})" if c.parameters else _lower(c.title) for c in causes[:3]]
    if joints > 1:
        told = [f"in {c.joint}, {said}" for c, said in zip(causes, told, strict=False)]
    whole = "; ".join(told)
    if verdict == "unexplained":
        return f"The rig's simulation is wrong, and no cause of the catalogue explains it; the nearest is: {whole}."
    start = "What the simulation gets wrong is explained: " if verdict == "explained" else "Part of it is explained: "
    return f"{start}{whole}."


def _lower(title: str) -> str:
    return title[0].lower() + title[1:]


def gathered(warnings: Sequence[str], of_joints: Sequence[tuple[str, Sequence[str]]]) -> tuple[str, ...]:
    """Return warnings, each once; what is said alike of several joints or runs is said of all in one.

    Parameters
    ----------
    warnings : of the whole
    of_joints : name and warnings of each joint or run
    """
    told, names = list(dict.fromkeys(warnings)), dict[str, list[str]]()
    for name, own_warnings in of_joints:
        for warning in own_warnings:
            names.setdefault(warning.replace(f"joint '{name}'", "{joint}"), []).append(name)
    for text, own in names.items():
        quoted = ", ".join(f"'{n}'" for n in own)
        told.append(text.replace("{joint}", f"joint{'s' if len(own) > 1 else ''} {quoted}"))
    return tuple(dict.fromkeys(told))


def numbers(cause: FoundCause) -> str:
    """Return a cause's parameters with their 95 % intervals."""
    parts = []
    for name, n in cause.parameters.items():
        unit = "" if n.unit == "1" else f" {n.unit.replace('*', '·').replace('^2', '²').replace('^3', '³')}"
        spread = "" if n.std is None else f" ± {1.96 * n.std:.2g}"
        parts.append(f"{name.replace('_', ' ')} {n.value:.4g}{spread}{unit}")
    return ", ".join(parts)


def _believe(causes: Sequence[FoundCause], left: Unexplained, gains: Sequence[Gain]) -> str:
    sure = ""
    if causes:
        others = causes[0].indistinguishable_from
        sure = f"We are {100 * causes[0].confidence:.0f} % sure of the first"
        sure += f"; this log cannot tell it from {', '.join(others)}. " if others else ". "
    if left.fraction > 0.02 and left.where is not None:
        on = f" and depends on {' and '.join(left.depends_on)}" if left.depends_on else ""
        if left.curve_back:
            on = f": a loop over {left.depends_on[0]}, as far as a log can tell that passes it once"
        return f"{sure}{100 * left.fraction:.0f} % of what was wrong is left unexplained; it is on the {left.where} side{on}."
    if left.fraction > 0.02 and not causes:
        return (
            "The equations close within their noise where they can be formed: what is wrong shows only where it adds up, in the"
            " simulation of half a second, and not on which side of the joint it is."
        )
    if left.where is not None:
        return f"{sure}Next to nothing of what was wrong is left unexplained, though it is more than noise."
    if not causes:
        return sure
    worst = max((g for g in gains if g.noise_floor > 0.0), key=lambda g: g.rmse_after / g.noise_floor, default=None)
    if worst is not None and worst.rmse_after > STILL_OFF * worst.noise_floor:
        return (
            f"{sure}Once it is put in the equations close but for their noise, and yet the simulation of"
            f" {worst.signal.replace('_', ' ')} is off by {worst.rmse_after / worst.noise_floor:.2g} times what noise makes:"
            " something small is left that adds up, or a value is not quite right."
        )
    return f"{sure}Nothing beyond noise is left over once it is put in."


def _worth(gains: Sequence[Gain], held_out: str) -> str:
    if not gains:
        return ""
    best = max(gains, key=lambda g: g.reduction)
    low, high = best.ci95
    signal = best.signal.replace("_", " ")
    return (
        f"On {held_out} the extended rig's simulation of {signal} is off by {best.rmse_after:.3g} instead of"
        f" {best.rmse_before:.3g} {best.unit.replace('*', '·')}: {100 * best.reduction:.0f} % less (95 %: {100 * low:.0f} to"
        f" {100 * high:.0f} %); noise alone makes {best.noise_floor:.3g}."
    )
