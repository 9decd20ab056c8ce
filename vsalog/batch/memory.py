"""How much memory there is, and how much a log is expected to need."""

from __future__ import annotations

import math

from vsalog.batch.records import Log, Settings
from vsalog.core.memory import usable_memory

BASE = 330 * 2**20
"""Bytes that an idle worker takes, with everything loaded."""


# What a step needs beyond that, as measured over formats (docs/how-to), with room: bytes per byte of log, and at most, however
# long a log is, where it is worked on in a temporary file and figures are drawn of thinned traces.
NEEDS = {
    "estimate": (6.0, 1000 * 2**20),
    "page": (25.0, 2500 * 2**20),
    "validate": (10.0, math.inf),
    "diagnose": (60.0, math.inf),
}
WHOLE = b".mat"
"""MATLAB's files are read as a whole."""


def expected(log: Log, settings: Settings) -> int:
    """Return the bytes that a log is expected to need, those of the worker itself included."""
    steps = [NEEDS[settings.do]]
    if settings.do == "estimate" and settings.report:
        steps.append(NEEDS["page"])
    whole = log.where.lower().endswith(WHOLE)
    return BASE + round(sum(min(each * log.size, math.inf if whole else most) for each, most in steps))


def free() -> int:
    """Return the free memory [bytes]: of the machine, or of the control group of the process."""
    return max(BASE, usable_memory())
