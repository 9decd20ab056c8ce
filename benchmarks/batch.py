"""`vsalog batch` on many logs the size of the samples.

    python -m benchmarks.batch [--logs 200]

Copies of the sample logs go through `vsalog batch` with one process and with two, and through the estimator alone: one process
that prepares and estimates log after log and writes traces and models, as `vsalog estimate` does, timed from the second log on.
All three in turn, and each once more. Exits with 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.measure import machine

ROOT = Path(__file__).parent.parent
VSALOG = str(Path(sys.executable).with_name("vsalog"))
MOST_SECONDS, MOST_SHARE, MOST_OVERHEAD = 60.0, 0.6, 0.2
ROUNDS = 2
ALONE = """
import sys, time
from pathlib import Path
from vsalog.job import Options, prepare
from vsalog.writers.results import Outputs, write_results

logs, out = sorted(Path(sys.argv[1]).glob("*/*.*[!l]")), sys.argv[2]
for i, log in enumerate([*logs[:8], *logs]):
    if i == 8:
        start = time.perf_counter()
    write_results(prepare([log], Options()), Outputs.named([log], out, None))
print(time.perf_counter() - start)
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


def batch(logs: Path, out: Path, jobs: int) -> tuple[float, float]:
    """Run the command; return wall time and the sum of what its records say [s]."""
    shutil.rmtree(out, ignore_errors=True)
    start = time.perf_counter()
    subprocess.run([VSALOG, "batch", str(logs), "-o", str(out), "-j", str(jobs)], check=True, stdout=subprocess.DEVNULL)
    taken = time.perf_counter() - start
    records = (out / "records").glob("*.json")
    return taken, sum(json.loads(r.read_text())["run_seconds"] for r in records)


def alone(logs: Path, out: Path) -> float:
    out.mkdir(exist_ok=True)
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", ALONE, str(logs), str(out)],
        check=True, capture_output=True, text=True, cwd=ROOT, env=environment,
    )  # fmt: skip
    return float(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=200)
    asked = parser.parse_args()
    print(machine("vsalog", "numba", "numpy", "pyarrow"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = copies(folder / "logs", asked.logs)
        one, two, own = [], [], []
        for _ in range(ROUNDS):
            one.append(batch(folder / "logs", folder / "out", 1))
            two.append(batch(folder / "logs", folder / "out", 2))
            own.append(alone(folder / "logs", folder / "alone"))
    (first, _), (second, _), estimator = min(one), min(two), min(own)
    share, overhead = second / first, first / estimator - 1.0
    print(f"\n{asked.logs} logs, {size / 1e6:.0f} MB\n")
    print(f"the estimator alone, one process   {estimator:6.1f} s   (all rounds: {', '.join(f'{t:.1f}' for t in own)})")
    print(f"batch, one process                 {first:6.1f} s   (all rounds: {', '.join(f'{t:.1f}' for t, _ in one)})")
    print(f"batch, two processes               {second:6.1f} s   (all rounds: {', '.join(f'{t:.1f}' for t, _ in two)})")
    print(f"\ntwo / one {share:.2f} (at most {MOST_SHARE}); overhead {overhead:+.0%} (at most {MOST_OVERHEAD:.0%})")
    met = share <= MOST_SHARE and second <= MOST_SECONDS and overhead <= MOST_OVERHEAD
    print("targets met" if met else "TARGETS MISSED")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
