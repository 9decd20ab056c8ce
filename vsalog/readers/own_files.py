"""Files that vsalog or its users write, and that may be given where a log is expected: traces, models and rigs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.errors import ReadError
from vsalog.core.printable import command
from vsalog.core.toml import parse_toml
from vsalog.readers.opened import for_arrow

# Columns that every trace has, and no recorded log.
TRACE = (
    "time",
    "joint",
    "transmission",
    "deflection",
    "flexibility_torque",
    "flexibility_torque_fit",
    "stiffness",
    "stiffness_std",
    "excited",
)


def is_trace(path: Path) -> bool:
    """Return whether a file is a trace that `estimate` wrote, whatever its name."""
    try:
        return path.is_file() and set(TRACE) <= set(pq.read_schema(for_arrow(path)).names)
    except (OSError, UnicodeError, pa.ArrowException):
        return False


def model_beside(trace: Path) -> Path:
    """Return where `estimate` puts the model of a trace."""
    return trace.with_name(re.sub(r"(\.stiffness)?\.parquet$", "", trace.name) + ".model.toml")


def refuse_toml(path: Path) -> None:
    """Refuse a model or a rig in place of a log.

    Raises
    ------
    ReadError
        It is one.
    """
    kind = kind_of_toml(path)
    if kind == "model":
        judged = command("validate", path, "LOG")
        raise ReadError(f"is a model that 'vsalog estimate' wrote, no log; '{judged}' tests it on a log", path)
    if kind == "rig":
        raise ReadError("is a rig, no log; name the log, and the rig with --rig", path)


def kind_of_toml(path: Path) -> Literal["model", "rig"] | None:
    """Return whether a TOML file looks like a model or a rig; None for neither."""
    if path.suffix != ".toml":
        return None
    try:
        keys = parse_toml(path.read_text(encoding="utf-8-sig")).keys()
    except (OSError, ValueError, RecursionError):
        return None
    if {"units", "rig", "joint"} <= keys:
        return "model"
    return "rig" if keys & {"joint", "preset"} else None
