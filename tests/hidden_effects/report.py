"""The battery's numbers: what is asked of a diagnosis, and how often it is met."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .scoring import PLAIN, Outcome, median, share

NOTHING = "(nothing)"


@dataclass(frozen=True)
class Line:
    """One number, what it is of, and what is asked of it ("≥ 0.97")."""

    what: str
    value: float | None
    count: int
    asked: str = ""

    @property
    def met(self) -> bool | None:
        """Whether it is as asked; none where nothing is asked or there is no number."""
        if not self.asked or self.value is None:
            return None
        sign, limit = self.asked.split()
        return self.value >= float(limit) if sign == "≥" else self.value <= float(limit)


def summary(outcomes: Sequence[Outcome]) -> list[Line]:
    """Return every number that is asked for."""
    kinds: dict[str, list[Outcome]] = defaultdict(list)
    for o in outcomes:
        kinds[o.kind].append(o)
    plain = [o for o in kinds["single"] if o.sizes[0] >= PLAIN]
    faint = [o for o in kinds["single"] if o.sizes[0] < PLAIN]
    lines = [
        _share("one effect, at 5 times the noise or more: named first", [o.first for o in plain], "≥ 0.97"),
        _share("… whatever the part it is at", [o.cause_only for o in plain]),
        _share("… nothing else named", [o.extra == 0 for o in plain]),
        _share("one effect, below 5 times the noise: named first", [o.first for o in faint]),
        _share("clean log: anything named", [bool(o.named) or o.failed for o in kinds["clean"]], "≤ 0.03"),
        _share("clean log: not called consistent", [o.ended != "consistent" for o in kinds["clean"]]),
        _share("two effects: both named", [all(o.right) for o in kinds["pair"]], "≥ 0.90"),
        _share("… both at 5 times the noise or more", [all(o.right) for o in kinds["pair"] if min(o.sizes) >= PLAIN]),
        _share("… at least one named", [any(o.right) for o in kinds["pair"]]),
        _share("… a third one named", [o.extra > 0 for o in kinds["pair"]]),
    ]
    reduced = kinds["reduced"]
    for roles in sorted({o.roles for o in reduced}):
        own = [o for o in reduced if o.roles == roles]
        lines += [
            _share(f"{roles}: named first, or in the set", [o.in_set for o in own], "≥ 0.95"),
            _share(f"… named first ({roles})", [o.first for o in own]),
            Line(
                f"… size of the set, median ({roles})",
                median([o.set_size for o in own if not o.failed]),
                len(own),
                "≤ 3",
            ),
            _share(f"… members that really fit as well ({roles})", [e for o in own for e in o.equal]),
        ]
    estimates = [e for o in outcomes for e in o.estimates]
    finite = [e for e in estimates if np.isfinite(e.error)]
    lines += [
        _share(
            "parameters of what is rightly named: 95 % interval holds the truth",
            [e.covered for e in estimates],
            "≥ 0.90",
        ),
        Line("… error, median", median([e.error for e in finite]), len(finite), "≤ 0.05"),
        Line("… error relative to the change from the rig, median", median([e.of_change for e in finite]), len(finite)),
    ]
    hidden = [o for o in outcomes if o.kind in ("single", "pair", "clean")]
    gains = [float(np.median(o.gains)) for o in hidden if o.gains]
    lines += [
        Line("extended simulation's held-out error over the noise floor, median", median(gains), len(gains), "≤ 1.2"),
        _share("causes kept that make the held-out error larger", [o.worse for o in outcomes if o.named], "≤ 0"),
    ]
    outside = [o for o in kinds["outside"] if o.sizes[0] >= PLAIN]
    good = [o.outside and all(o.outside[k] for k in ("unexplained", "side", "variable")) for o in outside]
    lines += [
        _share(
            "outside the catalogue: (partly) unexplained, right side and variable", [bool(g) for g in good], "≥ 0.80"
        ),
        _share("… (partly) unexplained", [bool(o.outside.get("unexplained")) for o in outside]),
        _share("… right side", [bool(o.outside.get("side")) for o in outside]),
        _share("… right variable", [bool(o.outside.get("variable")) for o in outside]),
        _share("… explained by a wrong name", [bool(o.outside.get("confident")) for o in outside], "≤ 0.10"),
    ]
    times = [o.seconds for o in outcomes if o.seconds > 0.0]
    lines += [
        Line("seconds a diagnosis takes, median", median(times), len(times)),
        Line("… longest", max(times, default=None), len(times)),
        _share("command failed", [o.failed for o in outcomes], "≤ 0"),
    ]
    return lines


def _share(what: str, flags: Sequence[bool], asked: str = "") -> Line:
    return Line(what, share(flags), len(flags), asked)


def confusion(outcomes: Sequence[Outcome]) -> dict[str, Counter[str]]:
    """Return, of single effects with full roles, hidden cause → what was named first, counted."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for o in outcomes:
        if o.kind in ("single", "clean"):
            hidden = o.truth[0].split("@")[0] if o.truth else NOTHING
            named = hidden if o.first else o.named[0].split("@")[0] if o.named else NOTHING
            if named == hidden and not o.first and o.truth:
                named = f"{named} elsewhere"
            table[hidden][named] += 1
    return dict(sorted(table.items()))


def markdown(outcomes: Sequence[Outcome], seed: int, version: str) -> str:
    """Return numbers and confusion as Markdown."""
    rows = [f"Seed {seed}, vsalog {version}, {len(outcomes)} cases.", "", numbers_table(as_data(summary(outcomes)))]
    rows += [
        "What was named first where one effect was hidden:",
        "",
        "| hidden | right | wrong |",
        "| --- | --- | --- |",
    ]
    for hidden, named in confusion(outcomes).items():
        wrong = ", ".join(f"{k} {n}" for k, n in named.most_common() if k != hidden)
        rows.append(f"| {hidden} | {named[hidden]}/{sum(named.values())} | {wrong} |")
    return "\n".join(rows) + "\n"


def as_data(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """Return numbers as JSON has them."""
    return [{"what": x.what, "value": x.value, "cases": x.count, "asked": x.asked, "met": x.met} for x in lines]


def numbers_table(numbers: Sequence[Mapping[str, Any]], title: str = "") -> str:
    """Return numbers, as `as_data` gives them, as a table in Markdown."""
    rows = [f"| {title} | value | asked | met | of |", "| --- | --- | --- | --- | --- |"]
    for line in (Line(x["what"], x["value"], x["cases"], x["asked"]) for x in numbers):
        met = {None: "", True: "yes", False: "no"}[line.met]
        rows.append(f"| {line.what} | {_number(line)} | {line.asked} | {met} | {line.count} |")
    return "\n".join(rows) + "\n"


def by_device(outcomes: Sequence[Outcome]) -> str:
    """Return the share that is named first per device, as Markdown."""
    rows = ["| device | one effect ≥ 5×: named first | two: both named | false alarms |", "| --- | --- | --- | --- |"]
    for device in sorted({o.device for o in outcomes}):
        own = [o for o in outcomes if o.device == device]
        single = [o.first for o in own if o.kind == "single" and o.sizes[0] >= PLAIN]
        pairs = [all(o.right) for o in own if o.kind == "pair"]
        clean = [bool(o.named) or o.failed for o in own if o.kind == "clean"]
        rows.append(f"| {device} | " + " | ".join(_counted(f) for f in (single, pairs, clean)) + " |")
    return "\n".join(rows) + "\n"


def _counted(flags: Sequence[bool]) -> str:
    return f"{sum(flags)}/{len(flags)}" if flags else "–"


def _number(line: Line) -> str:
    return "–" if line.value is None else f"{line.value:.3g}"


def document(outcomes: Sequence[Outcome], seed: int, version: str) -> dict[str, Any]:
    """Return everything as one JSON document."""
    return {
        "seed": seed,
        "version": version,
        "numbers": as_data(summary(outcomes)),
        "confusion": {k: dict(v) for k, v in confusion(outcomes).items()},
        "cases": [
            {
                "case": o.case, "device": o.device, "roles": o.roles, "hidden": o.truth, "sizes": o.sizes, "ended": o.ended,
                "named": o.named, "first": o.first, "right": o.right, "in_set": o.in_set, "set": o.members, "equal": o.equal,
                "estimates": [[e.name, e.covered, e.error, e.of_change] for e in o.estimates],
                "gains": o.gains, "outside": o.outside, "seconds": o.seconds,
            }
            for o in outcomes
        ],
    }  # fmt: skip
