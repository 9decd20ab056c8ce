"""Files whose names libraries cannot be given, for names are bytes, and some of them are no text."""

from __future__ import annotations

import os
from pathlib import Path
from typing import IO
from urllib.parse import quote


def is_text(path: Path) -> bool:
    """Tell whether a path is one that libraries can be given that take text."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def for_arrow(path: Path) -> str | IO[bytes]:
    """Return what Arrow can read a file by: its path, or the file, opened, where the path is no text."""
    return str(path) if is_text(path) else path.open("rb")


def for_sqlite(path: Path) -> str:
    """Return a path as the address that SQLite is given, without options."""
    return f"file:{quote(os.fsencode(path.absolute()))}"
