"""Whether the p-values of `vsalog diagnose` are uniform for machines that equal their rigs.

    python -m benchmarks.clean [--logs 500] [--seed 1] [--device NAME …] [--out DIR] [--workers 2] [--again]

Logs of machines without any effect are made by the equations of tests/hidden_effects, which hold torques from sample to sample,
and the rig is compared with each. `--again` takes the logs that lie in DIR. Prints the share of
p-values below some levels and the Kolmogorov–Smirnov test of their being uniform; exits with 1 where that has a probability
below 1 %.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.stats import kstest

from tests.hidden_effects.devices import DEVICES
from tests.hidden_effects.generate import generate, plans

LEVELS = (0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9)
# Least probability of the test below which p-values are not called uniform.
REJECTED = 0.01


def p_value_of(folder: Path) -> float:
    """Return the p-value of the rig of a case, as `vsalog diagnose` has it before it looks for causes."""
    from vsalog.diagnosis import run, selection
    from vsalog.diagnosis.posterior import Problem
    from vsalog.diagnosis.priors import felt
    from vsalog.diagnosis.setting import setting_of
    from vsalog.residuals.channels import channels_of
    from vsalog.residuals.kinds import balance_for
    from vsalog.residuals.sensing import at_joint
    from vsalog.residuals.system import build_system

    log, options = folder / "log.parquet", run.Options(rig=folder / "rig.toml")
    rig = run.rig_for(log, options)
    ((name, written),) = rig.joints.items()
    signals = run.bound_as_recorded(run.read_wanted(log, rig.joints, options), name, written)
    joint, hold = at_joint(written), 0.5 * signals.period
    system = build_system(joint, channels_of(signals).thinned(), balance_for(joint), hold)
    setting = setting_of(joint, system)
    problem, sites = (
        Problem(joint, setting, felt(written, rig.tolerances[name])),
        selection.sites_of(setting, frozenset()),
    )
    return selection._rig_stage(problem, system, sites, selection.blocks_of(system), hold)[1]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.clean", description=__doc__)
    parser.add_argument("--logs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--device", choices=DEVICES, action="append", help="default: all")
    parser.add_argument("--out", type=Path, default=Path("battery/clean"))
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument(
        "--again", action="store_true", help="take the logs that lie in --out, made with the same options"
    )
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    chosen = plans("clean", given.logs, given.seed, tuple(given.device or DEVICES))
    for problem in () if given.again else generate(chosen, given.out, given.workers):
        print(f"not made: {problem}", file=sys.stderr)
    folders = [given.out / p.name for p in chosen if (given.out / "sealed" / f"{p.name}.json").exists()]
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        found = np.array(list(pool.map(p_value_of, folders)))
    sys.exit(0 if uniform(found[np.isfinite(found)]) else 1)


def uniform(found: Sequence[float]) -> bool:
    """Print how p-values are distributed; tell whether they may be uniform."""
    test = kstest(found, "uniform")
    print(f"{len(found)} clean logs\n\n| p below | share |\n| --- | --- |")
    for level in LEVELS:
        print(f"| {level:g} | {np.mean(np.asarray(found) <= level):.3f} |")
    print(f"\nKolmogorov–Smirnov: largest distance {test.statistic:.3f}, probability {test.pvalue:.3f}")
    return bool(test.pvalue >= REJECTED)


if __name__ == "__main__":
    main()
