"""The catalogue of findings: what each code says, and what to do about it. docs/findings.md is made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vsalog.finding import Finding


@dataclass(frozen=True, slots=True)
class Text:
    """The words of a code.

    Attributes
    ----------
    says : what was found, sentences with the fields of the finding and of its evidence in braces
    advice : what to do, or what follows from it, sentences too
    """

    says: str
    advice: str


TEXTS: Mapping[str, Text] = {
    "encoder.zero": Text(
        "the deflection ({part}) lies around {value:.4g} rad and moves by ±{half_range:.3g} rad only: is an encoder's zero off?",
        "Give it as 'offset' of one of these roles in the rig; the stiffness over the deflection is wrong if so.",
    ),
    "encoder.sign": Text(
        "{part} move against one another (correlation {value:.2f}, by {first_span:.3g} and {second_span:.3g} rad): does one of"
        " them count the other way round?",
        "Say 'sign = -1' of it in the rig; the deflection is their sum instead of their difference if so.",
    ),
    "encoder.deflection_unit": Text(
        "the deflection ({part}) spans {value:.4g} rad, more than a turn: is one of these roles in degrees, or on the motor's"
        " side of the gear?",
        "Say 'unit = \"deg\"' of it in the rig, or 'side = \"rotor\"' with the motor's gear_ratio.",
    ),
    "encoder.unit": Text(
        "{part} spans {value:.4g} rad, {turns:.0f} turns of the joint: is it in degrees, or on the motor's side of the gear?",
        "Say 'unit = \"deg\"' of it in the rig, or of a motor's position 'side = \"rotor\"' with the motor's gear_ratio.",
    ),
    "encoder.stuck": Text(
        "{part} does not change by a single step from {begin:.4g} s to {end:.4g} s, while {other} moves by {value:.3g} rad;"
        " elsewhere they move together: its encoder was stuck.",
        "Leave that stretch out (--start, --end).",
    ),
    "torque.stuck": Text(
        "{part} does not change by a single step from {begin:.4g} s to {end:.4g} s and is noisy elsewhere: its sensor or its"
        " driver was stuck.",
        "Leave that stretch out (--start, --end).",
    ),
    "torque.stuck_while_moving": Text(
        "{part} does not change by a single step from {begin:.4g} s to {end:.4g} s, while the deflection changes by {value:.3g}"
        " rad; elsewhere they change together: the sensor was stuck.",
        "Leave that stretch out (--start, --end).",
    ),
    "torque.coarse": Text(
        "{part} takes {value:.0f} values only, {step:.3g} N·m apart and more: too coarse for a stiffness.",
        "Choose a smaller range, or record it before it is rounded.",
    ),
    "torque.dropouts": Text(
        "{part} reads exactly 0 at {value:.0f} samples here and there (first at {begin:.4g} s) amid values that go on"
        " undisturbed: lost packets, or a driver that left out a value.",
        "They bend the fit; have them left empty in the log.",
    ),
    "torque.computed": Text(
        "{part} is exactly {factor:.6g} times {source}: it was computed from it, not measured.",
        "The stiffness is the constant someone put into that computation; it validates nothing.",
    ),
    "sensor.saturated": Text(
        "{part} rests at its {end} value {at:.6g} for {value:.1%} of the samples (first at {begin:.4g} s) and moves noisily"
        " elsewhere: it is saturated.",
        "The stiffness is wrong wherever it is; choose a larger range, or leave these stretches out (--start, --end).",
    ),
    "sensor.repeated": Text(
        "{part} changes at every {value:.0f}th sample only, {rate:.4g} times a second: where it is a slower sensor's, repeated,"
        " and no command that a drive holds so long, it is late by half of that on average, which bends the stiffness.",
        "Record the others as slowly, or leave the repeats empty.",
    ),
    "deflection.still": Text(
        "the deflection of transmission {part} never changes; its stiffness cannot be told.",
        "Move the joint under load.",
    ),
    "estimate.torn": Text(
        "transmission {part}: samples are missing so often that the filters' windows are whole for {value:.0%} of the time only.",
        "Shorten them (--tune window=SECONDS), or mend the log.",
    ),
    "estimate.never_excited": Text(
        "transmission {part}: the data never support an estimate (standard deviation above a fifth of the stiffness everywhere).",
        "Move the joint more.",
    ),
    "estimate.fit_never_excited": Text(
        "transmission {part}: the data never support an estimate (standard deviation above a fifth of the stiffness everywhere).",
        "Move the joint more, or fit fewer terms (order under [joint.{joint}.basis] in the rig).",
    ),
    "estimate.partly_excited": Text(
        "transmission {part}: the estimate is supported by the data for {value:.0%} of the time only.",
        "Column excited says when.",
    ),
    "fit.offset": Text(
        "transmission {part}: the torque lies {value:+.3g} N·m beside the fit on average, an offset that odd powers of the"
        " deflection cannot follow.",
        "Set odd = false under [joint.{joint}.basis], or the offset of the torque's signal.",
    ),
    "stiffness.negative": Text(
        "transmission {part}: a negative stiffness was estimated for {value:.0%} of the time.",
        "Check the signs of the torque and of the positions in the rig (sign = -1), and whether motor and link are swapped.",
    ),
}


def sentence(finding: Finding) -> str:
    """Return what a finding says, and what to do about it."""
    text = TEXTS[finding.code]
    fields = {"joint": finding.joint, "part": finding.part, "value": finding.value, "limit": finding.limit}
    words = f"{text.says} {text.advice}".format_map(fields | dict(finding.evidence))
    return f"joint '{finding.joint}': {words}" if finding.joint else words
