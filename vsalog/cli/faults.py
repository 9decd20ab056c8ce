"""What the command line says of faults of ours."""

from __future__ import annotations

import sys

from vsalog.core.printable import printable


def debugging() -> bool:
    """Tell whether a traceback is asked for."""
    return "--debug" in sys.argv


def bug(words: str) -> str:
    """Return the message of a fault of ours."""
    return (
        f"vsalog: this is a bug in vsalog, not in your log: {printable(words)}\n"
        "Please report it with what 'vsalog --debug …' prints."
    )
