"""How much memory there is, and how much a log is expected to need."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

from vsalog.batch.records import Log, Settings
from vsalog.core.errors import BatchError

MIB = 2**20
# A worker that waits, with everything loaded.
BASE = 330 * MIB
# Beyond that, bytes per byte of log, as measured over formats (docs/batch.md), with room.
FACTORS = {"estimate": 6.0, "validate": 10.0, "diagnose": 60.0}
PAGE_FACTOR = 25.0
# No more than that, however long a log is, where it is worked on in a temporary file and figures are drawn of thinned traces;
# MATLAB's files are read as a whole.
MOST, MOST_PAGE = 1000 * MIB, 2500 * MIB
WHOLE = b".mat"
# A worker that needed more than this is replaced: memory that was used once is hardly given back.
LARGE = 1024 * MIB
# Of what is free.
SHARE = 0.8
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


def expected(log: Log, settings: Settings) -> int:
    """Return the bytes that a log is expected to need, those of the worker itself included."""
    need = FACTORS[settings.do] * log.size
    if settings.do != "estimate":
        return BASE + round(need)
    page = PAGE_FACTOR * log.size if settings.report else 0.0
    if not log.where.lower().endswith(WHOLE):
        need, page = min(need, MOST), min(page, MOST_PAGE)
    return BASE + round(need + page)


def parse_size(text: str) -> int:
    """Read a size such as 4GB, 512 MiB or 3e9.

    Raises
    ------
    BatchError
        It is none, or too small for a single worker.
    """
    match = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]+)?)\s*([kmgt]?i?)b?\s*", text, re.IGNORECASE)
    size = 0.0
    if match is not None:
        with suppress(ValueError):
            size = float(match[1]) * _UNITS.get(match[2].lower(), 0)
    if not 0.0 < size < 1e18:
        raise BatchError(f"--memory: '{text}' is no size; write 4GB or 512MiB")
    if size < BASE:
        raise BatchError(f"--memory: {text} is too little: a single worker takes {told(BASE)} before it opens a log")
    return int(size)


def told(size: float) -> str:
    """Return a size as people write it."""
    return f"{size / 1e9:.3g} GB" if size >= 1e9 else f"{size / 1e6:.3g} MB"


def free() -> int:
    """Return the bytes that can be used without pushing others out: of the machine, or of the group the process is in."""
    found = [size for size in (_available(), _group()) if size is not None]
    return max(BASE, int(SHARE * min(found))) if found else 8 * BASE


def _available() -> int | None:
    with suppress(OSError, ValueError, IndexError):
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        return int(text.split("MemAvailable:")[1].split()[0]) * 1024
    with suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return None


def _group() -> int | None:
    """Return what a container leaves, as control groups tell it."""
    for most, used in (
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ):
        with suppress(OSError, ValueError):
            return max(int(Path(most).read_text()) - int(Path(used).read_text()), 0)
    return None


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
