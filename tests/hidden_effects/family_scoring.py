"""What a diagnosis made of a case with several effects, each with the visibility it has alone."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .alike import BELOW, BROUGHT, split
from .scoring import SIDES, VERDICTS, Estimate, _estimates, _gains, _is, _key

# An effect has to be named when it alone is so many times the noise.
VISIBLE = 3.0
# A stiffness, inertia or gain further from the rig's than this factor is absurd.
ABSURD = 3.0
# A false name is confident from here on.
CONFIDENT = 0.9
# "First, or in a class of no more than so many".
SMALL_CLASS = 3


@dataclass
class FamilyOutcome:
    """How a case went.

    Attributes
    ----------
    case, family, engine, device, roles : of the case
    machine : what repeats of one test have in common
    truth : "cause@part" of what was hidden
    sizes : visibility of each alone, in multiples of the noise
    asked : for each, whether it has to be named
    right : for each, whether it, or a class that holds it, was named
    ended : verdict, or why there is none
    named : "cause@part" of the material causes, in the diagnosis' order
    false : those of them that were not hidden, nor are the same physics, nor have a class that holds what was hidden
    confident : those of the false ones that are said to be nearly certain
    classes : members of each named one's class, itself first
    first : whether the first named is one of those hidden
    first_small : the same, or whether a class of at most three holds it
    estimates : of what was named rightly
    held_out : per signal: error after over the noise floor, on held-out data
    absurd : values that are beyond a factor of three of the rig's
    confidences : (confidence, whether it is hidden itself) of each material cause
    class_confidences : (confidence of its class, whether a member of that is hidden) of each
    simulated : signal → error of the original rig over the noise floor, on the log
    equations : equation → what the original rig leaves over its noise
    remainder : size of what the catalogue has not, in multiples of the noise
    seconds : the diagnosis took
    """

    case: str
    family: str
    engine: str
    device: str
    roles: str
    machine: str
    truth: list[str]
    sizes: list[float]
    asked: list[bool]
    right: list[bool]
    ended: str
    named: list[str] = field(default_factory=list)
    false: list[str] = field(default_factory=list)
    confident: list[str] = field(default_factory=list)
    classes: list[list[str]] = field(default_factory=list)
    first: bool = False
    first_small: bool = False
    estimates: list[Estimate] = field(default_factory=list)
    held_out: list[float] = field(default_factory=list)
    absurd: list[str] = field(default_factory=list)
    confidences: list[tuple[float, bool]] = field(default_factory=list)
    class_confidences: list[tuple[float, bool]] = field(default_factory=list)
    simulated: dict[str, float] = field(default_factory=dict)
    equations: dict[str, float] = field(default_factory=dict)
    remainder: float = 0.0
    seconds: float = 0.0

    @property
    def failed(self) -> bool:
        """Whether there is no diagnosis."""
        return self.ended not in (*VERDICTS, "consistent as far as checked")

    @property
    def worst(self) -> float:
        """Held-out error over the floor of the worst signal; infinite where it was not measured."""
        return max(self.held_out, default=float("inf"))

    @property
    def complete(self) -> bool:
        """Whether everything that has to be named was."""
        return all(r for r, a in zip(self.right, self.asked, strict=True) if a)


def covers(named: str | None, part: str) -> bool:
    """Tell whether the part that is named is, or includes, a part; both of a joint may be named by their common stem."""
    if not named or named == part:
        return True
    stem = part.removesuffix("_1").removesuffix("_2")
    words = "".join(" " if c in ",+&()/" else c for c in named).split()
    if part in words:
        return True
    if "position" in part and "encoders" in words:
        return True
    return stem != part and bool({stem, f"{stem}s"} & set(words))


def is_hidden(named: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    """Tell whether a named cause is what was hidden, for both parts perhaps, or is the same physics."""
    if named["cause"] == effect["cause"] and covers(named.get("part"), effect["part"]):
        return True
    return _is(named, effect)


def member_is_hidden(member: str, effect: Mapping[str, Any]) -> bool:
    """Tell whether a member of a class, "cause", "cause@part" or "cause (part)", is what was hidden."""
    cause, part = split(member)
    if cause == effect["cause"] and covers(part, effect["part"]):
        return True
    return effect.get("alike", {}).get(f"{cause}@{part or effect['part']}", np.inf) < BELOW


def holds(named: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    """Tell whether a named cause or its class is what was hidden."""
    return is_hidden(named, effect) or any(
        member_is_hidden(m, effect) for m in named.get("indistinguishable_from") or ()
    )


def score_family(
    truth: Mapping[str, Any], diagnosis: Mapping[str, Any] | None, seconds: float = 0.0, problem: str = ""
) -> FamilyOutcome:
    """Hold a diagnosis against the truth of a family's case; parameters as `scoring.score`."""
    effects = truth["effects"]
    outside = truth.get("outside") or []
    outside = [outside] if isinstance(outside, Mapping) else outside
    outcome = FamilyOutcome(
        case=truth["case"],
        family=truth["family"],
        engine=truth.get("engine", "own"),
        device=truth["device"],
        roles=truth["roles"],
        machine=truth.get("machine", truth["case"]),
        truth=[_key(e) for e in effects],
        sizes=[e["size"] for e in effects],
        asked=[has_to_be_named(e) for e in effects],
        right=[False] * len(effects),
        ended=problem or "no diagnosis",
        remainder=truth.get("remainder", max((o["size"] for o in outside), default=0.0)),
        seconds=seconds,
    )
    if diagnosis is None:
        return outcome
    causes = [c for c in diagnosis["causes"] if c.get("material") is not False]
    outcome.ended, outcome.named = diagnosis["verdict"], [_key(c) for c in causes]
    # What is present but immaterial is named all the same; it is just not counted where it is false.
    outcome.right = [any(holds(c, e) for c in diagnosis["causes"]) for e in effects]
    outcome.classes = [[_key(c), *(c.get("indistinguishable_from") or ())] for c in causes]
    for cause in causes:
        right = any(holds(cause, e) for e in effects)
        confidence = cause.get("confidence")
        if not right and (any(_is_near(cause, o) for o in outside) or any(_comes_with(cause, e) for e in effects)):
            continue
        if not right:
            outcome.false.append(_key(cause))
            if confidence is None or confidence >= CONFIDENT:
                outcome.confident.append(_key(cause))
        if confidence is not None:
            outcome.confidences.append((float(confidence), any(is_hidden(cause, e) for e in effects)))
            outcome.class_confidences.append((float(cause.get("class_confidence", confidence)), right))
    if causes:
        outcome.first = any(is_hidden(causes[0], e) for e in effects)
        small = len(outcome.classes[0]) <= SMALL_CLASS
        outcome.first_small = outcome.first or (small and any(holds(causes[0], e) for e in effects))
    outcome.estimates = list(_intervals(causes, effects))
    outcome.held_out = _gains(diagnosis)[0]
    errors = diagnosis.get("simulation_error", [])
    outcome.simulated = {e["signal"]: e["rmse"] / e["noise_floor"] for e in errors if e.get("noise_floor")}
    sums = diagnosis.get("equations", [])
    outcome.equations = {e["equation"]: e["rms_before"] / e["noise"] for e in sums if e.get("noise")}
    outcome.absurd = absurd_values(diagnosis, causes)
    return outcome


def _is_near(named: Mapping[str, Any], outside: Mapping[str, Any]) -> bool:
    """Tell whether a cause or its class is the catalogue's nearest to what that lacks: then it is neither right nor false."""
    near = [split(m) for m in outside.get("near", ())]
    members = [(named["cause"], named.get("part")), *(split(m) for m in named.get("indistinguishable_from") or ())]
    return any(own == cause and covers(where, part) for own, where in members for cause, part in near)


def _comes_with(named: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    """Tell whether a cause is the catalogue's nearest to what a hidden effect brings along."""
    return named["cause"] in BROUGHT.get(effect["cause"], ()) and covers(named.get("part"), effect["part"])


def has_to_be_named(effect: Mapping[str, Any]) -> bool:
    """Tell whether an effect is visible alone, also next to what the catalogue lacks."""
    return effect["size"] >= VISIBLE and effect.get("over_remainder", np.inf) >= 1.0


def _intervals(causes: Sequence[Mapping[str, Any]], effects: Sequence[Mapping[str, Any]]):
    """Yield an estimate for every parameter that is reported of an effect under its own name, once per named cause.

    A number in which another hidden effect has a share, as it is the same physics in that device, is nobody's.
    """
    for cause in causes:
        key = _key(cause)
        if any(_key(e) != key and e.get("alike", {}).get(key, np.inf) < BELOW for e in effects):
            continue
        for effect in effects:
            if cause["cause"] == effect["cause"] and covers(cause.get("part"), effect["part"]):
                reported = cause.get("parameters", {})
                known = {k: v for k, v in effect["parameters"].items() if reported.get(k, {}).get("value") is not None}
                if any(e["cause"] == "sensor.encoder_offset" and e["size"] < VISIBLE for e in effects):
                    # A phase counts from the encoder's zero.
                    known.pop("phase", None)
                yield from _estimates(cause, {**effect, "parameters": known})
                break


def absurd_values(diagnosis: Mapping[str, Any], causes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return which stiffnesses, inertias and gains are beyond a factor of three of the rig's."""
    joints = tomllib.loads(diagnosis["rig"])["joint"] if diagnosis.get("rig") else {}
    joint = next(iter(joints.values()), {})
    out = []
    for cause in causes:
        for name, reported in cause.get("parameters", {}).items():
            rig: Any = 1.0
            if name == "inertia":
                rig = joint.get(cause.get("part"), {}).get("inertia")
            elif name not in ("factor", "gain"):
                continue
            value = reported.get("value")
            if rig and value is not None and not 1.0 / ABSURD <= float(value) / float(rig) <= ABSURD:
                out.append(f"{_key(cause)}.{name} = {float(value):.3g}")
    return out


def agree(outcomes: Sequence[FamilyOutcome]) -> list[bool]:
    """Tell of every repeat of a test whether it says the same as the first: verdict, and causes up to their classes."""
    first: dict[str, FamilyOutcome] = {}
    out = []
    for outcome in outcomes:
        other = first.setdefault(outcome.machine, outcome)
        if other is not outcome:
            out.append(not outcome.failed and _same_answer(other, outcome))
    return out


def _same_answer(one: FamilyOutcome, other: FamilyOutcome) -> bool:
    def same(member: str, another: str) -> bool:
        """A member of a class is named without its part."""
        (cause, part), (cause_2, part_2) = split(member), split(another)
        return cause == cause_2 and (part == part_2 or not part or not part_2)

    def found(own: FamilyOutcome, others: FamilyOutcome) -> bool:
        return all(
            any(same(m, n) for members_2 in others.classes for n in members_2 for m in members)
            for members in own.classes
        )

    return one.ended == other.ended and found(one, other) and found(other, one)


__all__ = ["SIDES", "FamilyOutcome", "absurd_values", "agree", "covers", "score_family"]
