"""What `inspect --repair` wrote."""

from __future__ import annotations

from msgspec import Struct


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
