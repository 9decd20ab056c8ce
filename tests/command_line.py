"""`vsalog ARGS` in a process of its own, as a user runs it, without importing all the libraries again each time.

A server that has imported them (`multiprocessing`'s) forks for each command: what happens after the imports is what happens on
a terminal, down to exit codes, file descriptors, and signals.
"""

import multiprocessing
import os
import pkgutil
import sys
import tempfile
from functools import cache
from multiprocessing import forkserver
from pathlib import Path
from subprocess import CompletedProcess, TimeoutExpired

import vsalog


def _modules():
    return [m.name for m in pkgutil.walk_packages(vsalog.__path__, "vsalog.") if not m.name.endswith("__main__")]


_context = multiprocessing.get_context("forkserver")
_context.set_forkserver_preload([*_modules(), "warm_libraries"])


@cache
def _start():
    """Start the server, which finds what it imports by its environment alone."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join(sys.path)
    forkserver.ensure_running()
    if before is None:
        del os.environ["PYTHONPATH"]
    else:
        os.environ["PYTHONPATH"] = before


def _play(args, cwd, out, err, environment):
    """Be the process: everything goes through the file descriptors, so that what libraries write is caught too."""
    for descriptor, path in ((1, out), (2, err)):
        file = os.open(path, os.O_WRONLY | os.O_CREAT)
        os.dup2(file, descriptor)
        os.close(file)
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 (a descriptor, for the life of the process)
    sys.stderr = open(2, "w", encoding="utf-8", closefd=False, buffering=1)  # noqa: SIM115
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = ["vsalog", *args]
    from vsalog.cli import main

    main()


def vsalog_run(*args, cwd, timeout=300) -> CompletedProcess[str]:
    """Run `vsalog ARGS` in a folder; returns the finished process with its output as text."""
    _start()
    given = [str(a) for a in args]
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder, "out"), Path(folder, "err")
        process = _context.Process(target=_play, args=(given, str(cwd), str(out), str(err), dict(os.environ)))
        process.start()
        process.join(timeout)
        if process.is_alive():
            process.kill()
            process.join()
            raise TimeoutExpired(given, timeout)
        text = [p.read_text(encoding="utf-8") if p.exists() else "" for p in (out, err)]
    return CompletedProcess(["vsalog", *given], process.exitcode, *text)
