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
    """Return a run's diagnosis in words; findings that make a search pointless come first."""
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
    others = (f"To separate it from {name}: {_confirmed(name)}" for name in cause.indistinguishable_from)
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
    """Return the experiment that confirms a member of a class, or excludes the whole catalogue."""
    if name == UNKNOWN:
        return "repeat the motion with other speeds and ranges; a cause keeps its values, an unknown effect does not."
    return confirmation(name.partition(" ")[0])


def account(found: Diagnosis) -> tuple[str, ...]:
    """Return three sentences: what was found, the evidence for it, and the improvement."""
    causes, verdict = found.causes, found.verdict
    gains = [g for g in found.gain.signals if not g.signal.startswith("stiffness")]
    held = _held_out(gains, found.gain.where, bool(causes), verdict == "unexplained")
    if causes and all(c.cause == "sensor.torque_not_independent" for c in causes) and not gains:
        return (
            f"{causes[0].title}.",
            f"{causes[0].why[0].upper()}{causes[0].why[1:]}",
            "It can neither confirm nor contradict the rig, so nothing that depends on it was judged.",
        )
    if verdict == "consistent":
        return (
            f"The log is consistent with the rig within its noise. {held}".rstrip(),
            "Every equation of the joint and its simulation agree with the log within the sensors' noise, and no cause of the"
            " catalogue matters.",
            "This holds for motions like these: a log cannot show errors that it does not excite.",
        )
    if verdict == "consistent as far as checked":
        unchecked = ": nothing could be simulated, so errors that only accumulate over time were not checked."
        return (
            f"No error was found as far as the log can be checked{'.' if found.simulation_error else unchecked} {held}".rstrip(),
            "The equations that could be formed hold within the sensors' noise; the warnings name the others.",
        )
    # Each may be too little to matter, and all together not.
    material = [c for c in causes if c.material] or causes
    first = f"{_found(found, material)} {held}".rstrip()
    return first, *_believe(material, found.unexplained), *_immaterial(causes)


def _found(found: Diagnosis, causes: Sequence[FoundCause]) -> str:
    if not causes:
        return "The rig's simulation is wrong, and no cause of the catalogue explains it."
    # A number that two parts have in common is printed once.
    first = [
        c
        for i, c in enumerate(causes)
        if not any((c.joint, c.cause) == (o.joint, o.cause) and c.part in o.common_with for o in causes[:i])
    ]
    named = [f"{_lower(c.title)} ({numbers(c)}{_and_of(c)})" if c.parameters else _lower(c.title) for c in first[:3]]
    if len({e.joint for e in found.equations}) > 1:
        named = [f"in {c.joint}, {words}" for c, words in zip(first, named, strict=False)]
    whole = "; ".join((*named, *([f"and {len(first) - 3} more"] if len(first) > 3 else [])))
    starts = {
        "unexplained": "The rig's simulation is wrong, and no cause of the catalogue explains it; the nearest is: ",
        "explained": "The simulation's error is explained: ",
    }
    return f"{starts.get(found.verdict, 'Part of it is explained: ')}{whole}."


def _and_of(cause: FoundCause) -> str:
    """Return which other parts have the same number, or the same factor on the rig's number."""
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
    """Yield how probable the causes are, and what is unexplained."""
    if causes:
        weakest = min(causes, key=lambda c: (c.confidence, c.class_confidence))
        of = " of the least certain of them" if len(causes) > 1 else ""
        yield f"The confidence{of} is {confidence_text(weakest)}."
    # Both parts of a joint may have the same cause.
    yield from dict.fromkeys(
        f"This log cannot separate {c.cause} from {', '.join(c.indistinguishable_from)}: they are one class, and the rig's"
        " tolerances decided between them."
        for c in causes
        if c.indistinguishable_from
    )
    if left.where is not None:
        yield unexplained_words(left)
    elif not causes:
        yield (
            "The equations that can be formed hold within their noise: the error shows only where it accumulates, in the"
            " simulation over half a second, so the side of the joint is not known."
        )


def _immaterial(causes: Sequence[FoundCause]) -> Iterator[str]:
    small = [c for c in causes if not c.material]
    probable = dict.fromkeys(c.cause for c in small if c.class_confidence > 0.5)
    if probable and len(small) < len(causes):
        yield f"Present, but immaterial: {', '.join(probable)}."


def _held_out(gains: Sequence[Gain], held_out: str, extended: bool, unexplained: bool) -> str:
    """Return the simulation error of the rig, extended or not, for the signal that is farthest from its noise."""
    known = [g for g in gains if g.noise_floor > 0.0]
    if not known:
        return ""
    worst = max(known, key=lambda g: g.rmse_after / g.noise_floor)
    # Where nothing is explained no extended rig is written.
    rig = "the rig" if not extended else "the rig with these causes" if unexplained else "the extended rig"
    words = f"On {held_out} {rig} has its largest error in {signal_name(worst.signal)}: {_off(worst, worst.rmse_after)}"
    if not extended:
        return f"{words}."
    before = max(known, key=lambda g: g.rmse_before / g.noise_floor)
    there = "" if before is worst else f"its largest in {signal_name(before.signal)}: "
    original = f"{words}; the original rig has {there}{_off(before, before.rmse_before)}"
    if round(before.reduction, 2) == 0.0:
        return f"{original}, which is no different."
    return f"{original} (reduced by {reduction_text(before)})."


def _off(gain: Gain, error: float) -> str:
    """Return how large a simulation's error is."""
    times = error / gain.noise_floor
    factor = f"{times:.2g}" if times < 10.0 else f"{times:.0f}"
    return f"{error:.3g}{unit_of(gain.unit)}, {factor} times its noise floor"


def _advice(causes: Sequence[FoundCause], left: Unexplained) -> str:
    """Return the most informative experiment."""
    for cause in causes:
        if cause.tell_apart:
            return cause.tell_apart
    if left.where is not None and left.depends_on:
        variable = signal_name(left.depends_on[0])
        if left.loop:
            return f"Pass the range of {variable} several times, at two speeds: a loop repeats, a change over time does not."
        if variable == "time":
            return "Record the same motion again, cold and warm: the residual changes with time."
        return f"Record a slow sweep of {variable} with everything else at rest: the residual then is a curve over it."
    return causes[0].how_to_confirm if causes else ""


def open_experiment(diagnosis: Diagnosis) -> str:
    """Return the next experiment, unless the causes' own advice is the same."""
    words = [text for c in diagnosis.causes for text in (c.how_to_confirm, c.tell_apart)]
    return "" if diagnosis.next_experiment in words else diagnosis.next_experiment


def kind_text(cause: FoundCause) -> str:
    """Return the name of a cause, and whether it does not matter."""
    return cause.cause if cause.material else f"{cause.cause}, immaterial"


def confidence_text(cause: FoundCause) -> str:
    """Return a cause's confidence in per cent, never all of it; of a class also that of the class."""
    own, together = ("> 99 %" if c > 0.99 else share_text(c) for c in (cause.confidence, cause.class_confidence))
    return f"{own}, its class {together}" if cause.indistinguishable_from else own


def confidence_words(cause: FoundCause) -> str:
    """Return a cause's confidence, the error it removes, and the change of the stiffness."""
    words = (
        f"confidence {confidence_text(cause)}; it removes {share_text(cause.error_removed)} of the error beyond noise"
    )
    change = cause.stiffness_change
    return words if change is None else f"{words}, and changes the estimated stiffness by {share_text(change)}"


def nothing_left(left: Unexplained) -> bool:
    """Return whether the unexplained share rounds to 0 %."""
    return round(100.0 * left.fraction) == 0


def unexplained_words(left: Unexplained) -> str:
    """Describe what no cause explains."""
    if nothing_left(left) and left.where is None:
        return "The residuals of this log's equations are noise."
    words = f"{share_text(left.fraction)} of the error beyond noise is unexplained"
    if left.where is None:
        return f"{words}."
    names = [signal_name(name) for name in left.depends_on]
    if left.loop:
        where = f"and a loop over {names[0]}: up and down differ, as far as a log shows that passes it once"
        return f"{words}; it is on the {left.where} side, {where}."
    return f"{words}; it is on the {left.where} side and depends on {listed(names) or 'none of the signals checked'}."
