"""What the benchmarks share: taking times side by side, and saying what they were taken on."""

from __future__ import annotations

import os
import platform
import shutil
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


@dataclass(frozen=True)
class Time:
    """Least and median of several rounds [s]."""

    least: float
    median: float


def side_by_side(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Time]:
    """Time calls in turn, round after round, so that a busy machine disturbs them all alike.

    Each is called once before, to compile and to warm the caches.
    """
    for call in calls.values():
        call()
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            taken[name].append(time.perf_counter() - start)
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
