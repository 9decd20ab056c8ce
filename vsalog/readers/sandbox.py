"""Runs C libraries on possibly damaged files in a copy of this process, which may crash in its place."""

from __future__ import annotations

import faulthandler
import os
import select
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, NoReturn

import msgspec
import numpy as np

from vsalog.readers.limits import PACKED_BYTES

TOO_MUCH = "it takes more memory than any recording of its size"


class SandboxError(Exception):
    """The work failed, took too much memory or time, or ended the process; the message has the reason."""


def sandboxed(work: Callable[[], Any], more: int) -> Any:
    """Return the result of a function that is run in a copy of this process, or in itself where there are none, as on Windows.

    Parameters
    ----------
    work : callable
        Without arguments. It takes no lock that another thread may hold, and returns lists, dictionaries, texts, numbers, None
        and arrays: nothing that could be run comes back.
    more : int
        How many bytes of memory it may take on top of what there is.

    Raises
    ------
    SandboxError
        It took more, raised something, did not end, or ended the process.
    """
    with TemporaryFile() as answer:
        if hasattr(os, "fork"):
            _in_a_copy(work, more, answer)
        else:
            _answer(work, answer)
        answer.seek(0)
        try:
            failed, value = _value(answer)
        except (EOFError, ValueError, msgspec.DecodeError):
            raise SandboxError("it ends the process that reads it") from None
    if failed:
        raise SandboxError(value)
    return value


def _in_a_copy(work: Callable[[], Any], more: int, answer: IO[bytes]) -> None:
    """Let a copy of this process answer.

    Raises
    ------
    SandboxError
        It did not end.
    """
    ended, held = os.pipe()  # whose end that the copy alone holds is closed when it ends, however it does
    child = os.fork()
    if child == 0:
        _be_copy(work, more, answer)
    os.close(held)
    try:
        patience = more / PACKED_BYTES  # s; libraries process many times as much of a file in a second
        if not select.select([ended], [], [], patience)[0]:
            raise SandboxError(f"it takes more than {patience:.0f} s")
    finally:
        os.close(ended)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def _be_copy(work: Callable[[], Any], more: int, answer: IO[bytes]) -> NoReturn:
    """Do the work, and end without the usual clean-up; no output of libraries reaches the terminal."""
    try:
        faulthandler.disable()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        _limit(more)
        _answer(work, answer)
    finally:
        os._exit(0)


def _limit(more: int) -> None:
    """Limit the memory, where the system reports it, and leave no core dump."""
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * os.sysconf("SC_PAGE_SIZE") + more
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _answer(work: Callable[[], Any], file: IO[bytes]) -> None:
    """Write whether it failed, and what it returned, or why: the arrays, which are numbered in the rest, come last."""
    try:
        result = (False, work())
    except MemoryError:
        result = (True, TOO_MUCH)
    except Exception as error:  # libraries raise whatever a damaged file provokes
        result = (True, str(error) or type(error).__name__)
    arrays: list[np.ndarray[Any, Any]] = []

    def numbered(array: Any) -> msgspec.msgpack.Ext:
        arrays.append(array)
        return msgspec.msgpack.Ext(0, str(len(arrays) - 1).encode())

    raw = msgspec.msgpack.encode(result, enc_hook=numbered)
    np.save(file, np.frombuffer(raw, np.uint8), allow_pickle=False)
    for array in arrays:
        np.save(file, array, allow_pickle=False)
    file.flush()


def _value(file: IO[bytes]) -> Any:
    """Return what `_answer` wrote."""
    raw = np.load(file, allow_pickle=False)
    end = os.fstat(file.fileno()).st_size
    arrays = []
    while file.tell() < end:
        arrays.append(np.load(file, allow_pickle=False))
    return msgspec.msgpack.decode(raw.tobytes(), ext_hook=lambda _, number: arrays[int(bytes(number))])
