"""SQLite files opened for reading only, with no new files next to them.

A database with a write-ahead log is read with the help of a third file, FILE-shm. SQLite creates it even for reading only, as
well as a missing log, and leaves both behind; one that a killed program has left is written again.
"""

from __future__ import annotations

import os
import sqlite3
import struct
import sys
from pathlib import Path
from typing import IO

from vsalog.readers.opened import for_sqlite

_LOGGED = b"\2\2"
"""Byte 18 of a database with a write-ahead log."""

_LOCK = "hhqqi"
"""Linux: the layout of a lock (struct flock)."""
_kept_open: list[IO[bytes]] = []

_IN_PLACE = "mode=ro"
_WITHOUT_LOG = "mode=ro&immutable=1"
_ALONE = "mode=ro&vfs=unix-none"


def connect(path: Path) -> sqlite3.Connection:
    """Open a database.

    Raises
    ------
    sqlite3.Error, OSError
        It cannot be opened.
    """
    how = _how(path)
    database = sqlite3.connect(f"{for_sqlite(path)}?{how}", uri=True)
    _settle(database, how)
    return database


def left_log(path: Path) -> Path | None:
    """Return a database's write-ahead log, where there is one that no program has open."""
    return path.with_name(f"{path.name}-wal") if _how(path) == _ALONE else None


def _how(path: Path) -> str:
    """Return the options to open a database with."""
    log, shared = (path.with_name(path.name + ending) for ending in ("-wal", "-shm"))
    with path.open("rb") as file:
        file.seek(18)
        logged = file.read(2) == _LOGGED
    if not logged or (log.exists() and shared.exists() and _is_in_use(shared)):
        return _IN_PLACE  # a program is writing it: all files exist
    return _ALONE if log.exists() and log.stat().st_size else _WITHOUT_LOG


def _is_in_use(shared: Path) -> bool:
    """Return whether a program has the database open: it has a lock on FILE-shm then. Where that cannot be told, it may have."""
    if not sys.platform.startswith("linux"):
        return True
    import fcntl

    try:
        file = shared.open("rb")
        found = fcntl.fcntl(file, fcntl.F_OFD_GETLK, struct.pack(_LOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
    except OSError:
        return True
    if struct.unpack(_LOCK, found)[0] != fcntl.F_UNLCK:
        _kept_open.append(file)  # closing it would release the locks that this program may have on it
        return True
    file.close()
    return False


def _settle(database: sqlite3.Connection, how: str) -> None:
    """Keep the contents of FILE-shm in memory, since nobody else has the database open."""
    if how == _ALONE:
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
