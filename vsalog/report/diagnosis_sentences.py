"""What a diagnosis tells people, made of its codes and numbers: the account, the causes, the next experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from vsalog.core.finding_texts import sentences_of
from vsalog.core.significance import INTERVAL
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.document import Diagnosis, FoundCause, Gain, Number, Unexplained
from vsalog.diagnosis.run import Outcome
from vsalog.diagnosis.smooth import UNKNOWN
from vsalog.report.diagnosis_quantities import (
    confidence_text,
    further_findings,
    part_in_words,
    reduction_text,
    signal_name,
    title_of,
    unexplained_words,
    unfilled,
    unit_of,
    with_interval,
)
from vsalog.report.experiment import experiment_words


def worded(outcome: Outcome) -> Diagnosis:
    """Return a run's diagnosis with the words that people read; findings that made a search pointless lead them."""
    found = outcome.diagnosis
    found = replace(found, causes=tuple(map(_described, found.causes)))
    void = [f for f in found.findings if f.severity == "invalidates"]
    rest = sentences_of(further_findings(found))
    led = (f"{words[0].upper()}{words[1:]}" for words in sentences_of(void))
    advice = "" if void else _advice(found.causes, found.unexplained)
    proposed = outcome.proposed
    if proposed is not None:
        words = experiment_words(proposed)
        first = found.unexplained.where is not None and not proposed.questions.confused
        advice = f"{advice} {words}".strip() if first else words
    return replace(found, sentences=(*led, *account(found)), warnings=(*found.warnings, *rest), next_experiment=advice)


def _described(cause: FoundCause) -> FoundCause:
    """Return a cause with the words of the catalogue."""
    kind = catalogue()[cause.cause]
    others = (name for name in cause.indistinguishable_from)
    return replace(
        cause,
        title=title_of(cause.cause, cause.part),
        why=cause.why or f"{part_in_words(cause.part).capitalize()}: {kind.says}.",
        how_to_confirm=_filled(kind.confirm, cause.parameters),
        tell_apart=unfilled(" ".join(f"To tell it from {name}: {_confirmed(name)}" for name in others)),
        reference=kind.reference,
    )


def _confirmed(name: str) -> str:
    """Return the experiment that confirms a member of a class, or shows that none of the catalogue is meant."""
    if name == UNKNOWN:
        return "repeat the motion with other speeds and ranges; a cause keeps its numbers, an unknown effect does not."
    return catalogue()[name.partition(" ")[0]].confirm


def _filled(text: str, numbers: Mapping[str, Number]) -> str:
    """Put a cause's numbers where its words ask for them."""
    for name, number in numbers.items():
        text = text.replace(f"{{{name}}}", f"{number.value:.3g} {number.unit}")
    return text


def account(found: Diagnosis) -> tuple[str, ...]:
    """Say in three sentences what was found, why one may believe it, and what it is worth."""
    causes, verdict = found.causes, found.verdict
    gains = [g for g in found.gain.signals if not g.signal.startswith("stiffness")]
    held = _held_out(gains, found.gain.where, bool(causes), verdict == "unexplained")
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
            + (
                "."
                if found.simulation_error
                else ": nothing could be simulated, so what only adds up over time was not looked at."
            )
            + f" {held}".rstrip(),
            "The equations that could be formed close to what the sensors' noise explains; the warnings name the others.",
        )
    # Each may be too little to matter, and all together not.
    material = [c for c in causes if c.material] or causes
    first = f"{_found(found, material)} {held}".rstrip()
    return tuple(s for s in (first, *_believe(material, found.unexplained), _immaterial(causes)) if s)


def _found(found: Diagnosis, causes: Sequence[FoundCause]) -> str:
    if not causes:
        return "The rig's simulation is wrong, and no cause of the catalogue explains it."
    # A number that two parts have in common is said once.
    first = [c for i, c in enumerate(causes) if not any(_in_common(c, other) for other in causes[:i])]
    told = [f"{_lower(c.title)} ({numbers(c)}{_and_of(c)})" if c.parameters else _lower(c.title) for c in first[:3]]
    if len({e.joint for e in found.equations}) > 1:
        told = [f"in {c.joint}, {said}" for c, said in zip(first, told, strict=False)]
    whole = "; ".join((*told, *([f"and {len(first) - 3} more"] if len(first) > 3 else [])))
    starts = {
        "unexplained": "The rig's simulation is wrong, and no cause of the catalogue explains it; the nearest is: ",
        "explained": "What the simulation gets wrong is explained: ",
    }
    return f"{starts.get(found.verdict, 'Part of it is explained: ')}{whole}."


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
        half = None if n.std is None else INTERVAL * n.std
        told = f"{with_interval(n.value, half)}{unit_of(n.unit)}" if n.determined else "undetermined"
        parts.append(f"{signal_name(name)} {told}")
    return ", ".join(parts)


def _believe(causes: Sequence[FoundCause], left: Unexplained) -> list[str]:
    """Say how probable the causes are, and what is unexplained."""
    said = []
    if causes:
        weakest = min(causes, key=lambda c: (c.confidence, c.class_confidence))
        of = " of the least certain of them" if len(causes) > 1 else ""
        said.append(f"The confidence{of} is {confidence_text(weakest)}.")
    # Both parts of a joint may have the same cause.
    said += dict.fromkeys(
        f"This log cannot tell {c.cause} from {', '.join(c.indistinguishable_from)}: they are one class, and the rig's tolerances"
        " chose among them."
        for c in causes
        if c.indistinguishable_from
    )
    if left.where is not None:
        said.append(unexplained_words(left))
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


def _held_out(gains: Sequence[Gain], held_out: str, extended: bool, unexplained: bool) -> str:
    """Say what the simulation of the rig, extended or not, is worth, for the signal that is farthest from its noise."""
    known = [g for g in gains if g.noise_floor > 0.0]
    if not known:
        return ""
    worst = max(known, key=lambda g: g.rmse_after / g.noise_floor)
    # Where nothing is explained no extended rig is written.
    rig = "the rig" if not extended else "the rig with these causes" if unexplained else "the extended rig"
    said = (
        f"On {held_out} {rig} simulates {signal_name(worst.signal)}, the signal it is worst at, to"
        f" {_off(worst, worst.rmse_after)}"
    )
    if not extended:
        return f"{said}."
    before = max(known, key=lambda g: g.rmse_before / g.noise_floor)
    there = "to" if before is worst else f"is worst at {signal_name(before.signal)}, off by"
    as_it_stands = f"{said}; the rig as it stands {there} {_off(before, before.rmse_before)}"
    if round(before.reduction, 2) == 0.0:
        return f"{as_it_stands}, which is no different."
    return f"{as_it_stands} (reduced by {reduction_text(before)})."


def _off(gain: Gain, error: float) -> str:
    """Say how far off a simulation is."""
    times = error / gain.noise_floor
    told = f"{times:.2g}" if times < 10.0 else f"{times:.0f}"
    return f"{error:.3g}{unit_of(gain.unit)}, {told} times its noise floor"


def _advice(causes: Sequence[FoundCause], left: Unexplained) -> str:
    """Return the experiment that would tell most."""
    for cause in causes:
        if cause.tell_apart:
            return cause.tell_apart
    if left.where is not None and left.depends_on:
        variable = signal_name(left.depends_on[0])
        if left.loop:
            return f"Pass the range of {variable} several times, at two speeds: a loop comes back, what time changes does not."
        if variable == "time":
            return "Record the same motion again, cold and warm: what is left over changes with time."
        return f"Record a slow sweep of {variable} with everything else at rest: what is left over shows as a curve over it."
    return causes[0].how_to_confirm if causes else ""
