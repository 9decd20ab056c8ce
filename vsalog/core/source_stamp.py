"""What tells numba's cache of a compiled function that a file which the function calls has changed."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType


def source_stamp(*modules: ModuleType) -> str:
    """Return what changes when one of the files changes: numba's cache looks at a function's own file only."""
    return " ".join(str(Path(str(module.__file__)).stat().st_mtime_ns) for module in modules)
