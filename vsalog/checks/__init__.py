"""Checks of a joint's signals and of an estimate; each kind in a file of its own.

A class of a module here that has what a `Check` has is found by itself. Third parties add a check by an entry point in the group
``vsalog.checks`` that names an object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from vsalog.checks.check import Check, Context, OfSignals, Watch
from vsalog.core.extensions import extensions
from vsalog.core.finding import Finding
from vsalog.core.progress import counted
from vsalog.core.trace import Trace


@cache
def checks() -> tuple[Check, ...]:
    """Return every check, by name, those of third parties last: the order in which findings are listed."""
    modules = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]
    own: list[Check] = [
        kind()
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and kind.__module__ == module.__name__ and {"name", "supersedes"} <= vars(kind).keys()
    ]
    return (*sorted(own, key=lambda c: c.name), *(check for _, check in extensions("vsalog.checks")))


class Checks:
    """All checks at work on one log."""

    def __init__(self, context: Context) -> None:
        kinds = checks()
        begun = (kind.start(context) for kind in counted("checks", kinds))
        self.watches: list[Watch] = [watch for watch in begun if watch is not None]
        self.supersedes: Mapping[str, Sequence[str]] = {
            code: superseded for kind in kinds for code, superseded in kind.supersedes.items()
        }

    def of_signals(self) -> list[Finding]:
        """Return the findings from the signals alone, before there is an estimate."""
        return [finding for watch in self.watches if isinstance(watch, OfSignals) for finding in watch.findings()]

    def add(self, trace: Trace) -> None:
        """Take a block of the trace into account."""
        for watch in self.watches:
            watch.add(trace)

    def findings(self) -> list[Finding]:
        """Return what was found when the log has ended, in the order of the checks."""
        return [finding for watch in counted("checks", self.watches) for finding in watch.findings()]
