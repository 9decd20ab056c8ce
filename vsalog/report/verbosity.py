"""How much is printed on stderr in addition to errors and warnings."""

from __future__ import annotations

from enum import IntEnum


class Verbosity(IntEnum):
    """What `--quiet` and `--verbose` ask for.

    Attributes
    ----------
    QUIET : no progress, no notes
    NORMAL : progress and notes
    VERBOSE : also the time of each step, and where files were found
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
