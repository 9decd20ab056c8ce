"""The memory of the machine or of the control group of the process; a process's memory, and its cores."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

RESERVE = 0.2
"""Part of the free memory that is left to others and to uncounted items: fragments, buffers, page tables."""

PIECE_BYTES = 2**20
"""Bytes of a file that are read at once: enough that calls cost nothing, few enough for memory and the processor's cache. No text
that a person writes is as long."""

AT_ONCE_BYTES = 256 * 2**20
"""Bytes of a chunk, an array or a log's columns that are in memory at once; a small machine has sixteen times as many."""


def usable_memory() -> int:
    """Return the free memory [bytes], if the system reports it; else that of a small machine."""
    found = [size for size in (_available(), _group()) if size is not None]
    return int((1.0 - RESERVE) * min(found, default=4 * 2**30))


def _available() -> int | None:
    with suppress(OSError, ValueError, IndexError):
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        return int(text.split("MemAvailable:")[1].split()[0]) * 1024
    with suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return None


def _group() -> int | None:
    """Return the free memory of a container, from its control groups."""
    for most, used in (
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ):
        with suppress(OSError, ValueError):
            return max(int(Path(most).read_text()) - int(Path(used).read_text()), 0)
    return None


def resident() -> int:
    """Return the memory of this process [bytes]; 0 where the system does not report it."""
    with suppress(OSError, ValueError, IndexError, AttributeError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")
    return 0


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
