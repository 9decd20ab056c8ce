"""What `inspect --repair` wrote, in words."""

from __future__ import annotations

from vsalog.core.printable import plural, printable
from vsalog.writers.repaired import Repaired


def repair_words(repaired: Repaired) -> str:
    """Return in words what was written."""
    words = f"{repaired.path}: {plural(repaired.messages, 'message')} of {plural(repaired.channels, 'channel')} written"
    return "; ".join([words, *map(printable, repaired.notes)])
