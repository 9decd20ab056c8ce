"""How often a cause that is reported with some confidence is present: the reliability curve of `vsalog diagnose`.

    python -m benchmarks.confidence [--machines 1000] [--seed 1] [--family NAME …] [--out DIR] [--workers 2] [--score]

As many machines are drawn, shared among the families of hidden effects, each with a random rig, effects and noises, and
diagnosed; `--score` counts those that lie in DIR. Of each interval of confidence the mean, the share that is right, and the 95 %
interval of that share (Wilson 1927, JASA 22(158)) are printed; and how large classes are. Exits with 1 where the interval of a
share does not hold the mean confidence. A cause counts as right where it is hidden in the machine, a class where a member is.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from tests.hidden_effects.battery import diagnose_all, judge
from tests.hidden_effects.family_report import curve, reliability
from tests.hidden_effects.family_scoring import FamilyOutcome
from tests.hidden_effects.generate import family_plans, generate

FAMILIES = ("messy", "model-error", "closed-loop", "low-rate", "coarse", "short", "current", "rigid")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.confidence", description=__doc__)
    parser.add_argument("--machines", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--family", choices=FAMILIES, action="append", help="default: all")
    parser.add_argument("--out", type=Path, default=Path("battery/confidence"))
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--score", action="store_true", help="count the diagnoses that lie in --out")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    names = given.family or FAMILIES
    outcomes: list[FamilyOutcome] = []
    for name in names:
        chosen, out = family_plans(name, -(-given.machines // len(names)), given.seed), given.out / name
        if not given.score:
            for problem in generate(chosen, out, given.workers):
                print(f"not made: {problem}", file=sys.stderr)
        folders = [out / p.name for p in chosen if (out / "sealed" / f"{p.name}.json").exists()]
        if not given.score:
            diagnose_all(folders, given.workers)
        outcomes += [o for o in judge(folders, out / "sealed") if isinstance(o, FamilyOutcome)]
    sys.exit(0 if calibrated(outcomes) else 1)


def calibrated(outcomes: list[FamilyOutcome]) -> bool:
    """Print the curves of causes and of classes; tell whether they are the diagonal as far as the machines can say."""
    sizes = [len(c) for o in outcomes for c in o.classes]
    print(f"{len(outcomes)} machines; classes have {np.median(sizes) if sizes else 0:g} members in the median\n")
    good = True
    for of in ("confidences", "class_confidences"):
        rows = reliability([c for o in outcomes for c in getattr(o, of)])
        print(f"{of.replace('_', ' ').capitalize()}\n\n{curve(rows)}")
        shares = [(mean, binomtest(round(right * n), n).proportion_ci(method="wilson")) for *_, mean, right, n in rows]
        good &= all(share.low <= mean <= share.high for mean, share in shares)
    return good


if __name__ == "__main__":
    main()
