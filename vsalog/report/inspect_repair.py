"""What `inspect --repair` wrote, as data and in words."""

from __future__ import annotations

from msgspec import Struct

from vsalog.core.printable import printable
from vsalog.readers.base import plural


class Repaired(Struct, frozen=True):
    """What was written.

    Attributes
    ----------
    path : the new file
    messages, channels : how many
    notes : what could not be read
    """

    path: str
    messages: int
    channels: int
    notes: tuple[str, ...]


def told(repaired: Repaired) -> str:
    """Return in words what was written."""
    words = f"{repaired.path}: {plural(repaired.messages, 'message')} of {plural(repaired.channels, 'channel')} written"
    return "; ".join([words, *map(printable, repaired.notes)])
