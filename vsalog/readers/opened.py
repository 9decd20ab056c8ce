"""Files whose names are bytes that are no text, which libraries do not accept."""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO
from urllib.parse import quote


def is_text(path: Path) -> bool:
    """Return whether libraries accept a path, that is, whether it is text."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def for_arrow(path: Path) -> str | IO[bytes]:
    """Return a file for Arrow: its path, or the opened file, where the path is no text."""
    return str(path) if is_text(path) else path.open("rb")


def for_sqlite(path: Path) -> str:
    """Return a path as the address that SQLite is given, without options."""
    return f"file:{quote(os.fsencode(path.absolute()))}"
