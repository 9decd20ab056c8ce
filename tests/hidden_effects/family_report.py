"""One table per family: what is asked of a diagnosis there, and how often it is met."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any

import numpy as np

from .family_scoring import FamilyOutcome, agree
from .report import Line, _number, _share
from .scoring import median

# A log that is called explained is simulated within so many times its noise floor.
EXPLAINED = 2.0
Outcomes = Sequence[FamilyOutcome]


def _named(outcomes: Outcomes, asked: str = "") -> list[Line]:
    every = [r for o in outcomes for r, a in zip(o.right, o.asked, strict=True) if a]
    return [
        _share(
            "every cause visible alone at 3 times the noise named, or its class", [o.complete for o in outcomes], asked
        ),
        _share("… of these causes", every),
    ]


def _false(outcomes: Outcomes) -> list[Line]:
    return [
        _share("a false material cause named", [bool(o.false) or o.failed for o in outcomes], "≤ 0.05"),
        _share("… with a confidence of 0.9 or more", [bool(o.confident) for o in outcomes]),
    ]


def _held_out(outcomes: Outcomes, limit: float = 1.5, asked: str = "") -> list[Line]:
    measured = [o.worst for o in outcomes if o.held_out]
    return [
        _share(f"held-out error at most {limit:g} times the floor", [o.worst <= limit for o in outcomes], asked),
        Line("… over the floor, median", median(measured), len(measured)),
        Line(
            "… over the floor, 90th percentile", float(np.quantile(measured, 0.9)) if measured else None, len(measured)
        ),
    ]


def _intervals(outcomes: Outcomes, asked: bool) -> list[Line]:
    covered = [e.covered for o in outcomes for e in o.estimates]
    lines = [_share("95 % intervals that hold the truth", covered, "≥ 0.92" if asked else "")]
    return [*lines, _share("… of the same intervals, no more than", covered, "≤ 0.98")] if asked else lines


def _sound(outcomes: Outcomes) -> list[Line]:
    explained = [o.worst <= EXPLAINED for o in outcomes if o.ended == "explained"]
    times = [o.seconds for o in outcomes if o.seconds > 0.0]
    return [
        _share("called explained: held-out error at most twice the floor", explained, "≥ 1"),
        _share("an absurd value", [bool(o.absurd) for o in outcomes], "≤ 0"),
        _share("no diagnosis", [o.failed for o in outcomes], "≤ 0"),
        Line("seconds a diagnosis takes, median", median(times), len(times)),
        Line("… longest", max(times, default=None), len(times)),
    ]


def _messy(outcomes: Outcomes) -> list[Line]:
    return [
        *_named(outcomes, "≥ 0.90"), *_false(outcomes), *_held_out(outcomes, asked="≥ 0.90"), *_intervals(outcomes, True),
        *_sound(outcomes),
    ]  # fmt: skip


def _first(outcomes: Outcomes) -> list[Line]:
    return [
        _share("right first, or in a class of at most three", [o.first_small for o in outcomes], "≥ 0.90"),
        _share("… right first", [o.first for o in outcomes]),
        *_named(outcomes), *_false(outcomes), *_held_out(outcomes), *_intervals(outcomes, False), *_sound(outcomes),
    ]  # fmt: skip


def _model_error(outcomes: Outcomes) -> list[Line]:
    every = [r for o in outcomes for r, a in zip(o.right, o.asked, strict=True) if a]
    partly = [o.ended == "partly explained" and bool(o.held_out) for o in outcomes]
    remainders = [o.remainder for o in outcomes]
    return [
        _share("causes larger than what the catalogue lacks: named, or their class", every, "≥ 0.85"),
        _share("a confident false name", [bool(o.confident) or o.failed for o in outcomes], "≤ 0.05"),
        _share("… any false material cause", [bool(o.false) for o in outcomes]),
        _share("partly explained, with a measured held-out gain", partly),
        _share("called explained", [o.ended == "explained" for o in outcomes]),
        Line("what the catalogue lacks over the noise, median", median(remainders), len(remainders)),
        *_held_out(outcomes), *_intervals(outcomes, False), *_sound(outcomes),
    ]  # fmt: skip


def _measured(outcomes: Outcomes) -> list[Line]:
    repeats = agree(outcomes)
    return [
        *_named(outcomes, "≥ 0.90"),
        _share("a held-out gain is measured", [bool(o.held_out) for o in outcomes], "≥ 1"),
        _share("repeats of one test agree", repeats, "≥ 0.95"),
        *_false(outcomes), *_held_out(outcomes), *_intervals(outcomes, False), *_sound(outcomes),
    ]  # fmt: skip


# Which numbers are asked for; of families that are not listed, whether the first that is named is right.
TABLES: dict[str, Callable[[Outcomes], list[Line]]] = {
    "messy": _messy, "gaps": _messy, "model-error": _model_error, "bench": _measured, "rigid": _measured,
}  # fmt: skip


def summary(family: str, outcomes: Outcomes) -> list[Line]:
    """Return the numbers of a family's table."""
    return TABLES.get(family, _first)(outcomes)


def groups(outcomes: Outcomes) -> dict[tuple[str, str], list[FamilyOutcome]]:
    """Return outcomes by family and engine."""
    out: dict[tuple[str, str], list[FamilyOutcome]] = defaultdict(list)
    for o in outcomes:
        out[o.family, o.engine].append(o)
    return dict(out)


def reliability(outcomes: Outcomes, edges: Sequence[float] = (0.0, 0.5, 0.7, 0.9, 0.95, 0.99, 1.0)) -> list[list[Any]]:
    """Return, for each interval of confidence: its ends, mean confidence, share that is right, count."""
    pairs = np.array([p for o in outcomes for p in o.confidences], dtype=float).reshape(-1, 2)
    rows = []
    for low, high in pairwise(edges):
        inside = (pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == edges[-1]))
        if inside.any():
            mean, right = pairs[inside].mean(axis=0)
            rows.append([low, high, float(mean), float(right), int(inside.sum())])
    return rows


def markdown(outcomes: Outcomes, seed: int, version: str) -> str:
    """Return the families' tables as Markdown."""
    return "\n".join(_table(f, e, own, seed, version) for (f, e), own in groups(outcomes).items())


def _table(family: str, engine: str, outcomes: Outcomes, seed: int, version: str) -> str:
    simulated = "" if engine == "own" else f", simulated by {engine}"
    rows = [f"Family {family}{simulated}, seed {seed}, vsalog {version}, {len(outcomes)} cases.", ""]
    rows += [f"| {family} | value | asked | met | of |", "| --- | --- | --- | --- | --- |"]
    for line in summary(family, outcomes):
        met = {None: "", True: "yes", False: "no"}[line.met]
        rows.append(f"| {line.what} | {_number(line)} | {line.asked} | {met} | {line.count} |")
    verdicts = Counter(o.ended if not o.failed else "none" for o in outcomes)
    rows += ["", "Verdicts: " + ", ".join(f"{v} {n}" for v, n in verdicts.most_common()) + ".", ""]
    rows += [
        "| device | complete | with a false cause | held-out error over the floor, median |",
        "| --- | --- | --- | --- |",
    ]
    for device in sorted({o.device for o in outcomes}):
        own = [o for o in outcomes if o.device == device]
        ratio = median([o.worst for o in own if o.held_out])
        shown = "–" if ratio is None else f"{ratio:.3g}"
        rows.append(
            f"| {device} | {sum(o.complete for o in own)}/{len(own)} | {sum(bool(o.false) for o in own)}/{len(own)} | {shown} |"
        )
    for what, counted in (("Missed", _missed(outcomes)), ("False", Counter(f for o in outcomes for f in o.false))):
        if counted:
            rows += ["", f"{what}: " + ", ".join(f"{name} {n}" for name, n in counted.most_common(12)) + "."]
    curve = reliability(outcomes)
    if curve:
        rows += ["", "| confidence | mean | right | causes |", "| --- | --- | --- | --- |"]
        rows += [f"| {low:g} to {high:g} | {mean:.3f} | {right:.3f} | {n} |" for low, high, mean, right, n in curve]
    return "\n".join(rows) + "\n"


def true_rig_table(outcomes: Outcomes) -> str:
    """Return what diagnoses make of rigs as they truly are: verdict, errors over their floors, what is named none the less."""
    rows = ["| case | verdict | simulation over its floor | equation over its noise | named | hidden |"]
    rows += ["| --- | --- | --- | --- | --- | --- |"]
    for o in outcomes:
        worst = [max(d.items(), key=lambda x: x[1], default=("–", float("nan"))) for d in (o.simulated, o.equations)]
        shown = [f"{name} {ratio:.2f}" for name, ratio in worst]
        rows.append(
            f"| {o.case} ({o.device}) | {o.ended} | {' | '.join(shown)} | {', '.join(o.named)} | {', '.join(o.truth)} |"
        )
    errors = [max(o.simulated.values()) for o in outcomes if o.simulated]
    lines = [
        _share("consistent", [o.ended.startswith("consistent") for o in outcomes]),
        _share("anything named", [bool(o.named) for o in outcomes]),
        Line("simulation over its floor, worst signal, median", median(errors), len(errors)),
        _share("… at most 1.5 times", [e <= 1.5 for e in errors]),
    ]
    return "\n".join([*rows, "", *(f"{x.what}: {_number(x)} ({x.count} cases)" for x in lines)]) + "\n"


def _missed(outcomes: Outcomes) -> Counter[str]:
    return Counter(
        t for o in outcomes for t, r, a in zip(o.truth, o.right, o.asked, strict=True) if a and not r
    )  # fmt: skip


def document(outcomes: Outcomes) -> list[dict[str, Any]]:
    """Return the families' numbers and cases as JSON."""
    return [
        {
            "family": family,
            "engine": engine,
            "numbers": [
                {"what": x.what, "value": x.value, "cases": x.count, "asked": x.asked, "met": x.met}
                for x in summary(family, own)
            ],
            "reliability": reliability(own),
            "cases": [asdict(o) for o in own],
        }
        for (family, engine), own in groups(outcomes).items()
    ]
