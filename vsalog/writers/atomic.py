"""Files that are complete or absent."""

from __future__ import annotations

import os
import secrets
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from vsalog.core.errors import WriteError

FILE_SUFFIXES = (
    ".csv", ".h5", ".hdf5", ".htm", ".html", ".json", ".mat", ".mcap", ".npz", ".parquet", ".pdf", ".png", ".svg", ".toml",
    ".tsv", ".txt", ".xlsx",
)  # fmt: skip
"""Suffixes that promise a file of a format: no folder is made of such a name, and no file of another format."""
_INTERRUPTIONS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class _Group(threading.local):
    """What this thread has written and not yet shown: temporary paths and what they will become; None outside of a group."""

    ready: list[tuple[Path, Path]] | None = None


_group = _Group()


@contextmanager
def together() -> Iterator[None]:
    """Let all files that are written within appear at one moment, when all went well, and none of them otherwise.

    Groups within a group are part of it.

    Raises
    ------
    WriteError
        A file cannot be put where it belongs.
    """
    if _group.ready is not None:
        yield
        return
    ready: list[tuple[Path, Path]] = []
    try:
        try:
            _group.ready = ready
            yield
            with _uninterrupted():
                while ready:
                    temporary, path = ready[0]
                    try:
                        temporary.replace(path)
                    except OSError as error:
                        raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from error
                    del ready[0]
        finally:
            _end_group(ready)
    finally:
        # An interrupt may come before or amid the first time.
        _end_group(ready)


def _end_group(ready: list[tuple[Path, Path]]) -> None:
    """Remove the remains of a group, and begin without one."""
    _group.ready = None
    for temporary, _ in ready:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path next to `path` to write to; it becomes `path` when all went well and is removed otherwise.

    Raises
    ------
    WriteError
        The folder does not exist or cannot be written to, or the disk is full.
    """
    check_path(path)
    # The name is known before the file exists: an interrupt in between leaves no unknown file.
    temporary = path.parent / f".vsalog-{secrets.token_hex(8)}.part"
    with together():
        try:
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
            yield temporary
            umask = os.umask(0)
            os.umask(umask)
            temporary.chmod(0o666 & ~umask)
            assert _group.ready is not None
            _group.ready.append((temporary, path))
        except OSError as error:
            _remove(temporary)
            raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from error
        except BaseException:
            _remove(temporary)
            raise


def check_path(path: Path) -> None:
    """Refuse a path that no file can be written to.

    Raises
    ------
    WriteError
        The folder does not exist, or the path is a folder or a device.
    """
    if not path.parent.is_dir():
        raise WriteError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise WriteError(f"{path}: is a folder; name a file")
    if path.exists() and not path.is_file():
        raise WriteError(f"{path}: is a device, not a file; name a file")


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder and those above it, and remove what was made if files for it are not completed.

    Raises
    ------
    WriteError
        It cannot be made.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise WriteError(f"{folder}: cannot be made a folder: {error.strerror}") from error
        yield
    except BaseException:
        # A folder that holds a file stays.
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, as UTF-8."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Delay Ctrl-C and SIGTERM until all is done; only the main thread receives them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    late: list[int] = []
    before = {number: signal.signal(number, lambda number, _: late.append(number)) for number in _INTERRUPTIONS}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # it was not Python's
                signal.signal(number, handler)
    if late:
        signal.raise_signal(late[0])
