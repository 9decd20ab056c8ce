"""The sentences of a diagnosis, made of its codes and numbers: summary, causes, remaining residual, next experiment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec.structs import replace

from vsalog.core.finding import Finding
from vsalog.core.finding_texts import sentences_of
from vsalog.core.notation import (
    listed,
    number,
    part_name,
    share_text,
    signal_name,
    unit_of,
    with_interval,
)
from vsalog.core.significance import INTERVAL
from vsalog.core.units import shown
from vsalog.diagnosis.causes import catalogue
from vsalog.diagnosis.document import Diagnosis, FoundCause, Gain, Number, Unexplained
from vsalog.diagnosis.run import Outcome
from vsalog.diagnosis.smooth import UNKNOWN
from vsalog.figures.dot_plots import reduction_text
from vsalog.report.experiment import confirmation, experiment_words


def worded(outcome: Outcome) -> Diagnosis:
    """Return a run's diagnosis with the words that people read; findings that made a search pointless lead them."""
    found = outcome.diagnosis
    found = replace(found, causes=tuple(map(_described, found.causes)))
    void = [f for f in found.findings if f.severity == "invalidates"]
    led = (f"{words[0].upper()}{words[1:]}" for words in sentences_of(void))
    advice = "" if void else _advice(found.causes, found.unexplained)
    proposed = outcome.proposed
    if proposed is not None:
        words = experiment_words(proposed)
        first = found.unexplained.where is not None and not proposed.questions.confused
        advice = f"{advice} {words}".strip() if first else words
    warnings = (*found.warnings, *sentences_of(further_findings(found)))
    return replace(found, sentences=(*led, *account(found)), warnings=warnings, next_experiment=advice)


def further_findings(diagnosis: Diagnosis) -> list[Finding]:
    """Return the findings that do not lead the account."""
    return [finding for finding in diagnosis.findings if finding.severity != "invalidates"]


def _described(cause: FoundCause) -> FoundCause:
    """Return a cause with the words of the catalogue."""
    kind = catalogue()[cause.cause]
    confirm = kind.confirm
    for name, found in cause.parameters.items():
        confirm = confirm.replace(f"{{{name}}}", f"{found.value:.3g} {found.unit}")
    others = (f"To tell it from {name}: {_confirmed(name)}" for name in cause.indistinguishable_from)
    return replace(
        cause,
        title=title_of(cause.cause, cause.part) + ("" if cause.log is None else f", in {shown(cause.log)}"),
        why=cause.why or f"{part_name(cause.part).capitalize()}: {kind.says}.",
        how_to_confirm=confirm,
        tell_apart=" ".join(others),
        reference=kind.reference,
    )


def title_of(cause: str, part: str) -> str:
    """Return a cause's title with its part."""
    return catalogue()[cause].title.replace("{part}", part_name(part))


def _confirmed(name: str) -> str:
    """Return the experiment that confirms a member of a class, or shows that none of the catalogue is meant."""
    if name == UNKNOWN:
        return "repeat the motion with other speeds and ranges; a cause keeps its numbers, an unknown effect does not."
    return confirmation(name.partition(" ")[0])


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
        untold = ": nothing could be simulated, so what only adds up over time was not looked at."
        return (
            f"As far as the log can be checked nothing is wrong{'.' if found.simulation_error else untold} {held}".rstrip(),
            "The equations that could be formed close to what the sensors' noise explains; the warnings name the others.",
        )
    # Each may be too little to matter, and all together not.
    material = [c for c in causes if c.material] or causes
    first = f"{_found(found, material)} {held}".rstrip()
    return first, *_believe(material, found.unexplained), *_immaterial(causes)


def _found(found: Diagnosis, causes: Sequence[FoundCause]) -> str:
    if not causes:
        return "The rig's simulation is wrong, and no cause of the catalogue explains it."
    # A number that two parts have in common is said once.
    first = [
        c
        for i, c in enumerate(causes)
        if not any((c.joint, c.cause) == (o.joint, o.cause) and c.part in o.common_with for o in causes[:i])
    ]
    told = [f"{_lower(c.title)} ({numbers(c)}{_and_of(c)})" if c.parameters else _lower(c.title) for c in first[:3]]
    if len({e.joint for e in found.equations}) > 1:
        told = [f"in {c.joint}, {said}" for c, said in zip(first, told, strict=False)]
    whole = "; ".join((*told, *([f"and {len(first) - 3} more"] if len(first) > 3 else [])))
    starts = {
        "unexplained": "The rig's simulation is wrong, and no cause of the catalogue explains it; the nearest is: ",
        "explained": "What the simulation gets wrong is explained: ",
    }
    return f"{starts.get(found.verdict, 'Part of it is explained: ')}{whole}."


def _and_of(cause: FoundCause) -> str:
    """Say which other parts have the same number, or the same factor on what the rig says."""
    like = "by the same factor" if any(n.rig for n in cause.parameters.values()) else "the same"
    return "".join(f", and {like} for the {part_name(part)}" for part in cause.common_with)


def _lower(title: str) -> str:
    return title[0].lower() + title[1:]


def numbers(cause: FoundCause) -> str:
    """Return a cause's parameters with their 95 % intervals."""
    return ", ".join(f"{signal_name(name)} {_interval(n)}" for name, n in cause.parameters.items())


def parameter_text(found: Number) -> str:
    """Return a parameter with its 95 % interval and unit, and what the rig has."""
    rig = "" if found.rig is None or not found.determined else f" (rig: {number(found.rig)})"
    return f"{_interval(found)}{rig}"


def _interval(found: Number) -> str:
    if not found.determined:
        return "undetermined"
    return f"{with_interval(found.value, None if found.std is None else INTERVAL * found.std)}{unit_of(found.unit)}"


def _believe(causes: Sequence[FoundCause], left: Unexplained) -> Iterator[str]:
    """Say how probable the causes are, and what is unexplained."""
    if causes:
        weakest = min(causes, key=lambda c: (c.confidence, c.class_confidence))
        of = " of the least certain of them" if len(causes) > 1 else ""
        yield f"The confidence{of} is {confidence_text(weakest)}."
    # Both parts of a joint may have the same cause.
    yield from dict.fromkeys(
        f"This log cannot tell {c.cause} from {', '.join(c.indistinguishable_from)}: they are one class, and the rig's tolerances"
        " chose among them."
        for c in causes
        if c.indistinguishable_from
    )
    if left.where is not None:
        yield unexplained_words(left)
    elif not causes:
        yield (
            "The equations close within their noise where they can be formed: what is wrong shows only where it adds up, in the"
            " simulation of half a second, and not on which side of the joint it is."
        )


def _immaterial(causes: Sequence[FoundCause]) -> Iterator[str]:
    small = [c for c in causes if not c.material]
    probable = dict.fromkeys(c.cause for c in small if c.class_confidence > 0.5)
    if probable and len(small) < len(causes):
        yield f"Present, but immaterial: {', '.join(probable)}."


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


def open_experiment(diagnosis: Diagnosis) -> str:
    """Return the next experiment, unless the causes' own advice says the same."""
    said = [text for c in diagnosis.causes for text in (c.how_to_confirm, c.tell_apart)]
    return "" if diagnosis.next_experiment in said else diagnosis.next_experiment


def kind_text(cause: FoundCause) -> str:
    """Return the name of a cause, and whether it does not matter."""
    return cause.cause if cause.material else f"{cause.cause}, immaterial"


def confidence_text(cause: FoundCause) -> str:
    """Return a cause's confidence in per cent, never all of it; of a class also that of the class."""
    own, together = ("> 99 %" if c > 0.99 else share_text(c) for c in (cause.confidence, cause.class_confidence))
    return f"{own}, its class {together}" if cause.indistinguishable_from else own


def confidence_words(cause: FoundCause) -> str:
    """Say a cause's confidence, what error it removes, and what it does to the stiffness."""
    said = f"confidence {confidence_text(cause)}; it removes {share_text(cause.error_removed)} of the error"
    change = cause.stiffness_change
    return said if change is None else f"{said}, and moves the estimated stiffness by {share_text(change)}"


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
    names = [signal_name(name) for name in left.depends_on]
    if left.loop:
        where = (
            f"and a loop over {names[0]}: one way up, another way down, as far as a log can tell that passes it once"
        )
        return f"{words}; it is on the {left.where} side, {where}."
    return f"{words}; it is on the {left.where} side and depends on {listed(names) or 'no signal that was looked at'}."
