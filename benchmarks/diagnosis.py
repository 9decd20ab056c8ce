"""CPU time and memory of `vsalog diagnose` on a minute at 1 kHz of machines with several faults.

    python -m benchmarks.diagnosis [--machines 3] [--seed 1] [--seconds 60]

Machines of the family *messy* are drawn for each device, and diagnosed against a held-out log, each command in a process of
its own whose CPU time and peak of resident memory are taken. `vsalog estimate` on the same log, run in turn, is the reference
that says how fast the processor is. Exits with 1 where a target is missed. Needs a Unix.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from statistics import median

from benchmarks.measure import machine, usage_of
from tests.hidden_effects.families import FAMILIES
from tests.hidden_effects.generate import family_plans, make_and_write

VSALOG = str(Path(sys.executable).with_name("vsalog"))
GIB = 2**30
# CPU seconds that are asked for, and memory.
SECONDS, MEMORY = {"elastic": 8.0, "serial": 12.0, "antagonistic": 12.0}, 1.0 * GIB


def measured(case: Path) -> tuple[float, float, int]:
    """Return the CPU time of a diagnosis [s], that of an estimate [s], and the diagnosis' memory [bytes]."""
    given = (case / "log.parquet", "--rig", case / "rig.toml")
    estimate = usage_of([VSALOG, "estimate", *given, "-o", case / "estimate.parquet"])
    diagnose = usage_of([VSALOG, "diagnose", *given, "--holdout", case / "holdout.parquet", "-o", case / "diagnosis"])
    return diagnose.cpu, estimate.cpu, diagnose.memory


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", type=int, default=3, help="of each device")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60.0, help="of a log")
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    FAMILIES["messy"] = replace(FAMILIES["messy"], duration=(asked.seconds, asked.seconds))
    print(machine("vsalog", "numba", "numpy", "scipy"))
    print(f"\n{'device':14}{'median [s]':>11}{'most [s]':>10}{'target [s]':>12}{'of estimate':>13}{'memory [GiB]':>14}")
    met = True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for device, target in SECONDS.items():
            plans = family_plans("messy", asked.machines + 1, asked.seed, (device,))
            made = [plan for plan in plans if make_and_write(plan, folder) is None]
            measured(folder / made[0].name)  # compiles, where that is still to be done
            taken = [measured(folder / plan.name) for plan in made[1:]]
            seconds, ratios, memory = [t for t, _, _ in taken], [t / e for t, e, _ in taken], max(m for *_, m in taken)
            good = median(seconds) <= target and memory <= MEMORY
            met &= good
            print(
                f"{device:14}{median(seconds):11.1f}{max(seconds):10.1f}{target:12g}{median(ratios):12.1f}×"
                f"{memory / GIB:14.2f}   {'met' if good else 'MISSED'}"
            )
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
