"""SQLite files opened for reading only, with nothing left behind beside them.

A database with a write-ahead log is read with the help of a third file, FILE-shm. Who may only read creates it all the same, as
well as a log where there is none, and leaves both behind.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

from vsalog.readers.opened import for_sqlite

_LOGGED = b"\2\2"
"""At byte 18 of a database that is written by way of a log."""

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


def attach(database: sqlite3.Connection, path: Path, name: str) -> None:
    """Open a database within another one, by a name.

    Raises
    ------
    sqlite3.Error, OSError
        It cannot be opened.
    """
    how = _how(path)
    _settle(database, how)  # of the databases that are still to come, too
    database.execute(f"ATTACH ? AS {name}", (f"{for_sqlite(path)}?{how}",))


def _how(path: Path) -> str:
    """Return the options to open a database with."""
    log, shared = (path.with_name(path.name + ending) for ending in ("-wal", "-shm"))
    with path.open("rb") as file:
        file.seek(18)
        logged = file.read(2) == _LOGGED
    if not logged or (log.exists() and shared.exists()):
        return _IN_PLACE  # a program may be writing it: there is all that it takes
    return _ALONE if log.exists() and log.stat().st_size else _WITHOUT_LOG


def _settle(database: sqlite3.Connection, how: str) -> None:
    """Keep in memory what FILE-shm would hold, for nobody else has the database open."""
    if how == _ALONE:
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
