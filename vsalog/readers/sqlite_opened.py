"""SQLite files opened for reading only, with nothing left behind beside them.

A database with a write-ahead log is read with the help of a third file, FILE-shm. Who may only read creates it all the same, as
well as a log where there is none, and leaves both behind; one that a killed program has left is written again.
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
"""At byte 18 of a database that is written by way of a log."""

_LOCK = "hhqqi"
"""Linux: what a lock is (struct flock)."""
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
    """Return a database's log of changes, where there is one that no program has open."""
    return path.with_name(f"{path.name}-wal") if _how(path) == _ALONE else None


def _how(path: Path) -> str:
    """Return the options to open a database with."""
    log, shared = (path.with_name(path.name + ending) for ending in ("-wal", "-shm"))
    with path.open("rb") as file:
        file.seek(18)
        logged = file.read(2) == _LOGGED
    if not logged or (log.exists() and shared.exists() and _is_in_use(shared)):
        return _IN_PLACE  # a program is writing it: there is all that it takes
    return _ALONE if log.exists() and log.stat().st_size else _WITHOUT_LOG


def _is_in_use(shared: Path) -> bool:
    """Tell whether a program has the database open: it has a lock on FILE-shm then. Where that cannot be told, it may have."""
    if not sys.platform.startswith("linux"):
        return True
    import fcntl

    try:
        file = shared.open("rb")
        found = fcntl.fcntl(file, fcntl.F_OFD_GETLK, struct.pack(_LOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
    except OSError:
        return True
    if struct.unpack(_LOCK, found)[0] != fcntl.F_UNLCK:
        _kept_open.append(file)  # to close it would undo the locks that this very program may have on it
        return True
    file.close()
    return False


def _settle(database: sqlite3.Connection, how: str) -> None:
    """Keep in memory what FILE-shm would hold, for nobody else has the database open."""
    if how == _ALONE:
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
