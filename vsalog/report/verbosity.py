"""How much is said on stderr besides errors and warnings."""

from __future__ import annotations

from enum import IntEnum


class Verbosity(IntEnum):
    """What `--quiet` and `--verbose` ask for.

    Attributes
    ----------
    QUIET : no progress, no notes
    NORMAL : progress and notes
    VERBOSE : also what took how long, and where things were found
    """

    QUIET = 0
    NORMAL = 1
    VERBOSE = 2


class _Asked:
    level = Verbosity.NORMAL


def ask(level: Verbosity) -> None:
    """Set the verbosity of this process."""
    _Asked.level = level


def verbosity() -> Verbosity:
    """Return the verbosity of this process."""
    return _Asked.level
