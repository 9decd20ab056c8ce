"""Time of whole commands, in a process of their own: help, an estimate, and the very first estimate of all.

    python -m benchmarks.commands

The very first estimate compiles the numerical kernels: it runs with an empty cache of compiled code, and must report this on
stderr. Python's bytecode exists, as after an installation by pip or a first command. pyarrow imports pandas
where it is installed, which vsalog does not need: it is hidden. Exits with 1 where a target is missed.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from pathlib import Path

from benchmarks.measure import Usage, machine, usage_of

VSALOG = Path(sys.executable).with_name("vsalog")
SAMPLES = Path(__file__).parent.parent / "sample_logs"
LOGS = ("vsa2_exp1.mcap", "awas_exp1.mcap")  # 20 s at 1 kHz each

# Wall time of the help, CPU time of the others [s].
HELP, WARM, FIRST = 0.25, 1.5, 12.0


def run(arguments: list[str | Path], folder: Path, cache: Path | None = None) -> Usage:
    """Run vsalog; return what it took and said."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(folder / "hidden"), os.environ.get("PYTHONPATH"))))
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    return usage_of([VSALOG, *arguments], environment=environment)


def report(name: str, taken: list[float], target: float) -> bool:
    met = statistics.median(taken) <= target
    print(
        f"{name:52}{min(taken):7.2f} {statistics.median(taken):7.2f} {target:7.2f}"
        + ("" if met else "   TARGET MISSED")
    )
    return met


def main() -> int:
    print(machine("vsalog", "numba", "numpy", "scipy", "pyarrow"))
    print(f"\nseconds{'':45}{'least':>7} {'median':>7} {'target':>7}")
    met = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hidden").mkdir()
        (folder / "hidden" / "pandas.py").write_text("raise ImportError\n")
        run(["--help"], folder)
        met.append(report("vsalog --help", [run(["--help"], folder).wall for _ in range(15)], HELP))
        for log in LOGS:
            job = ["estimate", SAMPLES / log, "-o", folder / f"{Path(log).stem}.parquet"]
            run(job, folder)
            warm = [run(job, folder) for _ in range(7)]
            first = [run(job, folder, folder / f"cache-{log}-{i}") for i in range(3)]
            met.append(report(f"vsalog estimate {log}, CPU", [used.cpu for used in warm], WARM))
            met.append(report(f"vsalog estimate {log}, nothing compiled yet, CPU", [used.cpu for used in first], FIRST))
            said = all("compiling" in used.said for used in first)
            silent = not any("compiling" in used.said for used in warm)
            if not said:
                print("  it did not say on stderr that it was compiling   TARGET MISSED")
            if not silent:
                print("  it said that it was compiling when it was not   TARGET MISSED")
            met += [said, silent]
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
