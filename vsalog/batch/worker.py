"""A worker process, of the pool or of a cluster.

The process that distributes logs imports this module without the libraries that process them: these are imported inside
functions with the first log, as in the commands.
"""

from __future__ import annotations

import os
import signal
import threading
from contextlib import suppress
from multiprocessing.connection import wait
from multiprocessing.process import parent_process
from pathlib import Path

import msgspec

from vsalog.batch.records import Settings, Task
from vsalog.core.errors import ReadError, VsalogError

# One thread per worker: the cores are shared among workers, not within one.
LIBRARIES = ("OPENBLAS", "OMP", "MKL", "NUMEXPR", "NUMBA")
THREADS = {"VECLIB_MAXIMUM_THREADS": "1"} | {f"{library}_NUM_THREADS": "1" for library in LIBRARIES}


def prepare() -> None:
    """Load the libraries for logs, in a new process of the pool."""
    os.environ.update(THREADS)
    # Files are complete at any moment: the pool may kill a worker.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    import pyarrow

    import vsalog.batch.work  # noqa: F401

    pyarrow.set_cpu_count(1)


def do_task(task: bytes) -> bytes:
    """Do a task; both it and the answer are JSON: no other objects pass between processes."""
    from vsalog.batch.work import do

    return msgspec.json.encode(do(msgspec.json.decode(task, type=Task)))


def check_settings(settings: bytes) -> str:
    """Return the error in the options, whatever the log; "" where there is none."""
    from vsalog.batch.one_log import check

    try:
        check(msgspec.json.decode(settings, type=Settings))
    except VsalogError as error:
        return str(error)
    return ""


def is_recording(folder: str, meant: bool) -> bool:
    """Return whether the tables of a folder are one recording; unless the folder itself is `meant`, clocks have to show it."""
    from vsalog.readers import open_reader
    from vsalog.readers.table_folder import TableFolderReader

    with suppress(ReadError):
        reader = open_reader(folder)
        return isinstance(reader, TableFolderReader) and (meant or reader.surely_one)
    return False


def is_prose(path: str) -> bool:
    """Return whether a file is text, and no table."""
    from vsalog.readers import open_reader
    from vsalog.readers.sniff import sniff

    with suppress(ReadError):  # a file of unknown format may be a damaged log
        if sniff(Path(path)) == "table":
            try:
                open_reader(path)
            except ReadError:
                return True
    return False


def _leave_with_parent() -> None:
    """End when the parent does, by whatever signal: nobody waits for the answer."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
