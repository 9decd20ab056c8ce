"""`python -m tests.hidden_effects.battery --seed S --out DIR`: hide effects, have them diagnosed, score.

Cases are made, `vsalog diagnose LOG --rig rig.toml --holdout holdout.parquet -o DIR` is run on each, and only then the truth is
read. Results are printed, and written as battery.json and battery.md.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from .alike import fits_equally
from .cases import Plan, make_case
from .devices import ALL_DEVICES, DEVICES
from .families import ENGINES, FAMILIES
from .family_report import document as family_document
from .family_report import markdown as family_markdown
from .family_report import true_rig_table
from .family_scoring import FamilyOutcome, score_family
from .generate import KINDS, family_plans, generate, plans
from .report import by_device, document, markdown
from .scoring import Outcome, read, score

# How the cases are shared among the kinds.
SHARES = {"clean": 0.12, "single": 0.38, "pair": 0.18, "reduced": 0.22, "outside": 0.10}
# Cases of a whole battery, some 25 minutes of two cores, and of a quick one.
FULL, QUICK = 130, 24
# Cases of a family.
FAMILY = 60
# A diagnosis that takes longer has failed [s].
PATIENCE = 600


def lay_out(
    cases: int | None, seed: int, devices: tuple[str, ...] | None, kinds: tuple[str, ...], engine: str = "own"
) -> list[Plan]:
    """Return the plans of a battery: cases shared among the kinds, and so many of each family."""
    shares = {k: SHARES[k] for k in kinds if k in SHARES}
    out = []
    for kind, part in shares.items():
        count = max(1, round((cases or FULL) * part / sum(shares.values())))
        out += plans(kind, count, seed, devices or tuple(DEVICES))
    families = [k for k in kinds if k in FAMILIES]
    return out + [p for k in families for p in family_plans(k, cases or FAMILY, seed, devices, engine)]


def diagnose(folder: Path, rig: Path | None = None, into: str = "diagnosis") -> tuple[float, str]:
    """Diagnose one case through the command's entry point; return how long it took and what went wrong."""
    from click.testing import CliRunner

    from vsalog.cli import cli

    log, holdout, out = (folder / n for n in ("log.parquet", "holdout.parquet", into))
    rig = rig or folder / "rig.toml"
    out.mkdir(exist_ok=True)
    arguments = ["diagnose", str(log), "--rig", str(rig), "--holdout", str(holdout), "-o", str(out)]
    begin = time.perf_counter()
    signal.signal(signal.SIGALRM, _impatient)
    signal.alarm(PATIENCE)
    try:
        result = CliRunner().invoke(cli, arguments)
    finally:
        signal.alarm(0)
    took = time.perf_counter() - begin
    if result.exit_code in (0, 3):
        return took, ""
    said = str(result.exception or "") or result.output.strip().splitlines()[-1:] or ""
    return took, f"failed: {type(result.exception).__name__}: {said}"[:300]


def _impatient(*_: object) -> None:
    raise TimeoutError(f"no diagnosis within {PATIENCE} s")


def diagnose_all(folders: list[Path], workers: int, rigs: list[Path] | None = None, into: str = "diagnosis") -> None:
    """Diagnose cases, with other rigs perhaps; how long each took, and what went wrong, is kept next to its diagnosis."""
    rigs = rigs or [folder / "rig.toml" for folder in folders]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for done, (folder, (took, problem)) in enumerate(
            zip(folders, pool.map(diagnose, folders, rigs, [into] * len(folders)), strict=True), 1
        ):
            text = json.dumps({"seconds": took, "problem": problem})
            (folder / into / "run.json").write_text(text, encoding="utf-8")
            print(f"\r{done}/{len(folders)} diagnosed", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)


def judge(folders: list[Path], sealed: Path) -> list[Outcome | FamilyOutcome]:
    """Score what the diagnoses of cases say; those that were not diagnosed are left out."""
    outcomes = []
    for folder in folders:
        path = folder / "diagnosis" / "run.json"
        if path.exists():
            run = json.loads(path.read_text(encoding="utf-8"))
            diagnosis = None if run["problem"] else read(folder / "diagnosis")
            truth = json.loads((sealed / f"{folder.name}.json").read_text(encoding="utf-8"))
            scored = score_family if truth.get("family") else score
            outcomes.append(scored(truth, diagnosis, run["seconds"], run["problem"]))
    return outcomes


def look_again(folders: list[Path], workers: int) -> str:
    """Diagnose cases again with their extended rigs; return how often that finds something that matters."""
    rigs = [folder / "diagnosis" / "extended.rig.toml" for folder in folders]
    known = [(folder, rig) for folder, rig in zip(folders, rigs, strict=True) if rig.exists()]
    diagnose_all([folder for folder, _ in known], workers, [rig for _, rig in known], "again")
    more = {}
    for folder, _ in known:
        second = read(folder / "again")
        causes = second["causes"] if second else [{"cause": "no diagnosis", "part": ""}]
        more[folder.name] = [f"{c['cause']}@{c['part']}" for c in causes if c.get("material") is not False]
    lines = [f"- {name}: {', '.join(causes)}" for name, causes in more.items() if causes]
    return "\n".join([f"{len(lines)} of {len(known)} extended rigs are off by something that matters", *lines])


def look_at_sets(outcomes: list[Outcome], chosen: dict[str, Plan], workers: int) -> None:
    """Note for each member of a set whether it really fits as well as what was hidden."""
    asked = [o for o in outcomes if o.members and o.case in chosen]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        found = pool.map(_equal, [chosen[o.case] for o in asked], [o.members for o in asked])
        for outcome, equal in zip(asked, found, strict=True):
            outcome.equal = equal


def _equal(plan: Plan, members: list[str]) -> list[bool]:
    case, rng = make_case(plan), np.random.default_rng(plan.seed)
    found = [[fits_equally(one, case.bench, member, rng) for one in case.hidden] for member in members]
    return [any(own) for own in found if any(answer is not None for answer in own)]


def write(outcomes: list[Outcome | FamilyOutcome], out: Path, seed: int) -> str:
    """Write battery.json and battery.md; return the latter."""
    from vsalog._version import __version__

    single = [o for o in outcomes if isinstance(o, Outcome)]
    families = family_document([o for o in outcomes if isinstance(o, FamilyOutcome)])
    numbers = document(single, seed, __version__) | {"families": families}
    texts = [markdown(single, seed, __version__), by_device(single)] if single else []
    texts += [family_markdown(families, seed, __version__)] if families else []
    text = "\n".join(texts)
    (out / "battery.md").write_text(text, encoding="utf-8")
    (out / "battery.json").write_text(json.dumps(numbers, indent=1), encoding="utf-8")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.hidden_effects.battery", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("battery"))
    parser.add_argument("--cases", type=int, help=f"how many; {FULL} when absent, {FAMILY} of a family")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} cases, and sets are not looked into")
    parser.add_argument("--device", choices=list(ALL_DEVICES), action="append", help="default: all")
    parser.add_argument("--kind", choices=[*KINDS, *FAMILIES], action="append", help="default: all but families")
    parser.add_argument("--engine", choices=ENGINES, default="own", help="that simulates families")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument(
        "--again", action="store_true", help="take the cases that lie in --out, made with the same options"
    )
    parser.add_argument(
        "--score", action="store_true", help="score the diagnoses that lie in --out, made with the same options"
    )
    parser.add_argument(
        "--true",
        action="store_true",
        help="diagnose families with the rig as it truly is: what is then off is no cause",
    )
    parser.add_argument(
        "--extended",
        action="store_true",
        help="diagnose the cases that lie in --out again, each with its extended rig: nothing that matters is left to find",
    )
    given = parser.parse_args()
    # Workers side by side, one to a core: linear algebra with threads of its own would make them wait for one another.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    devices, kinds = tuple(given.device or ()) or None, tuple(given.kind or KINDS)
    chosen = lay_out(given.cases or (QUICK if given.quick else None), given.seed, devices, kinds, given.engine)
    if not (given.again or given.score or given.extended):
        for problem in generate(chosen, given.out, given.workers):
            print(f"not made: {problem}", file=sys.stderr)
    names = [p.name for p in chosen if (given.out / "sealed" / f"{p.name}.json").exists()]
    folders = [given.out / name for name in names]
    if given.true:
        diagnose_all(folders, given.workers, [given.out / "sealed" / f"{name}.rig.toml" for name in names])
        print(true_rig_table(judge(folders, given.out / "sealed")))
        return
    if given.extended:
        print(look_again(folders, given.workers))
        return
    if not given.score:
        diagnose_all(folders, given.workers)
    outcomes = judge(folders, given.out / "sealed")
    if not given.quick:
        look_at_sets(
            [o for o in outcomes if isinstance(o, Outcome)],
            {p.name: p for p in chosen if p.name in names},
            given.workers,
        )
    print(write(outcomes, given.out, given.seed))


if __name__ == "__main__":
    main()
