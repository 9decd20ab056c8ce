"""`vsalog batch` on many logs the size of the samples.

    python -m benchmarks.batch [--logs 200]

Copies of the sample logs go through `vsalog batch` with one process and with two, and through the estimator alone: one process
that prepares and estimates log after log and writes traces and models, as `vsalog estimate` does, timed when everything is
loaded. All three in turn, several times; the minimum of each counts, with the processor time, which other programs
disturb less. Python's bytecode is there beforehand, as after any installation, whatever the environment says: without it every
process compiles the sources of numba and scipy again, 3 s. Exits with 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measure import machine

ROOT = Path(__file__).parent.parent
VSALOG = str(Path(sys.executable).with_name("vsalog"))
MOST_SECONDS, MOST_SHARE, MOST_OVERHEAD = 60.0, 0.6, 0.2
ROUNDS, WARM_UP = 3, 8
ALONE = """
import sys, time
from pathlib import Path
from vsalog.estimation.job import Options, prepare
from vsalog.report.estimate import write_estimate
from vsalog.report.outputs import Outputs

logs, out, warm_up = sorted(Path(sys.argv[1]).glob("*/*.*[!l]")), sys.argv[2], int(sys.argv[3])
for i, log in enumerate([*logs[:warm_up], *logs]):
    if i == warm_up:
        start, computed = time.perf_counter(), time.process_time()
    write_estimate(prepare([log], Options()), Outputs.named([log], out, None))
print(time.perf_counter() - start, time.process_time() - computed)
"""


def copies(folder: Path, count: int) -> int:
    """Make logs: copies of the samples, ten to a folder; return their size."""
    samples = sorted(p for p in (ROOT / "sample_logs").iterdir() if p.suffix in (".mcap", ".bag", ".csv"))
    size = 0
    for i in range(count):
        sample = samples[i % len(samples)]
        below = folder / f"day{i // 10:03d}"
        below.mkdir(parents=True, exist_ok=True)
        log = below / f"exp{i:04d}{sample.suffix}"
        shutil.copy(sample, log)
        beside = sample.with_suffix(".rig.toml")
        if beside.exists():
            shutil.copy(beside, log.with_suffix(".rig.toml"))
        size += log.stat().st_size
    return size


@dataclass(frozen=True, order=True)
class Run:
    """How long a run took, and how long all its processes computed [s]."""

    seconds: float
    computed: float


def environment(folder: Path) -> dict[str, str]:
    """Return an environment in which bytecode is kept, apart from everybody else's."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPYCACHEPREFIX": str(folder / "bytecode")}


def timed(command: list[str], variables: dict[str, str]) -> tuple[Run, str]:
    """Run a command; return its times and what it printed."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=variables)
    taken, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Run(taken, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime), done.stdout


def batch(logs: Path, out: Path, jobs: int, variables: dict[str, str]) -> Run:
    shutil.rmtree(out, ignore_errors=True)
    return timed([VSALOG, "batch", str(logs), "-o", str(out), "-j", str(jobs)], variables)[0]


def alone(logs: Path, out: Path, variables: dict[str, str]) -> Run:
    out.mkdir(exist_ok=True)
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", ALONE, str(logs), str(out), str(WARM_UP)]
    return Run(*map(float, timed(command, variables | one_thread)[1].split()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=200)
    asked = parser.parse_args()
    print(machine("vsalog", "numba", "numpy", "pyarrow"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs, out, variables = folder / "logs", folder / "out", environment(folder)
        copies(folder / "few", WARM_UP)
        batch(folder / "few", out, 1, variables)
        size = copies(logs, asked.logs)
        one, two, own = [], [], []
        for _ in range(ROUNDS):
            one.append(batch(logs, out, 1, variables))
            two.append(batch(logs, out, 2, variables))
            own.append(alone(logs, folder / "alone", variables))
    second, estimator = min(two).seconds, min(own).seconds
    share, overhead = second / min(one).seconds, min(one).seconds / estimator - 1.0
    print(f"\n{asked.logs} logs, {size / 1e6:.0f} MB\n")
    for what, runs in (("the estimator alone, one process", own), ("batch, one process", one), ("batch, two", two)):
        rounds = ", ".join(f"{run.seconds:.1f} ({run.computed:.1f})" for run in runs)
        print(f"{what:34} {min(runs).seconds:6.1f} s   (all rounds, and computed: {rounds})")
    print(f"\ntwo / one {share:.2f} (at most {MOST_SHARE}); overhead {overhead:+.0%} (at most {MOST_OVERHEAD:.0%})")
    met = share <= MOST_SHARE and second <= MOST_SECONDS and overhead <= MOST_OVERHEAD
    print("targets met" if met else "TARGETS MISSED")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
