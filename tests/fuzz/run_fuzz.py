"""Fuzz all targets, or those that are named, one after the other: ``make fuzz SECONDS=3600``.

Each target runs in a process of its own with a limit on memory and on the time of an input. An exception that is none of
ours does not end it: the input is kept in ``findings/`` with its traceback, once for each place it comes from. Compiled loops
are run interpreted, so that the fuzzer sees their branches, and for half of the time compiled with every index checked.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
TARGETS = ("mcap", "messages", "rosbag1", "sqlite", "table", "parquet", "matlab", "rig", "model", "scenario", "pattern")
COMPILED = ("mcap", "messages", "rosbag1", "sqlite")
"""Targets whose readers have compiled loops."""
MEGABYTES, SECONDS_EACH, LONGEST = 1024, 20, 16_384


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", choices=[[], *TARGETS], metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--seconds", type=int, default=3600, help="for all targets together")
    parser.add_argument("--folder", type=Path, default=Path(".fuzz"), help="of the corpus, which is kept, and findings")
    asked = parser.parse_args()
    chosen = asked.targets or TARGETS
    (asked.folder / "findings").mkdir(parents=True, exist_ok=True)
    runs = [(t, False, 1 / (1 + (t in COMPILED))) for t in chosen] + [(t, True, 0.5) for t in chosen if t in COMPILED]
    for target, compiled, share in runs:
        spend(target, compiled, asked.seconds * share / len(chosen), asked.folder)
    found = sorted((asked.folder / "findings").iterdir())
    for path in found:
        print(path)
    return 1 if found else 0


def spend(target: str, compiled: bool, seconds: float, folder: Path) -> None:
    """Run a target until its time is over, again where an input has ended it."""
    corpus, environment = folder / "corpus" / target, dict(os.environ)
    if compiled:
        # What is in the usual cache was compiled without checks.
        environment |= {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str((folder / "numba").absolute())}
    else:
        environment["NUMBA_DISABLE_JIT"] = "1"
    corpus.mkdir(parents=True, exist_ok=True)
    end, count, peak = time.monotonic() + seconds, 0, 0
    ended = 0
    while (left := end - time.monotonic()) > 1:
        done = subprocess.run(
            [
                *(sys.executable, str(HERE / "run_target.py"), target, str(corpus)),
                f"-max_total_time={left:.0f}",
                f"-timeout={SECONDS_EACH}",
                f"-report_slow_units={SECONDS_EACH}",  # what takes less is no finding: the machine may be busy
                f"-rss_limit_mb={MEGABYTES}",
                f"-max_len={LONGEST}",
                f"-artifact_prefix={folder / 'findings'}/{target}-",
                "-print_final_stats=1",
            ],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            check=False,
        )
        count += sum(map(int, re.findall(r"number_of_executed_units: *(\d+)", done.stdout)))
        peak = max(peak, *map(int, re.findall(r"peak_rss_mb: *(\d+)", done.stdout)), 0)
        (folder / f"{target}.txt").write_text(done.stdout, encoding="utf-8")
        if done.returncode:
            ended += 1
            if not re.search("number_of_executed_units", done.stdout):
                shutil.copy(folder / f"{target}.txt", folder / "findings" / f"{target}-died-{ended}")
                if ended > 20:
                    break
    how = "compiled, indices checked" if compiled else "interpreted"
    print(
        f"{target:9} {how:26} {seconds:5.0f} s {count:8} inputs, peak {peak} MB, ended early {ended} times", flush=True
    )


if __name__ == "__main__":
    sys.exit(main())
