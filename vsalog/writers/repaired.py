"""The result of `inspect --repair`."""

from __future__ import annotations

from msgspec import Struct

from vsalog.core.finding import Finding


class Repaired(Struct, frozen=True):
    """The written file.

    Attributes
    ----------
    path : the new file
    messages, channels : how many
    notes : what could not be read, in sentences
    findings : the same as data
    """

    path: str
    messages: int
    channels: int
    notes: tuple[str, ...]
    findings: tuple[Finding, ...]
