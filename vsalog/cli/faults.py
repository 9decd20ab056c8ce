"""Messages about bugs in vsalog."""

from __future__ import annotations

import sys

from vsalog.core.printable import printable


def debugging() -> bool:
    """Return whether a traceback is requested."""
    return "--debug" in sys.argv


def bug(words: str) -> str:
    """Return the message about a bug in vsalog."""
    return (
        f"vsalog: this is a bug in vsalog, not in your log: {printable(words)}\n"
        "Please report it with what 'vsalog --debug …' prints."
    )
