"""`python -m tests.hidden_effects.several --seed S --cases N --out DIR`: several logs of one machine, diagnosed together.

A story says what differs from log to log: a backlash grows, a spring softens, friction grows, payloads are exchanged, or nothing
is wrong at all. Two more say what one log cannot tell and two can: a payload along with a wrong inertia, and which of two
encoders has a wrong zero. Every log has a motion, noise and a rate of its own. `vsalog diagnose` is run on all logs and, to
compare with, on one of them alone. Results are printed, and written as several.json and several.md.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from .alike import BROUGHT, difference
from .bench import Bench, Hidden, wild
from .cases import VARIANTS, write_log
from .devices import DEVICES
from .effects import EFFECTS
from .motion import LEAD, Wanted
from .scoring import read
from .sensors import random_qualities, recorded

SECONDS, MONTH = 8.0, 30.0
BEGAN = datetime(2026, 1, 12, 8, tzinfo=UTC).timestamp()
# How visible what is hidden is in the log where it is largest, in multiples of noise.
SIZES = 10.0, 100.0
ATTEMPTS = 300
# What is wrong in all logs alike, in about half of the series.
ALIKE = ("motor.viscous_friction", "sensor.torque_gain", "motor.inertia", "link.viscous_friction")
# Two encoders look alike in a log where they differ by less than the first, and not where they differ by more than the second, in
# multiples of the noise of an average: some 300 averages of a log add up.
UNTOLD, TOLD = 0.05, 0.5


@dataclass(frozen=True)
class Story:
    """What differs from log to log.

    Attributes
    ----------
    logs : how many
    cause : that differs, or is looked for; its strength grows this way
    sign : of the strength; 0 where nothing is wrong
    devices : that it happens in
    shares : days, random generator → share of the strength in each log
    constant : what is wrong in all logs alike; drawn from `ALIKE` where empty
    differs : whether the cause may differ from log to log
    alone : the log that is diagnosed alone
    """

    logs: int
    cause: str
    sign: float
    devices: tuple[str, ...]
    shares: Callable[[np.ndarray, np.random.Generator], np.ndarray]
    constant: str = ""
    differs: bool = True
    alone: int = -1


def _grows(days: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return nothing up to some log, and from there on a line to the last one."""
    begins = days[rng.integers(0, len(days) - 3)]
    return np.clip((days - begins) / (days[-1] - begins), 0.0, 1.0)


def _exchanged(days: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return rng.permutation([0.0, 0.4, 0.4, 1.0, 1.0])


def _one_loaded(days: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.array([0.0, 1.0])


def _alike(days: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.ones(len(days))


BOTH, HANGING = ("elastic", "antagonistic"), ("elastic",)
STORIES = {
    "backlash": Story(10, "transmission.backlash", 1.0, ("elastic",), _grows),
    "softens": Story(10, "transmission.stiffness", -1.0, BOTH, _grows),
    "rubs": Story(10, "motor.coulomb_friction", 1.0, BOTH, _grows),
    "loads": Story(5, "link.payload", 1.0, BOTH, _exchanged),
    "clean": Story(5, "transmission.stiffness", 0.0, BOTH, _alike),
    "inertia": Story(2, "link.payload", 1.0, HANGING, _one_loaded, "link.inertia"),
    "zeros": Story(2, "sensor.encoder_offset", 1.0, HANGING, _alike, differs=False, alone=0),
}


@dataclass
class Case:
    """A machine over months: role → samples of each log, and what is true of each."""

    story: str
    device: str
    bench: Bench
    logs: list[dict[str, np.ndarray]]
    stamps: list[np.ndarray]
    days: list[float]
    changing: list[Hidden]
    other: Hidden | None


@dataclass
class Score:
    """How a case went; what does not apply is None, or empty."""

    case: str
    story: str
    device: str
    verdict: str
    found: bool | None = None
    onset: int | None = None
    rate: bool | None = None
    covered: list[bool] = field(default_factory=list)
    other: bool | None = None
    apart: bool | None = None
    false: list[str] = field(default_factory=list)
    changes: bool | None = None
    single_apart: bool | None = None
    single_false: list[str] = field(default_factory=list)
    seconds: float = 0.0
    single_seconds: float = 0.0


def make(name: str, device: str, seed: int) -> Case:
    """Make a case; another machine is drawn until what is hidden is as visible as asked for."""
    rng = np.random.default_rng([seed, 9])
    for _ in range(ATTEMPTS):
        case = _made(name, device, rng)
        if case is not None:
            return case
    raise RuntimeError(f"{name} is not visible in {device}, seed {seed}")


def _made(name: str, device: str, rng: np.random.Generator) -> Case | None:
    own, story = DEVICES[device], STORIES[name]
    nominal = own.random_machine(device, rng)
    missing = VARIANTS[str(rng.choice(["full", "no-torque-sensor"]))] if name in ("softens", "rubs", "clean") else ()
    if not EFFECTS[story.cause].parts(nominal) or not (nominal.link[0]["gravity"] or name != "zeros"):
        return None
    benches = [_bench(name, k, nominal, rng, missing) for k in range(story.logs)]
    if any(b is None for b in benches):
        return None
    last: Any = benches[-1]
    for b in benches:
        b.qualities, b.scales = last.qualities, last.scales  # one machine, one set of sensors
    days = np.cumsum([0.0, *rng.uniform(0.8 * MONTH, 1.2 * MONTH, story.logs - 1)])
    shares = story.shares(days, rng)
    one = other = None
    if story.sign:
        one = _hidden(story.cause, last, story.sign, rng)
        if one is None or (name == "zeros" and not _told_by_the_second(one, benches, rng)):
            return None
        constant = story.constant or (str(rng.choice(ALIKE)) if name != "zeros" and rng.random() < 0.5 else "")
        other = _hidden(constant, last, 1.0, rng, missing) if constant else None
        if constant and other is None:
            return None
    logs, stamps, changing = [], [], list[Hidden]()
    for share, b, day in zip(shares, benches, days, strict=True):
        there = [] if one is None else [Hidden(one.effect, one.part, one.shape, share * one.strength)]
        machine, sensors = b.changed([*([other] if other else []), *there])  # a payload hangs on the link as it is
        truth = own.happened(machine, b.follow)
        if truth is None or wild(truth, b.truth, b.most):
            return None
        said = recorded(truth, sensors, nominal, b.qualities, rng)
        logs.append({role: values for role, values in said.items() if role not in missing})
        stamps.append(BEGAN + 86400.0 * day + truth.period * np.arange(truth.inside.stop - truth.inside.start))
        changing += there
    return Case(name, device, last, logs, stamps, days.tolist(), changing, other)


def _bench(name: str, k: int, nominal: Any, rng: np.random.Generator, missing: tuple[str, ...]) -> Bench | None:
    own = DEVICES[nominal.device]
    follow = own.wanted(nominal, SECONDS, 2e-3 * rng.uniform(0.9, 1.1), rng, False)
    if name == "zeros":
        # First where the link is level and its weight does not change with the angle, then where it does.
        follow = _about(follow, nominal, *((0.5 * np.pi, 0.02) if k == 0 else (float(rng.uniform(-0.8, 0.8)), 0.1)))
    truth = own.happened(nominal, follow)
    if truth is None:
        return None
    qualities = random_qualities(nominal, truth, rng)
    return Bench(nominal, follow, truth, qualities, own.scales_of(nominal, truth), missing)


def _about(follow: Wanted, nominal: Any, angle: float, share: float) -> Wanted:
    """Return a share of the motion about an angle from where the link hangs."""
    values, centre = follow.values.copy(), float(nominal.link[0]["hangs_at"])
    time = np.arange(len(values)) * follow.period
    ease = np.clip(time / (0.8 * LEAD), 0.0, 1.0)
    ease = ease**3 * (10.0 - 15.0 * ease + 6.0 * ease**2)
    values[:, 0, 0] = ease * (centre + angle) + share * (values[:, 0, 0] - ease * centre)
    values[:, 0, 1] = np.gradient(values[:, 0, 0], follow.period)
    return Wanted(values, follow.period, follow.poor)


def _told_by_the_second(one: Hidden, benches: Sequence[Bench], rng: np.random.Generator) -> bool:
    """Tell whether the two encoders' zeros look alike in the first log, and not in the second."""
    (elsewhere,) = {"motor_position", "link_position"} - {one.part}
    first, second = (difference(one, b, one.effect.cause, elsewhere, rng) for b in benches)
    return first < UNTOLD and second > TOLD


def _hidden(
    cause: str, bench: Bench, sign: float, rng: np.random.Generator, missing: tuple[str, ...] = ()
) -> Hidden | None:
    effect = EFFECTS[cause]
    parts = [p for p in effect.parts(bench.nominal) if p not in missing]
    if not parts:
        return None
    part = str(rng.choice(parts))
    one = Hidden(effect, part, effect.shape(rng, bench.nominal, part, bench.scales), 0.0)
    ok = bench.scaled(one, float(np.exp(rng.uniform(*np.log(SIZES)))), sign)
    return one if ok and SIZES[0] * 0.9 <= one.size <= SIZES[1] * 1.1 else None


def write(case: Case, folder: Path) -> list[Path]:
    """Write logs and the nominal rig; return the logs."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = DEVICES[case.device].rig_text(case.bench.nominal, list(case.logs[0]))
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    paths = [folder / f"log{k}.parquet" for k in range(len(case.logs))]
    for path, roles, stamps in zip(paths, case.logs, case.stamps, strict=True):
        write_log(roles, stamps, path)
    return paths


def diagnose(logs: list[Path], folder: Path, into: str, differs: str = "") -> tuple[Any, float]:
    """Diagnose logs by the command's entry point; return the document, or what failed, and how long it took."""
    from click.testing import CliRunner

    from vsalog.cli import cli

    begin = time.perf_counter()
    arguments = ["diagnose", *map(str, logs), "--rig", str(folder / "rig.toml"), "-o", str(folder / into)]
    result = CliRunner().invoke(cli, [*arguments, *(("--differs", differs) if differs else ())])
    took = time.perf_counter() - begin
    return (read(folder / into) if result.exit_code in (0, 3) else f"{result.exception!r} {result.output}"), took


def score(name: str, case: Case, together: Any, alone: Any) -> Score:
    """Hold a diagnosis of all logs, and one of a log alone, against the truth."""
    failed = next((d for d in (together, alone) if isinstance(d, str)), None)
    if failed is not None:
        return Score(name, case.story, case.device, f"failed: {failed[-200:]}")
    out, story = Score(name, case.story, case.device, together["verdict"]), STORIES[case.story]
    hidden = [*case.changing[:1], *([case.other] if case.other else [])]
    out.false, out.single_false = (_false(d, hidden) for d in (together, alone))
    if case.other is not None:
        out.other = _named(together, case.other)
    if not case.changing:
        out.changes = bool(together["trends"])
        return out
    first, largest = case.changing[0], max(case.changing, key=lambda h: abs(h.strength))
    out.found = _named(together, largest)
    if case.story in ("inertia", "zeros"):
        out.apart, out.single_apart = (out.false == [] and _apart(d, hidden) for d in (together, alone))
    if not story.differs:
        return out
    trends = {t["number"]: t for t in together["trends"] if (t["cause"], t["part"]) == _key(first)}
    for number, trend in trends.items():
        # Of a payload that is not there nothing says where it is.
        known = [(i, h) for i, h in zip(trend["intervals"], case.changing, strict=True) if h.strength]
        # Of a shape, as what dry friction gives way before it slides, a series has no truth to be scored by.
        truths = [(i, h.parameters[number]) for i, h in known if number in h.parameters]
        out.covered += [bool(low <= truth <= high) for (low, high), truth in truths]
    if case.story in ("loads", "inertia") or not trends:
        return out
    (number,) = first.parameters
    began = next(k for k, h in enumerate(case.changing) if h.strength)
    trend = trends[number]
    out.onset = len(case.days) if trend["since"] is None else trend["logs"].index(trend["since"]) - began
    values = [h.parameters[number] for h in case.changing]
    grows = (values[-1] - values[began]) / (case.days[-1] - case.days[began])
    slowest, fastest = trend["per_day_interval"] or (np.inf, -np.inf)
    out.rate = bool(slowest <= grows <= fastest)
    return out


def _key(one: Hidden) -> tuple[str, str]:
    return one.effect.cause, one.part


def _named(document: Any, truth: Hidden) -> bool:
    """Tell whether a cause is named, or a class that it is in."""
    causes = document["causes"]
    classes = [m.split(" ")[0] for c in causes for m in c["indistinguishable_from"]]
    return any((c["cause"], c["part"]) == _key(truth) for c in causes) or truth.effect.cause in classes


def _apart(document: Any, hidden: Sequence[Hidden]) -> bool:
    """Tell whether all that is hidden is named, and in a class of its own each."""
    causes = {(c["cause"], c["part"]): c for c in document["causes"] if c["material"]}
    own = [causes.get(_key(h)) for h in hidden]
    return all(c is not None and not c["indistinguishable_from"] for c in own)


def _false(document: Any, hidden: Sequence[Hidden]) -> list[str]:
    """Return the material causes that were not hidden, and have nothing that was in their class."""
    keys, names = {_key(h) for h in hidden}, {h.effect.cause for h in hidden}
    keys |= {(brought, h.part) for h in hidden for brought in BROUGHT.get(h.effect.cause, ())}
    return sorted(
        {
            f"{c['cause']}@{c['part']}"
            for c in document["causes"]
            if c["material"]
            and (c["cause"], c["part"]) not in keys
            and not names & {m.split(" ")[0] for m in c["indistinguishable_from"]}
        }
    )


def table(scores: Sequence[Score]) -> str:
    """Return a row per story, and what each case got wrong."""

    def share(values: Sequence[Any]) -> str:
        known = [bool(v) for v in values if v is not None]
        return f"{sum(known)}/{len(known)}" if known else "–"

    heads = (
        "story", "found, or its class", "told apart", "… by one log", "… where one log does not", "onset within one log",
        "rate in its interval", "intervals that hold the truth", "the constant cause found", "a false material cause",
        "… from one log", "nothing wrong, yet something changes", "fails", "time of one log's",
    )  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|" + " --- |" * len(heads)]
    for name in dict.fromkeys(s.story for s in scores):
        own = [s for s in scores if s.story == name]
        done = [s for s in own if not s.verdict.startswith("failed")]
        ratio = float(np.median([s.seconds / s.single_seconds for s in done])) if done else float("nan")
        cells = (
            name, share([s.found for s in done]), share([s.apart for s in done]), share([s.single_apart for s in done]),
            share([s.apart for s in done if s.single_apart is False]),
            share([None if s.onset is None else abs(s.onset) <= 1 for s in done]), share([s.rate for s in done]),
            share([c for s in done for c in s.covered]), share([s.other for s in done]), share([bool(s.false) for s in done]),
            share([bool(s.single_false) for s in done]), share([s.changes for s in done]),
            share([s.verdict.startswith("failed") for s in own]), f"{ratio:.1f} ×",
        )  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    lines.append("")
    for s in scores:
        wrong = [
            *(["not found"] if s.found is False else []),
            *(["not told apart"] if s.apart is False else []),
            *([f"onset off by {s.onset}"] if s.onset else []),
            *(["rate outside"] if s.rate is False else []),
            *([f"{s.covered.count(False)} of {len(s.covered)} intervals miss"] if False in s.covered else []),
            *(["the other not found"] if s.other is False else []),
            *(["something changes"] if s.changes else []),
            *(f"false: {name}" for name in s.false),
            *(f"false in one log alone: {name}" for name in s.single_false),
            *([s.verdict] if s.verdict.startswith("failed") else []),
        ]
        lines += [f"- {s.case} ({s.device}): {'; '.join(wrong)}"] if wrong else []
    return "\n".join(lines) + "\n"


def main() -> None:
    """Make cases, have them diagnosed, score."""
    parser = argparse.ArgumentParser(prog="python -m tests.hidden_effects.several", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=10, help="of each story")
    parser.add_argument("--out", type=Path, default=Path("battery/several"))
    parser.add_argument("--story", choices=list(STORIES), action="append", help="default: all")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    scores = list[Score]()
    given.out.mkdir(parents=True, exist_ok=True)
    for i in range(given.cases):
        for story in given.story or list(STORIES):
            own = STORIES[story]
            name, device = f"{story}-{i:03d}", own.devices[i % len(own.devices)]
            case = make(story, device, given.seed * 1000 + i)
            logs, folder = write(case, given.out / name), given.out / name
            together, seconds = diagnose(logs, folder, "together", own.cause if own.differs else "")
            alone, single = diagnose([logs[own.alone]], folder, "alone")
            scored = score(name, case, together, alone)
            scored.seconds, scored.single_seconds = seconds, single
            scores.append(scored)
            (given.out / "several.json").write_text(json.dumps([asdict(s) for s in scores], indent=1), encoding="utf-8")
            (given.out / "several.md").write_text(table(scores), encoding="utf-8")
    print(table(scores))


if __name__ == "__main__":
    main()
