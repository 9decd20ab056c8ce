"""A worker process, of the pool or of a cluster.

Who hands out logs imports this module and does without all that works on them: that comes with the first log, inside
functions, as in the commands.
"""

from __future__ import annotations

import os
import signal
import threading
from multiprocessing.connection import wait
from multiprocessing.process import parent_process

import msgspec

from vsalog.batch.records import Settings, Task
from vsalog.core.errors import VsalogError

# One thread per worker: the cores are shared among workers, not within one.
LIBRARIES = ("OPENBLAS", "OMP", "MKL", "NUMEXPR", "NUMBA")
THREADS = {"VECLIB_MAXIMUM_THREADS": "1"} | {f"{library}_NUM_THREADS": "1" for library in LIBRARIES}


def prepare() -> None:
    """Load what logs are done with, in a new process of the pool."""
    os.environ.update(THREADS)
    # Files are whole at any moment: the pool ends a worker without asking it.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    import pyarrow

    import vsalog.batch.work  # noqa: F401

    pyarrow.set_cpu_count(1)


def do_task(task: bytes) -> bytes:
    """Do a task; both it and the answer are JSON, so that nothing else goes between processes."""
    from vsalog.batch.work import do

    return msgspec.json.encode(do(msgspec.json.decode(task, type=Task)))


def check_settings(settings: bytes) -> str:
    """Return what is wrong with what is asked for, whatever the log; nothing where nothing is."""
    from vsalog.batch.one_log import check

    try:
        check(msgspec.json.decode(settings, type=Settings))
    except VsalogError as error:
        return str(error)
    return ""


def _leave_with_parent() -> None:
    """End when the parent does, by whatever signal: nobody would wait for the answer."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
