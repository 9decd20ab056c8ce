"""A stamp by which numba's cache of a compiled function detects changes of other files that it calls."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType


def source_stamp(*modules: ModuleType) -> str:
    """Return a value that changes with any of the files: numba's cache checks a function's own file only."""
    return " ".join(str(Path(str(module.__file__)).stat().st_mtime_ns) for module in modules)
