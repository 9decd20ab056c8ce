"""A worker process, of the pool or of a cluster.

Who hands out logs imports this module and does without all that works on them: that comes with the first log, inside
functions, as in the commands.
"""

from __future__ import annotations

import os
import signal
import threading
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection, wait
from multiprocessing.process import parent_process
from typing import Any

# First byte of what goes through the pipe.
TASK, CHECK, PREPARE = b"t", b"c", b"p"
BEGUN, ANSWER, COMPILING = b"b", b"a", b"n"

# One thread per worker: the cores are shared among workers, not within one.
LIBRARIES = ("OPENBLAS", "OMP", "MKL", "NUMEXPR", "NUMBA")
THREADS = {"VECLIB_MAXIMUM_THREADS": "1"} | {f"{library}_NUM_THREADS": "1" for library in LIBRARIES}


def serve(pipe: Connection) -> None:
    """Answer what comes through the pipe, until it is closed.

    Parameters
    ----------
    pipe : to the pool
    """
    # A terminal's Ctrl-C reaches all processes: the pool decides what ends when.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    loaded = False
    with suppress(EOFError, OSError):
        while message := pipe.recv_bytes():
            kind, body = message[:1], message[1:]
            if kind == CHECK:
                pipe.send_bytes(ANSWER + check_settings(body).encode("utf-8", "backslashreplace"))
                continue
            if kind == PREPARE:
                loaded = loaded or _load(pipe)
                continue
            pipe.send_bytes(BEGUN)
            pipe.send_bytes(ANSWER + do_task(body))
    os._exit(0)


def do_task(task: bytes) -> bytes:
    """Do a task; both it and the answer are JSON."""
    from vsalog.batch.work import do_json

    return do_json(task)


def check_settings(settings: bytes) -> str:
    """Return what is wrong with what is asked for, whatever the log; nothing where nothing is."""
    from vsalog.batch.work import check_json

    return check_json(settings)


def _load(pipe: Connection) -> bool:
    """Import what logs are done with, and say when loops are compiled."""
    import pyarrow

    import vsalog.batch.work  # noqa: F401

    event: Any = import_module("numba.core.event")

    pyarrow.set_cpu_count(1)

    class Once(event.Listener):  # type: ignore[misc]
        said = False

        def on_start(self, event: object) -> None:
            if not self.said:
                pipe.send_bytes(COMPILING)
            self.said = True

        def on_end(self, event: object) -> None:
            pass

    event.register("numba:compile", Once())
    return True


def _leave_with_parent() -> None:
    """End when the parent does, by whatever signal: nobody would wait for the answer."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
