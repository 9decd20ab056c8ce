"""The fields of a stream: which become channels, and which do not, with the reason.

A hostile log may claim any number of fields with names of any length, so that both are limited.
"""

from __future__ import annotations

from collections.abc import Collection

from vsalog.core.printable import LONGEST_TEXT
from vsalog.readers.limits import DECODED_BYTES

MAX_FIELDS = 4096
"""Largest number of a stream's channels, and of its fields reported as none."""
LONG_NAMES = f"names longer than {LONGEST_TEXT} characters"
LARGE_MESSAGES = f"its messages are larger than {DECODED_BYTES // 2**20} MiB"


class Fields:
    """The fields of a stream found so far.

    Parameters
    ----------
    prefix : str
        Name of the stream, ahead of every field's name.
    wanted : collection of str or None
        Channels to decode; None is all of them.

    Attributes
    ----------
    unread : dict of str to str
        Fields that are no channel, by full name, with the reason.
    """

    def __init__(self, prefix: str, wanted: Collection[str] | None) -> None:
        self.prefix, self.wanted = prefix, wanted
        self.unread: dict[str, str] = {}
        self._channels: set[str] = set()

    def take(self, name: str) -> bool:
        """Return whether a field becomes a channel: it is wanted, and there is room for it."""
        if name in self._channels:
            return True
        if self.wanted is not None and name not in self.wanted:
            return False
        if len(self._channels) >= MAX_FIELDS:
            self.leave(self.prefix, f"more than {MAX_FIELDS} different fields; those beyond were left out")
            return False
        self._channels.add(name)
        return True

    def leave(self, name: str, reason: str) -> None:
        """Note that a field is no channel; of the stream as a whole always, of its fields while there is room."""
        if name == self.prefix or len(self.unread) < MAX_FIELDS:
            self.unread.setdefault(name, reason)
