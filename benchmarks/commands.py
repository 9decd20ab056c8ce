"""Time of whole commands, in a process of their own: help, an estimate, and the very first estimate of all.

    python -m benchmarks.commands

The very first estimate compiles the numerical kernels: it runs with an empty cache of compiled code, and has to say on
stderr what it is doing. Exits with 1 where a target is missed.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.measure import machine

VSALOG = str(Path(sys.executable).with_name("vsalog"))
SAMPLES = Path(__file__).parent.parent / "sample_logs"
LOGS = ("vsa2_exp1.mcap", "awas_exp1.mcap")  # 20 s at 1 kHz each

HELP, WARM, FIRST = 0.25, 3.0, 15.0


def run(arguments: list[str], folder: str, cache: Path | None = None) -> tuple[float, str]:
    """Run vsalog; return the time it took [s] and what it wrote to stderr."""
    environment = os.environ | ({"NUMBA_CACHE_DIR": str(cache)} if cache is not None else {})
    start = time.perf_counter()
    done = subprocess.run([VSALOG, *arguments], cwd=folder, env=environment, capture_output=True, text=True)
    taken = time.perf_counter() - start
    if done.returncode != 0:
        sys.exit(f"vsalog {' '.join(arguments)} failed: {done.stderr}")
    return taken, done.stderr


def report(name: str, taken: list[float], target: float) -> bool:
    met = statistics.median(taken) <= target
    print(
        f"{name:52}{min(taken):7.2f} {statistics.median(taken):7.2f} {target:7.2f}"
        + ("" if met else "   TARGET MISSED")
    )
    return met


def main() -> int:
    print(machine("vsalog", "numba", "numpy", "scipy", "pyarrow", "pandas"))
    print(f"\nseconds{'':45}{'least':>7} {'median':>7} {'target':>7}")
    met = []
    with tempfile.TemporaryDirectory() as folder:
        run(["--help"], folder)
        met.append(report("vsalog --help", [run(["--help"], folder)[0] for _ in range(15)], HELP))
        for log in LOGS:
            job = ["estimate", str(SAMPLES / log)]
            first, said = [], []
            for i in range(3):
                taken, stderr = run(job, folder, Path(folder) / f"cache-{log}-{i}")
                first.append(taken)
                said.append("compiling" in stderr)
            run(job, folder)
            warm = [run(job, folder) for _ in range(7)]
            met.append(report(f"vsalog estimate {log}", [t for t, _ in warm], WARM))
            met.append(report(f"vsalog estimate {log}, nothing compiled yet", first, FIRST))
            if not all(said):
                print("  it did not say on stderr that it was compiling   TARGET MISSED")
            if any("compiling" in stderr for _, stderr in warm):
                print("  it said that it was compiling when it was not   TARGET MISSED")
            met += [all(said), not any("compiling" in stderr for _, stderr in warm)]
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
