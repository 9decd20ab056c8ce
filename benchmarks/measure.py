"""Shared by the benchmarks: alternating timing of programs, and a description of the machine."""

from __future__ import annotations

import os
import platform
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


@dataclass(frozen=True)
class Time:
    """Least and median of several rounds [s]."""

    least: float
    median: float


@dataclass(frozen=True)
class Usage:
    """What a process took: time on the wall and of processors [s], its peak of resident memory [bytes]; and its stderr."""

    wall: float
    cpu: float
    memory: int
    said: str


def usage_of(
    command: Sequence[str | Path], codes: Sequence[int] = (0,), environment: Mapping[str, str] | None = None
) -> Usage:
    """Run a command, which may end with some codes; exit with what it says on stderr where it ends otherwise. Needs a Unix."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [str(part) for part in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment
    )
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) not in codes:
        sys.exit(f"{' '.join(map(str, command[:2]))} failed: {said.decode()}")
    memory = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Usage(time.perf_counter() - start, usage.ru_utime + usage.ru_stime, memory, said.decode())


def side_by_side(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Time]:
    """Take the CPU time of calls in turn, round after round, so that a busy machine disturbs them all alike.

    Each is called once before, to compile and to warm the caches.
    """
    for call in calls.values():
        call()
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.process_time()
            call()
            taken[name].append(time.process_time() - start)
    return {name: Time(min(t), statistics.median(t)) for name, t in taken.items()}


def machine(*packages: str) -> str:
    """Describe the processor and the versions a figure belongs to."""
    found = []
    for package in packages:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"no {package}")
    return "\n".join(
        (
            f"{_processor()}, {os.cpu_count()} cores seen; {platform.system()} {platform.machine()}",
            ", ".join((f"Python {platform.python_version()}", *found)),
        )
    )


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def compiler() -> str:
    """Return the first line of what the C compiler says of itself."""
    path = shutil.which("cc")
    if path is None:
        return "no cc"
    done = subprocess.run([path, "--version"], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[0]
