"""Checks: what is suspicious about a joint's signals, or about an estimate; each kind in a file of its own.

Third parties add a check by an entry point in the group ``vsalog.checks`` that names an object like those in `BUILT_IN`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points

from vsalog.checks.check import Check, Context, Watch
from vsalog.checks.cross_check import ReferenceSensors
from vsalog.checks.nominal import NominalSpring
from vsalog.checks.residual import ShapeOfResidual
from vsalog.checks.signals import Signals
from vsalog.checks.standstill import StandstillOfEncoder
from vsalog.core.finding import Finding
from vsalog.core.trace import Trace

# In the order in which findings are listed.
BUILT_IN: tuple[Check, ...] = (
    Signals(),
    StandstillOfEncoder(),
    NominalSpring(),
    ReferenceSensors(),
    ShapeOfResidual(),
)


def checks() -> tuple[Check, ...]:
    """Return every check, those of third parties included."""
    return (*BUILT_IN, *(point.load() for point in entry_points(group="vsalog.checks")))


class Checks:
    """All checks at work on one log."""

    def __init__(self, context: Context) -> None:
        kinds = checks()
        self.watches: list[Watch] = [watch for kind in kinds if (watch := kind.start(context)) is not None]
        self.supersedes: Mapping[str, Sequence[str]] = {
            code: superseded for kind in kinds for code, superseded in kind.supersedes.items()
        }

    def add(self, trace: Trace) -> None:
        """Take a block of the trace into account."""
        for watch in self.watches:
            watch.add(trace)

    def findings(self) -> list[Finding]:
        """Return what was found when the log has ended, in the order of the checks."""
        return [finding for watch in self.watches for finding in watch.findings()]
