"""One table per family: what is asked of a diagnosis there, and how often it is met."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from .family_scoring import FamilyOutcome, agree
from .report import Line, _number, _share, as_data, numbers_table
from .scoring import median

# A log that is called explained is simulated within so many times its noise floor.
EXPLAINED = 2.0
# Ends of the intervals of confidence.
EDGES = (0.0, 0.5, 0.7, 0.9, 0.95, 0.99, 1.0)
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


def reliability(found: Sequence[tuple[float, bool]], edges: Sequence[float] = EDGES) -> list[list[Any]]:
    """Return, for each interval of confidence: its ends, mean confidence, share that is right, count.

    Parameters
    ----------
    found : confidences, and whether each was right
    edges : of the intervals
    """
    pairs = np.array(found, dtype=float).reshape(-1, 2)
    rows = []
    for low, high in pairwise(edges):
        inside = (pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == edges[-1]))
        if inside.any():
            mean, right = pairs[inside].mean(axis=0)
            rows.append([low, high, float(mean), float(right), int(inside.sum())])
    return rows


def pooled(curves: Sequence[Sequence[Sequence[Any]]]) -> list[list[Any]]:
    """Return the reliability of several curves' causes together."""
    sums: dict[tuple[float, float], NDArray[np.float64]] = {}
    for low, high, mean, right, count in (row for rows in curves for row in rows):
        sums[low, high] = sums.get((low, high), np.zeros(3)) + count * np.array([mean, right, 1.0])
    return [[*ends, *(float(x) for x in total[:2] / total[2]), int(total[2])] for ends, total in sorted(sums.items())]


def markdown(families: Sequence[Mapping[str, Any]], seed: int, version: str) -> str:
    """Return the families' tables as Markdown; families as `document` gives them."""
    tables = []
    for found in families:
        simulated = "" if found["engine"] == "own" else f", simulated by {found['engine']}"
        title = f"Family {found['family']}{simulated}, seed {seed}, vsalog {version}, {found['count']} cases."
        tables.append(f"{title}\n\n{table(found)}\n{curve(found['class_reliability'])}")
    return "\n".join(tables)


def table(found: Mapping[str, Any]) -> str:
    """Return what is asked of a family and how often it is met, its verdicts, devices, and what was missed, as Markdown."""
    rows = [numbers_table(found["numbers"], found["family"])]
    rows += ["Verdicts: " + ", ".join(f"{v} {n}" for v, n in found["verdicts"].items()) + ".", ""]
    rows += [
        "| device | complete | with a false cause | held-out error over the floor, median |",
        "| --- | --- | --- | --- |",
    ]
    for device, own in found["devices"].items():
        shown = "–" if own["ratio"] is None else f"{own['ratio']:.3g}"
        rows.append(f"| {device} | {own['complete']}/{own['count']} | {own['false']}/{own['count']} | {shown} |")
    for what in ("missed", "false"):
        if found[what]:
            rows += ["", f"{what.capitalize()}: " + ", ".join(f"{name} {n}" for name, n in found[what].items()) + "."]
    return "\n".join(rows) + "\n"


def curve(rows: Sequence[Sequence[Any]]) -> str:
    """Return a reliability curve as Markdown, with the 95 % interval of each share (Wilson 1927, JASA 22(158))."""
    lines = ["| confidence | mean | right | 95 % | causes |", "| --- | --- | --- | --- | --- |"]
    for low, high, mean, right, count in rows:
        share = binomtest(round(right * count), count).proportion_ci(method="wilson")
        lines.append(
            f"| {low:g} to {high:g} | {mean:.3f} | {right:.3f} | {share.low:.3f} to {share.high:.3f} | {count} |"
        )
    return "\n".join(lines) + "\n"


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
    return [_family(family, engine, own) for (family, engine), own in groups(outcomes).items()]


def _family(family: str, engine: str, outcomes: Outcomes) -> dict[str, Any]:
    verdicts = Counter(o.ended if not o.failed else "none" for o in outcomes)
    false = Counter(f for o in outcomes for f in o.false)
    return {
        "family": family,
        "engine": engine,
        "count": len(outcomes),
        "numbers": as_data(summary(family, outcomes)),
        "verdicts": dict(verdicts.most_common()),
        "devices": {d: _device([o for o in outcomes if o.device == d]) for d in sorted({o.device for o in outcomes})},
        "missed": dict(_missed(outcomes).most_common(12)),
        "false": dict(false.most_common(12)),
        "reliability": reliability([c for o in outcomes for c in o.confidences]),
        "class_reliability": reliability([c for o in outcomes for c in o.class_confidences]),
        "class_sizes": dict(sorted(Counter(len(c) for o in outcomes for c in o.classes).items())),
        "cases": [asdict(o) for o in outcomes],
    }


def _device(own: Outcomes) -> dict[str, Any]:
    return {
        "count": len(own),
        "complete": sum(o.complete for o in own),
        "false": sum(bool(o.false) for o in own),
        "ratio": median([o.worst for o in own if o.held_out]),
    }
