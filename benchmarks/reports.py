"""What takes a person's patience: `vsalog validate` on an hour, `vsalog diagnose` on a minute.

    python -m benchmarks.reports [--minutes 60] [--seconds 60]

A model is fitted to 20 s of a simulated VSA-II and validated on an hour at 1 kHz; a minute of a simulated elastic joint with dry
friction that its rig does not know is diagnosed, against a second minute. Each command runs in a process of its own, whose peak
of resident memory is taken. Exits with 1 where a target is missed. Needs a Unix.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.measure import machine

VSALOG = str(Path(sys.executable).with_name("vsalog"))
GIB = 2**30
# Seconds and memory that are asked for.
VALIDATE, DIAGNOSE = (15.0, 1.5 * GIB), (20.0, 2.0 * GIB)
HIDDEN = ("--actual", "joint.sea.motor.friction.coulomb=0.2")


def run(*arguments: str | Path, codes: tuple[int, ...] = (0,)) -> tuple[float, int]:
    """Run vsalog; return the time [s] and the peak of resident memory [bytes]."""
    start = time.perf_counter()
    process = subprocess.Popen([VSALOG, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) not in codes:
        sys.exit(f"vsalog {arguments[0]} failed: {said.decode()}")
    return time.perf_counter() - start, usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def validated(folder: Path, minutes: float) -> tuple[float, int]:
    """Return what the validation of a model on a long log takes."""
    short, long = folder / "short.parquet", folder / "long.parquet"
    run("simulate", "vsa2", "-o", short)
    run("simulate", "vsa2", "--duration", f"{60.0 * minutes} s", "--seed", "1", "-o", long)
    run("estimate", short, "-o", f"{folder}/")
    return run("validate", folder / "short.model.toml", long, "-o", folder / "report", codes=(0, 3))


def diagnosed(folder: Path, seconds: float) -> tuple[float, int]:
    """Return what the diagnosis of a log takes."""
    for seed, name in enumerate(("log", "holdout")):
        path = folder / f"{name}.parquet"
        run("simulate", "sea", *HIDDEN, "--duration", f"{seconds} s", "--seed", str(seed), "-o", path)
    return run("diagnose", folder / "log.parquet", "--holdout", folder / "holdout.parquet", "-o", folder / "diagnosis")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0, help="of the log to validate on")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the log to diagnose")
    asked = parser.parse_args()
    print(machine("vsalog", "numba", "numpy", "scipy", "pyarrow", "plotly"))
    met = True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        diagnosed(folder, 20.0)  # compiles, where that is still to be done
        validated(folder, 1.0)
        for what, took, target in (
            (f"validate, {asked.minutes:g} min at 1 kHz", validated(folder, asked.minutes), VALIDATE),
            (f"diagnose, {asked.seconds:g} s at 1 kHz", diagnosed(folder, asked.seconds), DIAGNOSE),
        ):
            good = took[0] <= target[0] and took[1] <= target[1]
            met &= good
            print(
                f"{what:32}{took[0]:7.1f} s {took[1] / GIB:6.2f} GiB   "
                f"target {target[0]:g} s, {target[1] / GIB:g} GiB: {'met' if good else 'MISSED'}"
            )
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
