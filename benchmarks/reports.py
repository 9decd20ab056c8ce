"""Time and memory of `vsalog validate` on an hour.

    python -m benchmarks.reports [--minutes 60]

A model is fitted to 20 s of a simulated VSA-II and validated on an hour at 1 kHz, in a process of its own whose peak of resident
memory is taken. Exits with 1 where a target is missed. Needs a Unix. For `vsalog diagnose` see `benchmarks.diagnosis`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.measure import Usage, machine, usage_of

VSALOG = str(Path(sys.executable).with_name("vsalog"))
GIB = 2**30
# Seconds and memory that are asked for.
SECONDS, MEMORY = 15.0, 1.5 * GIB


def validated(folder: Path, minutes: float) -> Usage:
    """Return what the validation of a model on a long log takes."""
    short, long = folder / "short.parquet", folder / "long.parquet"
    usage_of([VSALOG, "simulate", "vsa2", "-o", short])
    usage_of([VSALOG, "simulate", "vsa2", "--duration", f"{60.0 * minutes} s", "--seed", "1", "-o", long])
    usage_of([VSALOG, "estimate", short, "-o", f"{folder}/"])
    return usage_of([VSALOG, "validate", folder / "short.model.toml", long, "-o", folder / "report"], codes=(0, 3))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0, help="of the log to validate on")
    asked = parser.parse_args()
    print(machine("vsalog", "numba", "numpy", "scipy", "pyarrow", "plotly"))
    with tempfile.TemporaryDirectory() as name:
        validated(Path(name), 1.0)  # compiles, where that is still to be done
        took = validated(Path(name), asked.minutes)
    met = took.wall <= SECONDS and took.memory <= MEMORY
    print(
        f"validate, {asked.minutes:g} min at 1 kHz{took.wall:9.1f} s {took.memory / GIB:6.2f} GiB   "
        f"target {SECONDS:g} s, {MEMORY / GIB:g} GiB: {'met' if met else 'MISSED'}"
    )
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
